"""Clipped panchromatic samples: highlights come back as far as colour samples reach, and end in
white.
"""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, render
from panchroma.offline.numerics.interpolation import interpolate
from panchroma.offline.stages.highlights import clipping_level, restore_highlights
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.sensor import simulate_sensor
from tests.offline.scenes import cleaned, every_case, gamma_of, materials
from tests.scenes import darker_corners

NEUTRAL = (0.5, 1.0, 0.6)
LIMIT = 3.0
SPARSE = (*map(CfaPattern.bayer, (4, 6, 8)), CfaPattern.of_letters("kodak"))


def exposed(
    scene: FloatArray, neutral: tuple[float, ...] | None = NEUTRAL, pattern: CfaPattern = SPARSE[1]
) -> Mosaic:
    """Sensor codes of a scene, clipped at full scale."""
    calibration = SensorCalibration.of_bits(12, headroom=False, neutral=neutral)
    light, random = scene.astype(np.float32), np.random.default_rng(0)
    return simulate_sensor(light, pattern, calibration, 1.0, random)


def lamp(peak: float, colour: tuple[float, ...]) -> FloatArray:
    """A soft light on a dim wall; its luminance at the middle is `peak` scene units."""
    row, column = np.indices((72, 78))
    light = 0.5 + (peak - 0.5) * np.exp(-((row - 36) ** 2 + (column - 39) ** 2) / (2 * 14**2))
    return (light[..., None] * np.array(colour) / sum(colour)).astype(np.float32)


def spark(pattern: CfaPattern, colour: tuple[float, ...]) -> tuple[Mosaic, tuple[slice, slice]]:
    """A grey wall with a highlight of 3 x 3 pixels between its blocks, far beyond the limit; and
    where it is.
    """
    scene = np.full((48, 54, 3), 0.25) * np.array(NEUTRAL)
    middle = [
        origin + size + (pattern.period - size - 3) // 2
        for origin, size in zip(pattern.block_origin, pattern.block_shape, strict=True)
    ]
    first = [start % pattern.period + 24 // pattern.period * pattern.period for start in middle]
    place = slice(first[0], first[0] + 3), slice(first[1], first[1] + 3)
    scene[place] = np.array(colour) * 6
    return exposed(scene, pattern=pattern), place


def pictures(mosaic: Mosaic, stops: float) -> tuple[FloatArray, FloatArray]:
    """The picture to look at, and as it would be if no light counted as lost."""
    rendering, display = render(mosaic, BEST), ColourTransform.to_space(mosaic.calibration)
    return display.apply(
        display.whitened(rendering.rgb, rendering.lost, stops), stops
    ), display.apply(rendering.rgb, stops)


@pytest.mark.parametrize("colour", [0.0, 0.3])
def test_burnt_light_is_white_and_lost_where_filters_are_shaded_differently(colour: float) -> None:
    shape = 120, 180
    lens = darker_corners(shape, colour=colour)
    camera = SensorCalibration.of_bits(12, headroom=False, neutral=NEUTRAL, shading=lens)
    scene = np.full((*shape, 3), 0.2, np.float32)
    corner, inside = np.s_[4:40, 4:40], np.s_[9:35, 9:35]
    scene[corner] = np.array(NEUTRAL) * 40
    taken = simulate_sensor(scene, SPARSE[1], camera, 1.0, np.random.default_rng(0))
    rendering = render(taken, BEST)
    white = rendering.rgb[inside] / NEUTRAL
    assert white.min() > 3
    assert np.abs(white / white.mean(axis=2, keepdims=True) - 1).max() < 0.01
    assert rendering.lost is not None
    assert np.median(rendering.lost[inside]) == 255


@pytest.mark.parametrize("colour", [NEUTRAL, (0.9, 0.7, 0.4)])
def test_a_highlight_comes_back_to_the_limit_of_the_colour_samples(
    colour: tuple[float, ...],
) -> None:
    scene = lamp(0.9 * LIMIT * sum(colour) / max(colour), colour)
    mosaic, clipped = exposed(scene), scene.sum(axis=2) > LIMIT
    restored = render(mosaic, BEST).rgb
    assert clipped.mean() > 0.05
    assert restored[clipped].max() > 0.95 * scene.max()
    assert np.sqrt(np.mean((restored - scene)[clipped] ** 2)) < 0.03
    assert np.sqrt(np.mean((render(mosaic, PAPER).rgb - scene)[clipped] ** 2)) > 0.2


def test_past_all_limits_it_is_white_and_grows_smoothly() -> None:
    """The wall is white and the light far too strong: hue stays white, and luminance has no dip on
    the way up.
    """
    restored = render(exposed(lamp(12.0, NEUTRAL)), BEST).rgb / np.array(NEUTRAL)
    assert (restored.max(axis=2) / restored.min(axis=2))[6:-6, 6:-6].max() < 1.15
    line = restored[36, 8:40].mean(axis=1)
    assert np.diff(line).min() > -0.12
    assert line.max() > 0.93 * LIMIT / min(NEUTRAL)
    everywhere = render(exposed(np.full((24, 24, 3), 9.0)), BEST).rgb
    assert np.allclose(everywhere / np.array(NEUTRAL), LIMIT / min(NEUTRAL), rtol=0.01)


def test_an_edge_beside_a_highlight_stays_sharp() -> None:
    """Dark blocks beside a clipped surface do not pull its rim down, nor it theirs up."""
    scene = np.full((60, 60, 3), 0.05, np.float32)
    scene[:, 31:] = np.array(NEUTRAL) * 2.5
    wrong = np.abs(render(exposed(scene), BEST).luminance - scene.sum(axis=2))
    assert wrong[:, 34:].max() < 0.12
    assert wrong[:, :29].max() < 0.12


def test_what_is_not_clipped_is_not_touched() -> None:
    mosaic = exposed(lamp(12.0, NEUTRAL))
    clipping = clipping_level(mosaic)
    restored = restore_highlights(cleaned(mosaic, clipping), BEST.highlights)
    panchromatic = mosaic.pattern.panchromatic_mask(mosaic.shape)
    changed = restored.signal != mosaic.signal
    assert (mosaic.signal[changed & panchromatic] >= clipping).all()
    assert (restored.signal >= mosaic.signal).all()
    least = 0.9 * (1 - BEST.highlights.shoulder) * clipping
    assert (mosaic.signal[changed & ~panchromatic] > least).all()
    assert restore_highlights(cleaned(mosaic, clipping), PAPER.highlights).mosaic is mosaic


def test_samples_without_a_limit_are_not_clipped() -> None:
    mosaic = exposed(lamp(12.0, NEUTRAL))
    floating = Mosaic(mosaic.signal, mosaic.pattern, mosaic.calibration)
    assert clipping_level(floating) == np.inf
    assert restore_highlights(cleaned(floating), BEST.highlights).mosaic is floating
    white, below = (np.full(mosaic.shape, code, np.uint16) for code in (4095, 4094))
    assert Mosaic(white, mosaic.pattern, mosaic.calibration).signal.min() >= clipping_level(mosaic)
    assert Mosaic(below, mosaic.pattern, mosaic.calibration).signal.max() < clipping_level(mosaic)


def test_saturation_below_the_white_level_is_where_samples_pile_up() -> None:
    """In noise, with some brighter hot pixels; and not in what is even or has gaps of codes."""
    ramp = np.broadcast_to(np.linspace(0.05, 1.6, 400)[:, None], (300, 400, 3))
    mosaic = exposed(ramp.astype(np.float32))
    noise, scale = mosaic.calibration.noise, mosaic.calibration.scale()[-1]
    hot = np.random.default_rng(1).random(mosaic.shape) < 3e-4
    for end in (4091, 3000):
        cut = np.where(hot, 4095, np.minimum(mosaic.codes, end)).astype(np.uint16)
        found = clipping_level(replace(mosaic, samples=cut), noise)
        assert found == pytest.approx(LIMIT - (4095 - end + 0.5) * scale)
        assert clipping_level(replace(mosaic, samples=cut)) == clipping_level(mosaic)
    even = exposed(np.full((300, 400, 3), 0.9, np.float32))
    coarse = replace(mosaic, samples=np.minimum(mosaic.codes, 3500) // 4 * np.uint16(4))
    gaps = replace(coarse, samples=np.where(coarse.codes == coarse.codes.max(), 0, coarse.codes))
    for other in (mosaic, even, gaps):
        assert clipping_level(other, noise) == clipping_level(other)
    assert clipping_level(coarse, noise) < LIMIT - 500 * scale


@every_case
def test_any_pattern_and_number_of_channels(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    channels = len(pattern.channels)
    calibration = SensorCalibration.of_bits(
        12, headroom=False, channels=pattern.channels, gamma=gamma_of(pattern)
    )
    off, wrong, clipped = replace(BEST, highlights=PAPER.highlights), np.zeros(2), 0
    for seed in range(4):
        scene = materials(shape, channels, seed).astype(np.float32)
        mosaic = simulate_sensor(scene, pattern, calibration, 1.8, np.random.default_rng(0))
        clipped += int((mosaic.signal >= clipping_level(mosaic)).sum())
        wrong += [np.square(render(mosaic, s).rgb - 1.8 * scene).mean() for s in (BEST, off)]
    assert clipped
    assert wrong[0] < 1.06 * wrong[1]


def test_without_a_known_neutral_white_is_equal_readings() -> None:
    mosaic = exposed(lamp(12.0, (1.0, 1.0, 1.0)), None)
    same = replace(mosaic, calibration=replace(mosaic.calibration, neutral=(1.0, 1.0, 1.0)))
    assert np.array_equal(render(mosaic, BEST).rgb, render(same, BEST).rgb)


@pytest.mark.parametrize("stops", [0, -4])
@pytest.mark.parametrize("colour", [NEUTRAL, (0.9, 0.5, 0.3)])
@pytest.mark.parametrize("pattern", SPARSE)
def test_a_highlight_between_blocks_is_lost_and_shown_white(
    pattern: CfaPattern, colour: tuple[float, ...], stops: float
) -> None:
    mosaic, place = spark(pattern, colour)
    picture, plain = pictures(mosaic, stops)
    assert picture[place[0].start + 1, place[1].start + 1].min() > 0.999
    assert np.median(picture[place]) > 0.98
    around = (picture == plain).all(axis=2)
    assert around.mean() > 0.98


@pytest.mark.parametrize("peak", [3.2, 4.0, 5.5, 12.0])
@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_a_restored_gradient_is_not_lost(peak: float, sigma: float) -> None:
    """No contour in it, nor at its rim, where it passes the limit."""
    scene = lamp(peak, (0.9, 0.7, 0.4))
    scene += np.random.default_rng(3).normal(0, sigma, (*scene.shape[:2], 1)).astype(np.float32)
    picture, plain = pictures(exposed(scene), -2)
    assert np.abs(picture - plain).max() < 0.03


def test_sky_behind_twigs_is_not_lost() -> None:
    """One hides blocks, so that clipped samples lie only between them; others run beside."""
    scene = np.full((72, 78, 3), 1.7) * np.array(NEUTRAL)
    first = 36 + SPARSE[1].block_origin[1] - 1
    scene[:, [first - 6, *range(first, first + 4), first + 9]] = 0.05
    lost = render(exposed(scene), BEST).lost
    assert lost is not None
    assert not lost.any()


def test_the_rim_of_a_burnt_out_window_is_white() -> None:
    """Beside the dark it lies between blocks of which one is burnt out and the other dark, and had
    the colour of neither.
    """
    scene = np.full((72, 78, 3), (0.5, 0.02, 0.02))
    scene[:, 31:] = np.array(NEUTRAL) * 20
    picture, plain = pictures(exposed(scene), -2)
    assert picture[:, 31:].min() > 0.97
    assert plain[:, 31:].min() < 0.92
    assert np.array_equal(picture[:, :28], plain[:, :28])


def test_nothing_is_lost_where_nothing_is_clipped_or_restored() -> None:
    mosaic, _ = spark(CfaPattern.bayer(), NEUTRAL)
    hot = exposed(np.full((48, 54, 3), 0.2)).codes.copy()
    hot[20, 23] = 4095  # a defect is mended, and no lost light
    assert render(mosaic, PAPER).lost is None
    assert render(Mosaic(mosaic.signal, mosaic.pattern, mosaic.calibration), BEST).lost is None
    assert render(exposed(lamp(2.0, NEUTRAL)), BEST).lost is None
    assert render(Mosaic(hot, mosaic.pattern, mosaic.calibration), BEST).lost is None


def test_interpolation_keeps_parabolas() -> None:
    """Cubic convolution is exact for them, away from the outermost samples."""
    row, column = (places.astype(np.float64) for places in np.indices((60, 66)))
    expected = 1 + row / 30 + (column / 40) ** 2 - row * column / 3000
    plane = np.empty((60, 66), np.float32)
    interpolate(np.ascontiguousarray(expected[2::6, 3::6], np.float32), (2.0, 3.0), 6, plane)
    assert np.abs(plane - expected)[8:-10, 9:-9].max() < 1e-5
