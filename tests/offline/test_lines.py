"""Colour lines: right for print of any colour, and silent where one luminance has several
colours.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panchroma.offline import BEST, measure, render
from panchroma.offline.bands import Band
from panchroma.offline.frame import ColourLines
from panchroma.offline.stages.chromaticity import block_sums
from panchroma.offline.stages.colour_lines import (
    _REACH,
    LineProjection,
    LinesSettings,
    fit_colour_lines,
)
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.tools.simulation.sensor import simulate_additive
from tests.offline.scenes import cleaned, gamma_of, sampled, shot
from tests.reference.chromaticity import extend
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe

BAYER = CfaPattern.bayer(6)
WHITE, BLACK, RED = np.full(3, 0.8), np.full(3, 0.06), np.array([0.5, 0.05, 0.05])
SIX = ["K=4", "K=5", "K=6", "K=8", "kodak", "RGWW/BWWW/WWWW/WWWW"]
WITHOUT_NETWORK = replace(BEST, learned=replace(BEST.learned, used=False))


def strokes(shape: tuple[int, int], seed: int = 0) -> DoubleArray:
    """How much ink there is at every pixel, 0 to 1, (H, W, 1): thin lines of all directions."""
    random, (rows, columns) = np.random.default_rng(seed), np.indices(shape)
    ink = np.zeros(shape)
    for _ in range(shape[0] * shape[1] // 60):
        y = random.uniform(0, shape[0])
        x = random.uniform(0, shape[1])
        angle = random.uniform(0, np.pi)
        along = (rows - y) * np.sin(angle) + (columns - x) * np.cos(angle)
        aside = np.abs((columns - x) * np.sin(angle) - (rows - y) * np.cos(angle))
        ink = np.maximum(ink, np.clip(1.5 - aside, 0, 1) * (np.abs(along) < random.uniform(2, 6)))
    return ink[..., None]


def printed(shape: tuple[int, int], ink: DoubleArray, paper: DoubleArray) -> DoubleArray:
    """A scene, (H, W, C)."""
    return strokes(shape) * (ink - paper) + paper


def noisy(scene: DoubleArray, pattern: CfaPattern, sigma: float) -> Mosaic:
    """A shot of a scene whose calibration knows the noise."""
    noise = np.random.default_rng(1).normal(scale=sigma, size=scene.shape[:2]) if sigma else None
    mosaic = observe(scene, pattern, noise=noise)
    return replace(
        mosaic, calibration=replace(mosaic.calibration, noise=NoiseModel.gaussian(sigma, 4))
    )


def without_mean(rgb: FloatArray | DoubleArray) -> FloatArray | DoubleArray:
    return rgb - rgb.mean(axis=2, keepdims=True)


def lines_of(scene: DoubleArray, mosaic: Mosaic, clipping: float = np.inf) -> ColourLines:
    """The lines of a scene whose luminance is known."""
    frame = cleaned(mosaic, clipping)
    light = luminance_of(scene, mosaic.calibration.gamma).astype(np.float32)
    blocks = extend(
        block_sums(frame, light).solved(1e-6, frame.gamma), mosaic.pattern, mosaic.shape
    )
    lines = fit_colour_lines(frame, light, blocks.astype(np.float32), BEST.lines)
    assert lines is not None
    return lines


def test_strips_of_blocks_are_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """A strip sees as many rows beside it as decide; a fifth of them would show."""
    scene, pattern = printed((600, 60), np.array([0.5, 0.1, 0.05]), WHITE), CfaPattern.bayer(4)
    mosaic = noisy(scene, pattern, 0.02)
    whole = lines_of(scene, mosaic)
    monkeypatch.setattr("panchroma.offline.stages.colour_lines._STRIP", 20)
    strips = lines_of(scene, mosaic)
    for name, plane in vars(whole).items():
        assert np.array_equal(getattr(strips, name), plane), name
    monkeypatch.setattr("panchroma.offline.stages.colour_lines._REACH", _REACH // 5)
    assert not np.array_equal(lines_of(scene, mosaic).offset, whole.offset)


def test_a_pixel_in_the_middle_of_a_block_gets_the_colour_of_its_line_as_far_as_that_is_believed() -> (
    None
):
    pattern = CfaPattern.with_block(("RGB",), 5, (4, 3))
    shape = (37, 42)
    random = np.random.default_rng(0)
    gamma, mosaic = np.array(gamma_of(pattern), np.float32), shot(pattern, shape)
    light = random.uniform(0.5, 1, shape).astype(np.float32)
    sites = sampled(mosaic, light).sites
    slope = random.uniform(0.2, 0.4, (3, *sites.shape)).astype(np.float32)
    share = random.uniform(0, 1, sites.shape).astype(np.float32)
    span = np.array([0.6, 0.9], np.float32)[:, None, None] * np.ones_like(share)
    lines = ColourLines(np.full_like(slope, 0.01), slope, share, span)
    colour = np.broadcast_to(np.array([1, 0, 0], np.float32) / gamma, (*shape, 3))
    result = LineProjection(sites, lines, gamma)(Band(0, light, colour), (0, shape[0])).chromaticity
    place = np.ix_(sites.grid.whole_rows, sites.grid.whole_columns + 1)
    # what is darker or brighter than the sites around has the colour of that end
    target = np.moveaxis(lines.at(light[place].clip(0.6, 0.9)), 0, 2)
    target /= target.sum(axis=2, keepdims=True) * gamma
    assert_close(result[place], colour[place] + share[..., None] * (target - colour[place]), 1e-4)
    assert_close(result @ gamma, np.ones(shape), 1e-5)  # Eq. 7


def test_print_has_the_colours_of_ink_and_paper() -> None:
    """Ink and paper of known luminance: the line goes through both, and is believed."""
    ink, paper = np.array([0.5, 0.1, 0.1]), np.array([0.7, 0.8, 0.6])
    scene = printed((150, 150), ink, paper)
    lines = lines_of(scene, observe(scene, BAYER))
    for colour in (ink, paper):
        assert (
            np.abs(lines.at(np.full_like(lines.share, colour.sum())) - colour[:, None, None]).max()
            < 0.01
        )
    assert lines.share.min() > 0.9


def test_several_colours_of_one_luminance_are_no_line() -> None:
    colours = (
        np.random.default_rng(0).uniform(0.2, 1, (15, 15, 3)).repeat(10, axis=0).repeat(10, axis=1)
    )
    colours /= colours.sum(axis=2, keepdims=True)
    assert lines_of(colours, observe(colours, BAYER)).share.max() < 0.1


def test_what_is_clipped_is_on_no_line() -> None:
    scene = printed((90, 90), BLACK, WHITE)
    scene[:, 60:] = 2.0
    lines = lines_of(scene, observe(scene, BAYER), clipping=5.0)
    assert not lines.share[:, 10:].any()
    assert lines.share[:, :8].min() > 0.9


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
def test_red_print_between_black_print_is_red(sigma: float) -> None:
    """Lines of 20 pixels: black, red, black. One line of colours for all three would leave an
    eighth of the red.
    """
    shape, red = (120, 240), slice(50, 70)
    covered, ink = strokes(shape), np.full((*shape, 3), 0.06)
    for blank in (slice(24), slice(44, 50), slice(70, 76), slice(96, None)):
        covered[blank] = 0
    ink[red] = RED
    rgb = render(noisy(covered * ink + (1 - covered) * 0.8, BAYER, sigma), WITHOUT_NETWORK).rgb[red]
    true = covered[red] * (0.3, -0.15, -0.15)
    assert (without_mean(rgb) * true).sum() > 0.5 * (true * true).sum()


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("letters", SIX)
def test_black_print_stays_black(letters: str, sigma: float) -> None:
    mosaic = noisy(printed((240, 240), BLACK, WHITE), CfaPattern.of_letters(letters), sigma)
    tint = np.abs(without_mean(render(mosaic, WITHOUT_NETWORK).rgb)).max(axis=2)
    assert np.quantile(tint, 0.999) < 0.09
    assert tint.max() < 0.2


@pytest.mark.parametrize(("side", "level", "sigma"), [(60, 0.1, 0.03), (30, 0.1, 0.02)])
def test_dark_colours_without_strokes_are_on_no_line(side: int, level: float, sigma: float) -> None:
    """Where nothing is printed, colour is no noise of estimates. If it counted as such, lines would
    take a fifth of it or more.
    """
    count = 180 // side
    colours = np.random.default_rng(0).uniform(0.1, 1.9, (count, count, 3))
    colours *= level / colours.sum(axis=2, keepdims=True)
    scene = colours.repeat(side, axis=0).repeat(side, axis=1)
    lines = measure(noisy(scene, BAYER, sigma), WITHOUT_NETWORK).lines
    assert lines.share.mean() < 0.05


def test_white_print_on_black_has_less_colour() -> None:
    """Estimates of dark paper keep some noise. If that spoke against its line, the tint would be
    0.4.
    """
    rgb = render(noisy(printed((240, 240), WHITE, BLACK), BAYER, 0.01), WITHOUT_NETWORK).rgb
    assert np.quantile(np.abs(without_mean(rgb)), 0.999) < 0.15


@pytest.mark.parametrize("sigma", [0.0, 0.01])
def test_white_print_on_red_is_white(sigma: float) -> None:
    """Pooled colours of strokes are those of the paper. If that spoke against the line, the error
    would be eight times as large.
    """
    scene = printed((180, 180), WHITE, RED)
    assert ((render(noisy(scene, BAYER, sigma)).rgb - scene) ** 2).mean() < 0.03**2


def test_many_sites_of_a_channel_keep_the_colours_of_a_scene() -> None:
    """Luminance under single sites is nearly right: colours that change from place to place are no
    errors of it.
    """
    random, shape = np.random.default_rng(3), (150, 150)
    drawn = [gaussian_filter(random.normal(size=shape), width) for width in (2, 12, 12, 12)]
    light, *colours = (plane / plane.std() for plane in drawn)
    scene = 0.3 * np.exp(light / 2)[..., None] * (1 + 0.15 * np.stack(colours, axis=2)).clip(0.1)
    mosaic = observe(scene, CfaPattern.of_letters("kaizu"))
    errors = [
        ((render(mosaic, replace(BEST, lines=lines)).rgb - scene) ** 2).mean()
        for lines in (BEST.lines, LinesSettings())
    ]
    assert errors[0] < 1.1 * errors[1]  # 2.6 times where all errors count alike


def test_stars_do_not_colour_the_sky() -> None:
    """Luminance does not show a star at a colour site. If blocks with one counted as others do,
    parts of the sky would be blue.
    """
    random, shape = np.random.default_rng(1), (240, 240)
    scene, stars = np.full((*shape, 3), (0.004, 0.007, 0.014)), random.random(shape) < 0.03
    scene[stars] += random.uniform(0.1, 1, (stars.sum(), 1)) * (0.9, 0.95, 1.0)
    rgb = render(simulate_additive(scene, BAYER, SensorCalibration(), 0.01, random)).rgb
    means = (picture.reshape(10, 24, 10, 24, 3).mean(axis=(1, 3)) for picture in (rgb, scene))
    shares = (colours / colours.sum(axis=2, keepdims=True) for colours in means)
    assert np.abs(np.subtract(*shares)).max() < 0.35  # 0.65


def test_a_small_white_lamp_in_green_light_is_white() -> None:
    """The line of what is around tells that brighter is greener."""
    scene = printed((144, 144), np.array([0.02, 0.03, 0.02]), np.array([0.06, 0.16, 0.08])).astype(
        np.float32
    )
    scene[69:75, 69:75] = 1.0
    rgb = render(
        simulate_additive(scene, BAYER, SensorCalibration(), 0.0, np.random.default_rng(0))
    ).rgb
    assert np.abs(rgb[69:75, 69:75] - 1).max() < 0.5  # 0.45 without lines


def lettered(size: int, inks: list[DoubleArray], paper: DoubleArray, font: int) -> DoubleArray:
    """Words in one of OpenCV's fonts, capitals `size` pixels high, the inks in turn, (H, W, 3)."""
    scene, words = (
        np.tile(paper, (150, 240, 1)),
        ["Hand", "of", "xylem", "quiz", "job", "47", "wavy", "pack"],
    )
    scale, place, count = size * 4 / 22, [4, size + 6], 0  # drawn four times as large
    while place[1] < 146:
        word = words[count % len(words)]
        wide = cv2.getTextSize(word, font, scale, 4)[0][0] // 4 + size // 2
        if place[0] + wide > 236:
            place = [4, place[1] + int(1.8 * size) + 3]
            continue
        covered = np.zeros((600, 960), np.uint8)
        cv2.putText(covered, word, (4 * place[0], 4 * place[1]), font, scale, 255, 5, cv2.LINE_AA)
        share = covered.reshape(150, 4, 240, 4).mean(axis=(1, 3))[..., None] / 255
        scene = scene + share * (inks[count % len(inks)] - scene)
        place[0] += wide
        count += 1
    return scene


@pytest.mark.parametrize(
    ("letters", "sigma", "font", "size"),
    [
        ("K=4", 0.0, cv2.FONT_HERSHEY_COMPLEX, 6),
        ("K=4", 0.01, cv2.FONT_HERSHEY_DUPLEX, 10),
        ("K=5", 0.01, cv2.FONT_HERSHEY_SCRIPT_COMPLEX, 13),
        ("K=6", 0.01, cv2.FONT_HERSHEY_SIMPLEX, 6),
        ("K=8", 0.03, cv2.FONT_HERSHEY_TRIPLEX, 18),
        ("kodak", 0.01, cv2.FONT_HERSHEY_TRIPLEX, 13),
        ("RGWW/BWWW/WWWW/WWWW", 0.01, cv2.FONT_HERSHEY_DUPLEX, 6),
    ],
)
def test_black_type_stays_black(letters: str, sigma: float, font: int, size: int) -> None:
    """If blocks told of their own ink, or errors of luminance were normal, up to 0.15."""
    scene = lettered(size, [BLACK], WHITE, font)
    tint = np.abs(without_mean(render(noisy(scene, CfaPattern.of_letters(letters), sigma)).rgb))
    assert np.quantile(tint.max(axis=2), 0.999) < 0.06


@pytest.mark.parametrize(
    ("letters", "sigma", "size", "least"),
    [("K=6", 0.03, 14, 0.67), ("kodak", 0.01, 11, 0.81), ("K=4", 0.01, 18, 0.93)],
)
def test_words_keep_their_ink(letters: str, sigma: float, size: int, least: float) -> None:
    """Black, red and blue in turn."""
    inks = [BLACK, RED, np.array([0.05, 0.08, 0.45])]
    scene = lettered(size, inks, WHITE, cv2.FONT_HERSHEY_TRIPLEX)
    rgb = without_mean(render(noisy(scene, CfaPattern.of_letters(letters), sigma)).rgb)
    true = without_mean(scene)
    assert (rgb * true).sum() > least * (true * true).sum()


def test_a_white_stroke_on_purple_is_nearly_white() -> None:
    """A line is not drawn beyond what its blocks have seen."""
    scene, purple = np.zeros((960, 960, 1), np.float32), np.array([0.19, 0.02, 0.26])
    cv2.line(scene, (400, 500), (528, 470), 1.0, 8)
    covered = scene.reshape(240, 4, 240, 4, 1).mean(axis=(1, 3)).astype(float)
    rgb = render(noisy(covered * (0.85 - purple) + purple, BAYER, 0.0)).rgb
    assert np.abs(without_mean(rgb))[covered[..., 0] > 0.9].mean() < 0.12
