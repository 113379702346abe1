"""A render undoes the lens that the calibration knows: lateral chromatic aberration, and shading of light and colour."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from offline import BEST, PAPER, RenderSettings, render, render_bands
from offline.burst import Motion, merge_burst, render_burst_bands
from offline.kernels.aberration import undo_aberration
from offline.render import registered
from shared import Aberration, CfaPattern, Mosaic, SensorCalibration, Shading
from shared.arrays import FloatArray
from shared.progress import SILENT
from shared.sensor import simulate_additive, simulate_sensor
from tests.benchmarks.aberration import figures
from tests.benchmarks.harness import photographed
from tests.benchmarks.shading import figures as figures_of_shading
from tests.benchmarks.shading import noisy
from tests.reference.aberration import changes
from tools.camera.lens import lens_aberration, lens_shading
from tools.scenes.drawn.builtin import builtin_scene

SHAPE = (240, 360)
LENS = lens_aberration(1, -1, 3, SHAPE)
DARK = lens_shading(2, 0.15, 4, SHAPE)
MEDIAN = 1  # which of the figures: chrominance of patches


@cache
def scene() -> FloatArray:
    return builtin_scene(SHAPE[1], SHAPE[0]).rgb


@pytest.mark.parametrize("first", [0, 3])
def test_samples_change_as_an_independent_transcription_says(first: int) -> None:
    pattern, lens = CfaPattern.bayer(4, origin=(1, 2)), lens_aberration(0.7, -0.5, 3, (20, 26))
    rgb, gamma = np.random.default_rng(0).uniform(0, 1, (20, 26, 3)).astype(np.float32), (0.9, 1.1, 0.8)
    samples = np.zeros((20 - 2 * first, 26), np.float32)
    undo_aberration(rgb, 0, 20, np.array(lens.radial), np.array(gamma, np.float32), pattern.filter_map((4, 4)), first, samples)
    np.testing.assert_allclose(samples, changes(rgb.astype(float), pattern, gamma, lens)[first : 20 - first], atol=1e-5)


@pytest.mark.parametrize("settings", [BEST, PAPER])
@pytest.mark.parametrize("sigma", [0.0, 0.01])
def test_more_than_half_of_the_lost_chrominance_comes_back(settings: RenderSettings, sigma: float) -> None:
    shots = photographed(scene(), sigma), *known_and_unknown(scene(), sigma, LENS)
    without, unknown, undone = (figures(render(shot, settings).rgb, scene())[MEDIAN] for shot in shots)
    assert undone - unknown > 0.5 * (without - unknown) > 0.05


def known_and_unknown(rgb: FloatArray, sigma: float, lens: Aberration) -> tuple[Mosaic, Mosaic]:
    """A shot that knows nothing of its lens, and the same one that does."""
    shot = photographed(rgb, sigma, aberration=lens)
    return replace(shot, calibration=replace(shot.calibration, aberration=None)), shot


def test_a_lens_without_it_changes_no_bit() -> None:
    none = Aberration([(0, 0)] * 3, SHAPE)  # type: ignore[arg-type]
    unknown, known = known_and_unknown(scene(), 0.01, none)
    assert np.array_equal(unknown.codes, known.codes)
    assert np.array_equal(render(known).rgb, render(unknown).rgb)


def test_bands_are_the_picture() -> None:
    shot = photographed(scene(), 0.01, aberration=LENS, shading=DARK)
    assert np.array_equal(np.concatenate(list(render_bands(shot))), render(shot).rgb)


def test_shading_is_undone_too() -> None:
    shaded = replace(SensorCalibration.of_bits(16), shading=lens_shading(1.5, 0.1, 4, SHAPE), aberration=LENS)
    shot = simulate_additive(scene(), CfaPattern.bayer(6), shaded, 0.0, np.random.default_rng(0))
    both, one = (figures(render(each).rgb, scene()) for each in (shot, photographed(scene(), 0.0, aberration=LENS)))
    assert min(np.subtract(both, one)) > -0.3  # dB


def test_what_is_saturated_stays_so() -> None:
    rgb = np.full((*SHAPE, 3), 0.2, np.float32)
    rgb[20:60, 20:60] = 1.6  # panchromatic samples are saturated there, those of colour are not
    sensor = SensorCalibration.of_bits(12, headroom=False, aberration=LENS)
    shot = simulate_additive(rgb, CfaPattern.bayer(6), sensor, 0.0, np.random.default_rng(0))
    picture = render(Mosaic(shot.codes, shot.pattern, shot.calibration)).rgb
    assert picture[26:54, 26:54] == pytest.approx(1.6, rel=0.02)


def test_dark_samples_beside_bright_ones_become_no_black_dots() -> None:
    rgb = np.where(np.random.default_rng(0).random((*SHAPE, 1)) < 0.5, 0.9, 0.05).astype(np.float32).repeat(3, axis=2)
    shot = photographed(rgb, 0.0, aberration=LENS)
    assert (registered(shot, BEST, SILENT).signal >= np.minimum(shot.signal, 0.499 * shot.signal)).all()


def test_frames_of_a_burst_lose_it() -> None:
    shots = [photographed(np.roll(scene(), (step, -step), (0, 1)), 0.01, step, aberration=LENS) for step in range(3)]
    motions = [Motion((float(step), float(-step))) for step in range(3)]

    def seen(frames: list[Mosaic]) -> list[float]:
        bands = render_burst_bands(merge_burst(frames, reference=0, motions=motions))
        return figures(np.concatenate(list(bands)), scene())

    unknown = seen([replace(shot, calibration=replace(shot.calibration, aberration=None)) for shot in shots])
    assert seen(shots)[MEDIAN] - unknown[MEDIAN] > 0.3  # dB


def seen(mosaic: Mosaic, settings: RenderSettings = BEST) -> list[float]:
    return figures_of_shading(render(mosaic, settings).rgb, scene())


@pytest.mark.parametrize("settings", [BEST, PAPER])
def test_corners_are_those_of_a_render_without_shading(settings: RenderSettings) -> None:
    even, undone = seen(photographed(scene(), 0.0), settings), seen(photographed(scene(), 0.0, shading=DARK), settings)
    assert min(np.subtract(undone[:3], even[:3])) > -0.3  # dB
    assert undone[3] - even[3] < 0.2  # dE2000


def test_noise_in_the_corners_is_that_of_the_gain() -> None:
    amplified, undone = seen(noisy(scene(), 0.01, DARK)), seen(photographed(scene(), 0.01, shading=DARK))
    assert min(np.subtract(undone[:3], amplified[:3])) > -0.5


def white(light: float, shading: Shading | None) -> FloatArray:
    """A render of a warm white surface on grey, near a corner, by a sensor that clips."""
    rgb = np.full((*SHAPE, 3), 0.3, np.float32)
    rgb[30:90, 30:90] = np.array([1.0, 0.8, 0.6], np.float32) * light
    sensor = SensorCalibration.of_bits(12, headroom=False, neutral=(1.0, 0.8, 0.6), shading=shading)
    return render(simulate_sensor(rgb, CfaPattern.bayer(6), sensor, 1.0, np.random.default_rng(0))).rgb[45:75, 45:75]


def test_saturation_is_judged_before_the_gain() -> None:
    # Twice full scale, and no sample of it is saturated: there is nothing to restore.
    assert white(2.0, DARK).mean(axis=(0, 1)) == pytest.approx([2.0, 1.6, 1.2], rel=0.02)
    # Panchromatic samples are saturated, and the blocks tell how bright the surface is.
    assert white(3.5, DARK).mean(axis=(0, 1)) == pytest.approx([3.5, 2.8, 2.1], rel=0.03)
    assert white(1.6, None).mean(axis=(0, 1)) == pytest.approx([1.6, 1.28, 0.96], rel=0.05)


def test_scene_units_render_as_codes_do() -> None:
    shot = simulate_additive(
        scene(), CfaPattern.bayer(6), SensorCalibration.of_bits(16, shading=DARK), 0.0, np.random.default_rng(0)
    )
    codes = replace(shot, samples=shot.codes)
    apart = np.abs(render(shot, PAPER).rgb - render(codes, PAPER).rgb)
    assert np.quantile(apart, 0.99) < 0.005
