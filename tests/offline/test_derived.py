"""A channel without a filter follows from the others by Eq. 7: in renders and previews, of shots
that clip, and in the white balance.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from panchroma.device import Preview
from panchroma.offline import BEST, PAPER, RenderSettings, render
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.shared.white_balance import estimate_neutral
from panchroma.tools.simulation.sensor import simulate_additive
from tests.scenes import leaves

GAMMA = {"RGB": (0.9, 1.1, 0.8), "RC": (0.9, 1.7)}
SCENE = leaves(96, 120)
TILES = ("rccb", "rccg", "rccc", "RWWB/WWWW/WWWW/WWWW")


def seen(scene: FloatArray, pattern: CfaPattern, sigma: float = 0.0) -> tuple[Mosaic, FloatArray]:
    """The shot of a scene, and what its channels see."""
    colours = scene
    if pattern.channels == "RC":
        colours = np.stack([scene[..., 0], scene[..., 1:].mean(axis=2)], axis=2)
    calibration = SensorCalibration.of_bits(
        12, channels=pattern.channels, gamma=GAMMA[pattern.channels]
    )
    random = np.random.default_rng(0)
    return simulate_additive(colours, pattern, calibration, sigma, random), colours


def clipped(
    scene: FloatArray, pattern: CfaPattern, neutral: tuple[float, ...] | None = None
) -> Mosaic:
    """The shot of a scene whose light is clipped at the white level."""
    mosaic, _ = seen(scene, pattern)
    samples = mosaic.codes.clip(0, mosaic.calibration.white_level)
    known = replace(mosaic.calibration, neutral=neutral)
    return replace(mosaic, samples=samples, calibration=known)


def psnr(one: NDArray[Any], other: FloatArray) -> float:
    return float(-10 * np.log10(np.mean(np.square(one - other))))


@pytest.mark.parametrize("letters", TILES)
@pytest.mark.parametrize("settings", [PAPER, BEST], ids=["paper", "best"])
def test_a_flat_colour_is_rendered_exactly(letters: str, settings: RenderSettings) -> None:
    pattern = CfaPattern.of_letters(letters, (1, 2))
    flat = np.broadcast_to(np.array([0.5, 0.3, 0.1], np.float32), SCENE.shape)
    mosaic, truth = seen(flat, pattern)
    rendering = render(mosaic, settings)
    assert rendering.rgb == pytest.approx(truth, abs=2e-3)
    gamma = np.array(mosaic.calibration.gamma)
    assert rendering.chromaticity @ gamma == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("letters", TILES)
def test_render_and_preview_show_the_colours_of_a_scene(letters: str) -> None:
    """Without what Eq. 7 tells of the missing channel, its error alone would be 15 dB."""
    pattern = CfaPattern.of_letters(letters)
    mosaic, truth = seen(SCENE, pattern, 0.01)
    assert psnr(render(mosaic).rgb, truth) > 28.5
    assert psnr(Preview(pattern, linear=True).run(mosaic), truth) > 28
    half = truth.reshape(48, 2, 60, 2, -1).mean(axis=(1, 3))
    assert psnr(Preview(pattern, 2, linear=True).run(mosaic), half) > 28


@pytest.mark.parametrize("letters", ["rccb", "rccg", "RWWB/WWWW/WWWW/WWWW"])
@pytest.mark.parametrize("exposure", [1.3, 2.0, 8.0])
def test_overexposed_white_is_white(letters: str, exposure: float) -> None:
    """As the light shows it: two channels read half of what the third one does."""
    pattern, neutral = CfaPattern.of_letters(letters), (0.6, 1.0, 0.5)
    white = np.full_like(SCENE, 0.2)
    white[30:70, 40:90] = exposure
    mosaic = clipped(white * np.array(neutral, np.float32), pattern, neutral)
    middle = (render(mosaic).rgb / np.array(neutral))[40:60, 50:80]
    assert middle.min() > 1.1
    assert np.ptp(middle, axis=2).max() < 0.1 * middle.min()
    preview = Preview(pattern).run(mosaic)
    assert preview[40:60, 50:80].min() > 250


@pytest.mark.parametrize("letters", ["rccb", "rccg"])
def test_a_thin_overexposed_line_has_no_colour_in_the_preview(letters: str) -> None:
    pattern = CfaPattern.of_letters(letters)
    line = np.full_like(SCENE, 0.1)
    line[np.abs(np.arange(96)[:, None] - np.arange(120) + 20) < 2] = 2.5
    picture = Preview(pattern).run(clipped(line, pattern, (1.0, 1.0, 1.0)))
    assert np.mean(np.ptp(picture.astype(int), axis=2) > 40) < 0.005


def test_overexposed_yellow_does_not_turn_red() -> None:
    """Where red clips and blue is dark, the missing green lies between them."""
    yellow = np.broadcast_to(np.array([4.0, 4.0, 0.3], np.float32), SCENE.shape)
    mosaic = clipped(yellow, CfaPattern.of_letters("rccb"))
    red, green, blue = np.median(render(mosaic).rgb, axis=(0, 1))
    assert green > 0.5 * red
    assert blue < 0.3 * red


@pytest.mark.parametrize("letters", TILES)
def test_white_balance_is_estimated_with_the_missing_channel(letters: str) -> None:
    tinted = SCENE.mean(axis=2, keepdims=True) * np.array([0.5, 1.0, 0.8], np.float32)
    neutral = estimate_neutral(seen(tinted, CfaPattern.of_letters(letters))[0])
    expected = (0.5, 1.0, 0.8) if len(neutral) == 3 else (0.5, 0.9)
    found, true = (np.array(white) / max(white) for white in (neutral, expected))
    assert found == pytest.approx(true, abs=0.06)


def test_white_balance_of_a_frame_without_clear_pixels_beside_a_block_is_unknown() -> None:
    mosaic, _ = seen(SCENE[:3, :3], CfaPattern.of_letters("RBWW/WWWW/WWWW/WWWW"))
    assert estimate_neutral(mosaic) is None


def test_the_preview_shows_no_colours_that_are_brighter_than_all_light() -> None:
    """A bright line through a site, whose block is dark otherwise, would make the missing channel
    as negative.
    """
    pattern = CfaPattern.of_letters("RWW/WWW/WWB")
    lines = np.full_like(SCENE, 0.02)
    lines[np.arange(0, 90), np.arange(0, 90)] = 1.0
    lines[np.arange(0, 90), np.arange(119, 29, -1)] = 1.0
    mosaic, _ = seen(lines, pattern)
    picture = Preview(pattern, linear=True).run(mosaic)
    assert picture.min() > -0.1
    assert picture.max() < 2.9


@pytest.mark.parametrize("letters", TILES)
def test_a_hot_colour_site_is_found_where_it_reads_more_than_all_light(letters: str) -> None:
    pattern = CfaPattern.of_letters(letters)
    even = np.broadcast_to(np.array([0.3, 0.2, 0.1], np.float32), SCENE.shape)
    mosaic, truth = seen(even, pattern, 0.01)
    (_, rows, columns), *_ = pattern.lattices
    samples = mosaic.samples.copy()
    samples[rows, columns][8, 8] = 2.0
    assert render(replace(mosaic, samples=samples)).rgb == pytest.approx(truth, abs=0.06)
