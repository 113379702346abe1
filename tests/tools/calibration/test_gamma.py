"""Gamma of charts: true whatever the file says, within its interval, refused where it is not
determined.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from panchroma.shared import CfaPattern, InputError, Mosaic, SensorCalibration
from panchroma.tools.calibration.gamma import (
    Assumed,
    GammaFit,
    combined,
    fit_gamma,
    reconciled,
    with_surroundings,
)
from panchroma.tools.calibration.measure import Measurements, measure_chart
from panchroma.tools.calibration.places import PlaceSamples, patch_samples
from tests.tools.calibration.known_camera import (
    BLIND,
    NOISE,
    REFERENCE,
    TRUTH,
    WIDTH,
    chart,
    frame,
    shot_of,
    true_place,
)
from tests.tools.calibration.test_coverage import SIMPLE

GAMMA = np.array(TRUTH.gamma)
SONY = "RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG"
COLOURS = np.random.default_rng(0).uniform(0.05, 0.2, (400, 3))
COUNT = (9, 18, 9, 300)


def places(colours: Any, gamma: Any, sigma: float, count: Any, seed: int) -> PlaceSamples:
    """Made-up statistics: true channel levels (N, C), panchromatic levels by Eq. 7, Gaussian noise
    of the means.
    """
    rng = np.random.default_rng(seed)
    true = np.concatenate([colours, (colours @ np.asarray(gamma))[:, None]], axis=1)
    number = np.broadcast_to(np.asarray(count, float), true.shape)
    mean = true + rng.normal(0, sigma, true.shape) / np.sqrt(number)
    variance = sigma**2 * rng.chisquare(number - 1) / (number - 1)
    clipped, where = np.zeros(len(true), bool), np.zeros((len(true), 2))
    dimming = np.zeros_like(mean[:, :-1])
    return PlaceSamples(mean, variance, number.copy(), clipped, where, dimming)


def of_chart(samples: PlaceSamples) -> GammaFit:
    """Gamma of a chart, with black level and shading measured."""
    letters = "RGBCMY"[: samples.mean.shape[1] - 1]
    says = BLIND if letters == "RGB" else SensorCalibration.of_bits(12, channels=letters)
    errors = [0.01] * (len(letters) + 1)
    known = {"black_level": {"standard_error": errors}, "shading": {}}
    return fit_gamma(samples, Assumed(says, None, known))


def on_chart(mosaic: Mosaic) -> PlaceSamples:
    """Statistics of the patches of a chart at its known place."""
    return patch_samples(mosaic, true_place().measured())


def off_by(fit: GammaFit, truth: Any = GAMMA) -> float:
    """The largest error of gamma, in half widths of its interval."""
    return float((np.abs(fit.gamma - truth) / fit.half_width).max())


@pytest.mark.parametrize("tile", ["K=4", "K=6", "K=8", "WBWG/BWGW/WGWR/GWRW", SONY, "RG/BW"])
def test_gamma_of_a_chart_is_the_truth_whatever_the_file_says(tile: str) -> None:
    pattern = CfaPattern.of_letters(tile, (1, 2))
    fit = of_chart(on_chart(frame(chart().rgb, pattern=pattern)))
    assert np.abs(fit.gamma - GAMMA).max() < 0.01
    assert off_by(fit) < 1.6
    assert 0.5 < fit.spread < 1.6
    assert abs(fit.black_deviation) < 4
    says = replace(BLIND, gamma=(3.0, 0.2, 1.0))
    said = of_chart(on_chart(frame(chart().rgb, pattern=pattern, says=says)))
    np.testing.assert_allclose(said.gamma, fit.gamma, rtol=1e-5)


def test_least_squares_would_come_out_too_small_and_this_does_not() -> None:
    noisy = [places(COLOURS, GAMMA, 0.06, COUNT, seed) for seed in range(60)]
    fits = list(map(of_chart, noisy))
    estimates = np.array([fit.gamma for fit in fits])
    error = np.std(estimates, axis=0) / np.sqrt(60)
    assert (np.abs(estimates.mean(axis=0) - GAMMA) < 4 * error + 0.004).all()
    plain = [np.linalg.lstsq(made.mean[:, :3], made.mean[:, 3])[0] for made in noisy]
    # the tempting wrong way is seen to be wrong
    assert np.abs(np.mean(plain, axis=0) - GAMMA).max() > 0.02
    assert 0.86 < np.mean([np.abs(fit.gamma - GAMMA) <= fit.half_width for fit in fits]) < 0.995


@pytest.mark.parametrize("gamma", [[0.7, 1.3], [0.5, 1.0, 0.8, 1.2, 0.6]])
def test_any_number_of_channels(gamma: list[float]) -> None:
    colours = np.random.default_rng(3).uniform(0.02, 0.2, (40, len(gamma)))
    fit = of_chart(places(colours, gamma, 0.005, [50] * len(gamma) + [900], 1))
    assert off_by(fit, gamma) < 1.7
    assert fit.worst < 0.03


def test_light_that_falls_off_across_patches_is_no_noise() -> None:
    samples = on_chart(frame(chart().rgb * np.linspace(1, 0.2, WIDTH)[:, None]))
    signal = samples.mean[:, 3] * GAMMA.sum()
    expected = (NOISE.shot[3] * signal + NOISE.read[3] ** 2) / GAMMA.sum() ** 2
    assert np.median(samples.variance[:, 3] / expected) == pytest.approx(1, abs=0.05)


def test_a_reflection_on_one_patch_is_left_out() -> None:
    samples = on_chart(frame(chart().rgb))
    samples.mean[7, 3] *= 1.2
    fit = of_chart(samples)
    assert not fit.used[7]
    assert fit.used.sum() >= 22
    assert np.abs(fit.gamma - GAMMA).max() < 0.01


def test_reconciled_levels_obey_equation_7_and_are_nearer_to_the_truth() -> None:
    noisy = places(COLOURS, GAMMA, 0.05, COUNT, 2)
    better = reconciled(noisy, GAMMA)
    # Exact but for the panchromatic mean's own, far smaller, share of the blame.
    before, white = noisy.mean[:, :3], noisy.mean[:, 3]
    assert np.abs(better @ GAMMA - white).max() < 0.1 * np.abs(before @ GAMMA - white).max()
    assert ((better - COLOURS) ** 2).mean() < 0.8 * ((before - COLOURS) ** 2).mean()


def test_what_does_not_tell_gamma_is_refused_with_the_reason_and_a_remedy() -> None:
    grey = np.repeat(chart().rgb.mean(axis=2, keepdims=True), 3, axis=2)
    with pytest.raises(InputError, match=r"(?s)gamma.*shoot a ColorChecker"):
        of_chart(on_chart(frame(grey)))
    with pytest.raises(InputError, match=r"not clipped.*change the exposure"):
        of_chart(on_chart(frame(8 * chart().rgb + 0.5)))


def test_even_areas_around_a_small_chart_in_a_photograph_halve_the_interval_of_gamma() -> None:
    """A fifth of the frame wide, beside the middle; nothing is known of black level and shading but
    what the shot states. The patches alone tell gamma to 4.8 %.
    """
    shot = measure_chart("indoor1.dng", shot_of("raw/indoor1.dng", 6), Measurements(REFERENCE))
    fit = shot.fit
    assert np.abs(fit.gamma - 1).max() < 0.014
    assert fit.worst < 0.026
    assert fit.around > 100
    assert len(fit.used) == len(fit.predicted) == len(shot.places.mean) == 24


@pytest.mark.parametrize("seed", range(4))
def test_areas_of_one_grey_do_not_vouch_for_patches_that_differ_from_eq_7(seed: int) -> None:
    random = np.random.default_rng(seed)
    patches = places(random.uniform(0.05, 0.6, (24, 3)), GAMMA, 1e-3, 200, seed)
    around = places(np.full((120, 3), 0.3), GAMMA, 1e-3, 200, seed)
    patches.mean[:, -1] *= 1 + random.normal(0, 0.01, 24)
    fit = with_surroundings(of_chart(patches), patches, around)
    assert (fit.around, combined([fit, replace(fit, around=7)]).around) == (0, 7)
    assert (np.abs(fit.gamma - GAMMA) < 1.3 * fit.half_width).all()


def test_a_chart_in_a_corner_tells_gamma_there_whatever_the_lens_does() -> None:
    """In the middle nothing measures gamma; an interval that covered this would be too wide to be
    of use.
    """
    falls = np.zeros((4, 4))
    falls[0, 0], falls[2, 0] = 0.1, -0.04
    camera = replace(SIMPLE, falls=falls)
    scene = np.full((800, 1200, 3), 0.35)
    scene[:400, :600] = chart().rgb
    taken = camera.shot(scene, np.random.default_rng(2))
    fit = measure_chart("corner.dng", taken, Measurements(REFERENCE), true_place().corners).fit
    there = SIMPLE.gamma / (1 - falls[:3, 0] * (fit.where**2).sum())
    assert np.abs(there / SIMPLE.gamma - 1).max() > 0.02
    assert (np.abs(fit.gamma - there) < 1.2 * fit.half_width).all()
    assert fit.worst < 0.02
