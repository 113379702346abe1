"""Colour lines: equal to the reference, right for print of any colour, and silent where one luminance has several colours."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from offline import BEST, render
from offline.measured import ColourLines
from offline.parts import Part
from offline.stages.chromaticity import block_sums
from offline.stages.colour_lines import _REACH, LineSettings, OnLines, colour_lines
from shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from shared.arrays import DoubleArray
from tests.offline.scenes import cleaned, every_case, gamma_of, sampled
from tests.reference import lines as reference
from tests.reference.chromaticity import extend
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe
from tools.camera.sensor import simulate_additive

# Sums of float32 whose differences are the contrast of luminance: where blocks are few, that is a hundredth of them.
FLOAT32 = 3e-3


def strokes(shape: tuple[int, int], seed: int = 0) -> DoubleArray:
    """How much ink there is at every pixel, 0 to 1, (H, W): thin lines of all directions."""
    random, (rows, columns) = np.random.default_rng(seed), np.indices(shape)
    ink = np.zeros(shape)
    for _ in range(shape[0] * shape[1] // 60):
        y, x, angle = random.uniform(0, shape[0]), random.uniform(0, shape[1]), random.uniform(0, np.pi)
        along = (rows - y) * np.sin(angle) + (columns - x) * np.cos(angle)
        aside = np.abs((columns - x) * np.sin(angle) - (rows - y) * np.cos(angle))
        ink = np.maximum(ink, np.clip(1.5 - aside, 0, 1) * (np.abs(along) < random.uniform(2, 6)))
    return ink


def printed(shape: tuple[int, int], ink: DoubleArray, paper: DoubleArray) -> DoubleArray:
    """A scene, (H, W, C)."""
    covered = strokes(shape)[..., None]
    return covered * ink + (1 - covered) * paper


def shot_of(scene: DoubleArray, pattern: CfaPattern, sigma: float | None) -> Mosaic:
    """Its mosaic; the calibration knows the noise."""
    noise = None if sigma is None else np.random.default_rng(1).normal(scale=sigma, size=scene.shape[:2])
    return observe(scene, pattern, gamma_of(pattern), sigma, noise)


@every_case
@pytest.mark.parametrize("sigma", [None, 0.02])
def test_equal_the_reference(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None) -> None:
    count = len(pattern.channels)
    scene = printed(shape, np.linspace(0.5, 0.1, count), np.full(count, 0.8))
    mosaic, frame = (found := shot_of(scene, pattern, sigma)), cleaned(found)
    gamma, signal = mosaic.calibration.gamma, mosaic.signal.astype(np.float64)
    light = luminance_of(scene, gamma) * np.random.default_rng(2).uniform(0.95, 1.05, shape)
    light[::7, ::5] *= 0.2  # where channels are brighter than all light
    coarse = block_sums(frame, light.astype(np.float32)).solved(1e-3, np.array(gamma))
    blocks = extend(coarse, pattern, shape).astype(np.float32)
    expected = reference.colour_lines(signal, light, coarse, pattern, gamma, mosaic.calibration.noise)
    lines = colour_lines(frame, light.astype(np.float32), blocks, BEST.lines)
    assert_close(np.moveaxis(lines.offset, 0, 2), expected[0], FLOAT32)
    assert_close(np.moveaxis(lines.slope, 0, 2), expected[1], FLOAT32)
    assert_close(lines.share, expected[2], FLOAT32)
    shares = np.random.default_rng(3).uniform(0, 1, lines.share.shape).astype(np.float32)
    colour = scene / luminance_of(scene, gamma)[..., None]
    part = Part(0, light.astype(np.float32), colour.astype(np.float32))
    samples = sampled(mosaic, part.luminance)
    stage = OnLines(samples.sites, replace(lines, share=shares), np.array(gamma, np.float32))
    shown = stage(part, (0, shape[0])).chromaticity
    told = expected[0], expected[1], shares.astype(np.float64)
    assert_close(shown, reference.on_lines(light, colour, told, pattern, gamma), FLOAT32)
    assert_close(shown @ np.array(gamma), np.ones(shape), 1e-5)  # Eq. 7
    assert np.array_equal(stage(part, (1, 3)).chromaticity, shown[1:3])


def test_a_channel_that_is_dark_on_a_line_tells_nothing_of_luminance() -> None:
    """What its samples miss was once divided by next to nothing: up to 150 times white."""
    random = np.random.default_rng(20)
    scene = np.where(random.uniform(size=(96, 104, 1)) < 0.3, (0.212, 0.056, 0.036), (0.0, 0.832, 0.135)).astype(np.float32)
    for tile in ("kodak", "K=4", "K=6"):
        shot = simulate_additive(scene, CfaPattern.of_letters(tile), SensorCalibration(), 0.0, random)
        assert np.abs(render(shot, BEST).rgb).max() < 3


def test_strips_of_blocks_are_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """A strip sees as many rows beside it as decide; a fifth of them would show."""
    shape, pattern = (4 * 150, 60), CfaPattern.bayer(4)
    scene = printed(shape, np.array([0.5, 0.1, 0.05]), np.full(3, 0.8))
    mosaic = shot_of(scene, pattern, 0.02)
    light = luminance_of(scene, mosaic.calibration.gamma).astype(np.float32)
    frame = cleaned(mosaic)
    blocks = extend(block_sums(frame, light).solved(1e-3, np.array(mosaic.calibration.gamma)), pattern, shape).astype(np.float32)
    whole = colour_lines(frame, light, blocks, BEST.lines)
    monkeypatch.setattr("offline.stages.colour_lines._STRIP", 20)
    strips = colour_lines(frame, light, blocks, BEST.lines)
    for each in ("offset", "slope", "share"):
        assert np.array_equal(getattr(strips, each), getattr(whole, each)), each
    monkeypatch.setattr("offline.stages.colour_lines._REACH", _REACH // 5)
    less = colour_lines(frame, light, blocks, BEST.lines)
    assert not np.array_equal(less.offset, whole.offset)


def lines_of(scene: DoubleArray, pattern: CfaPattern) -> ColourLines:
    """The lines of a scene whose luminance is known."""
    mosaic = observe(scene, pattern)
    frame, light = cleaned(mosaic), luminance_of(scene, mosaic.calibration.gamma).astype(np.float32)
    coarse = block_sums(frame, light).solved(1e-6, frame.gamma)
    return colour_lines(frame, light, extend(coarse, pattern, mosaic.shape).astype(np.float32), BEST.lines)


def test_print_has_the_colours_of_ink_and_paper() -> None:
    """Ink and paper of known luminance: the line goes through both, and is believed."""
    ink, paper = np.array([0.5, 0.1, 0.1]), np.array([0.7, 0.8, 0.6])
    lines = lines_of(printed((150, 150), ink, paper), CfaPattern.bayer(6))
    for colour in (ink, paper):
        assert np.abs(lines.at(np.full_like(lines.share, colour.sum())) - colour[:, None, None]).max() < 0.01
    assert lines.share.min() > 0.9


def test_several_colours_of_one_luminance_are_no_line() -> None:
    colours = np.random.default_rng(0).uniform(0.2, 1, (15, 15, 3)).repeat(10, axis=0).repeat(10, axis=1)
    assert lines_of(colours / colours.sum(axis=2, keepdims=True), CfaPattern.bayer(6)).share.max() < 0.1


def test_what_many_blocks_agree_on_is_kept() -> None:
    """Tinted papers beside each other, eight blocks wide: a line keeps most of their colours."""
    tint = 0.02 * np.where(np.arange(288) // 48 % 2, 1, -1)[:, None] * (1, 0, -1)
    lines = lines_of(printed((150, 288), np.full(3, 0.06), np.full(3, 0.8)) * (1 + tint), CfaPattern.bayer(6))
    true, (red, _, blue) = 0.8 * tint[::6, 0], lines.at(np.full_like(lines.share, 2.4))
    assert ((red - blue) @ true).mean() > 0.6 * 2 * (true @ true)


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
def test_red_print_between_black_print_is_red(sigma: float) -> None:
    """Lines of 20 pixels: black, red, black. One line of colours for all three would leave an eighth of the red."""
    shape, red = (120, 240), slice(50, 70)
    covered, ink = strokes(shape)[..., None], np.full((*shape, 3), 0.06)
    for blank in (slice(24), slice(44, 50), slice(70, 76), slice(96, None)):
        covered[blank] = 0
    ink[red] = 0.5, 0.05, 0.05
    noise = np.random.default_rng(1).normal(scale=sigma, size=shape) if sigma else None
    mosaic = observe(covered * ink + (1 - covered) * 0.8, CfaPattern.bayer(6), noise=noise)
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=NoiseModel.gaussian(sigma, 4)))
    rgb = render(mosaic, replace(BEST, learned=replace(BEST.learned, used=False))).rgb[red]
    seen, true = rgb - rgb.mean(axis=2, keepdims=True), covered[red] * (0.3, -0.15, -0.15)
    assert (seen * true).sum() > 0.25 * (true * true).sum()


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("letters", ["RGWWWW/GBWWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW", "kodak"])
def test_black_print_stays_black(letters: str, sigma: float) -> None:
    pattern, shape = CfaPattern.of_letters(letters), (240, 240)
    scene = printed(shape, np.full(3, 0.06), np.full(3, 0.8))
    mosaic = observe(scene, pattern, noise=np.random.default_rng(1).normal(scale=sigma, size=shape) if sigma else None)
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=NoiseModel.gaussian(sigma, 4)))
    rgb = render(mosaic, replace(BEST, learned=replace(BEST.learned, used=False))).rgb
    tint = np.abs(rgb - rgb.mean(axis=2, keepdims=True)).max(axis=2)
    assert np.quantile(tint, 0.999) < 0.09
    assert tint.max() < 0.2


def test_many_sites_of_a_channel_keep_the_colours_of_a_scene() -> None:
    """Luminance under single sites is nearly right: colours that change from place to place are no errors of it."""
    random, shape = np.random.default_rng(3), (150, 150)
    drawn = [gaussian_filter(random.normal(size=shape), width) for width in (2, 12, 12, 12)]
    light, *colours = (plane / plane.std() for plane in drawn)
    scene = 0.3 * np.exp(light / 2)[..., None] * (1 + 0.15 * np.stack(colours, axis=2)).clip(0.1)
    mosaic = observe(scene, CfaPattern.of_letters("kaizu"))
    errors = [
        float(((render(mosaic, replace(BEST, lines=lines)).rgb - scene) ** 2).mean()) for lines in (BEST.lines, LineSettings())
    ]
    assert errors[0] < 1.1 * errors[1]  # 2.6 times where all errors count alike


def test_white_print_on_black_has_less_colour() -> None:
    """Estimates of dark paper keep some noise. If that spoke against its line, the tint would be 0.5."""
    shape, sigma = (240, 240), 0.01
    noise = np.random.default_rng(1).normal(scale=sigma, size=shape)
    mosaic = observe(printed(shape, np.full(3, 0.8), np.full(3, 0.06)), CfaPattern.bayer(6), noise=noise)
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=NoiseModel.gaussian(sigma, 4)))
    rgb = render(mosaic, replace(BEST, learned=replace(BEST.learned, used=False))).rgb
    assert np.quantile(np.abs(rgb - rgb.mean(axis=2, keepdims=True)), 0.999) < 0.42


@pytest.mark.parametrize("sigma", [0.0, 0.01])
def test_white_print_on_red_is_white(sigma: float) -> None:
    """Pooled colours of strokes are those of the paper. If that spoke against the line, the error would be eight times as large."""
    shape = (180, 180)
    scene = printed(shape, np.full(3, 0.8), np.array([0.5, 0.04, 0.04]))
    mosaic = observe(scene, CfaPattern.bayer(6), noise=np.random.default_rng(1).normal(scale=sigma, size=shape) if sigma else None)
    mosaic = replace(mosaic, calibration=replace(mosaic.calibration, noise=NoiseModel.gaussian(sigma, 4)))
    assert ((render(mosaic).rgb - scene) ** 2).mean() < 0.03**2


def test_stars_do_not_colour_the_sky() -> None:
    """Luminance does not show a star at a colour site. If blocks with one counted as others do, parts of the sky would be blue."""
    random, shape = np.random.default_rng(1), (240, 240)
    scene, stars = np.full((*shape, 3), (0.004, 0.007, 0.014)), random.random(shape) < 0.03
    scene[stars] += random.uniform(0.1, 1, (stars.sum(), 1)) * (0.9, 0.95, 1.0)
    rgb = render(simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), 0.01, random)).rgb
    seen, true = (each.reshape(10, 24, 10, 24, 3).mean(axis=(1, 3)) for each in (rgb, scene))
    shares = (each / each.sum(axis=2, keepdims=True) for each in (seen, true))
    assert np.abs(np.subtract(*shares)).max() < 0.35  # 0.65


@pytest.mark.xfail(reason="0.55 since the joint solution is gone; 0.45 without colour lines: the networks have to be trained again")
def test_a_small_white_lamp_in_green_light_is_white() -> None:
    """The line of what is around tells that brighter is greener."""
    shape = (144, 144)
    scene = printed(shape, np.array([0.02, 0.03, 0.02]), np.array([0.06, 0.16, 0.08]))
    scene[69:75, 69:75] = 1.0
    rgb = render(
        simulate_additive(scene.astype(np.float32), CfaPattern.bayer(6), SensorCalibration(), 0.0, np.random.default_rng(0))
    ).rgb
    assert np.abs(rgb[69:75, 69:75] - 1).max() < 0.5  # 0.72


def test_what_is_clipped_is_on_no_line() -> None:
    scene = printed((90, 90), np.full(3, 0.06), np.full(3, 0.8))
    scene[:, 60:] = 2.0
    mosaic = observe(scene, CfaPattern.bayer(6))
    light = luminance_of(scene, mosaic.calibration.gamma).astype(np.float32)
    blocks = np.full((*mosaic.pattern.grid(mosaic.shape).shape, 3), 1 / 3, np.float32)
    lines = colour_lines(cleaned(mosaic, clipping=5.0), light, blocks, BEST.lines)
    assert not lines.share[:, 10:].any()
    assert lines.share[:, :8].min() > 0.9
