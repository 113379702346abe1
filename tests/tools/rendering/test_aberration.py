"""A render undoes the lateral chromatic aberration that the calibration knows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from offline import BEST, PAPER, RenderSettings, render, render_bands
from offline.burst import Motion, merge_burst, render_burst_bands
from offline.kernels.aberration import undo_aberration
from offline.render import registered
from shared import Aberration, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.progress import SILENT
from shared.sensor import simulate_additive
from tests.benchmarks.aberration import figures
from tests.benchmarks.harness import photographed
from tests.reference.aberration import changes
from tools.camera.lens import lens_aberration, lens_shading
from tools.scenes.drawn.builtin import builtin_scene

SHAPE = (240, 360)
LENS = lens_aberration(1, -1, 3, SHAPE)
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
    shot = photographed(scene(), 0.01, aberration=LENS, shading=lens_shading(2, 0.15, 4, SHAPE))
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
