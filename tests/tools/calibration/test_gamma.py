"""Gamma of charts and what surrounds them: true whatever the file says, within its interval, refused where it is not determined."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from tests.data import photograph
from tests.tools.calibration.known_camera import BLIND, NOISE, REFERENCE, TRUTH, WIDTH, chart, frame, measured, true_place
from tests.tools.calibration.test_coverage import SIMPLE
from tools.calibration.chart_gamma import fit_chart_gamma, reconciled
from tools.calibration.gamma import GammaFit, NormalEquations, check_determined, combined, unknowns
from tools.calibration.measure import conclude
from tools.calibration.observations import Observations, measure_chart
from tools.calibration.report import report
from tools.calibration.samples import PlaceSamples, patch_samples
from tools.calibration.surroundings import fit_surroundings
from tools.simulation.drawn.builtin import builtin_scene
from tools.simulation.load import load_scene
from tools.simulation.sensor import simulate_additive, simulate_sensor

GAMMA = np.array(TRUTH.gamma)
SONY = "RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG"
TEXTURE = 0.004  # of gamma: what texture may make wrong, however many blocks a scene has


def places(colours: Any, gamma: Any, sigma: float, count: Any, seed: int, black: float = 0.0) -> PlaceSamples:
    """Made-up statistics: true channel levels (N, C), panchromatic levels by Eq. 7, Gaussian noise of the means."""
    rng = np.random.default_rng(seed)
    colours = np.asarray(colours, float)
    true = np.concatenate([colours, (colours @ np.asarray(gamma))[:, None] + black], axis=1)
    number = np.broadcast_to(np.asarray(count, float), true.shape)
    mean = true + rng.normal(0, sigma, true.shape) / np.sqrt(number)
    variance = sigma**2 * rng.chisquare(number - 1) / (number - 1)
    return PlaceSamples(mean, variance, number.copy(), np.zeros(len(true), bool))


def of_chart(samples: PlaceSamples) -> GammaFit:
    """Gamma of a chart, with black level and shading measured."""
    letters = "RGBCMY"[: samples.mean.shape[1] - 1]
    says = BLIND if letters == "RGB" else SensorCalibration.of_bits(12, channels=letters)
    return fit_chart_gamma(samples, says, measured(says))


def on_chart(mosaic: Mosaic) -> PlaceSamples:
    """Statistics of the patches of a chart at its known place."""
    return patch_samples(mosaic, true_place().measured())


def around(mosaic: Mosaic) -> GammaFit | None:
    """Gamma of a scene that has no chart to leave out, with black level and shading measured."""
    return fit_surroundings(mosaic, np.zeros(mosaic.shape, bool), np.zeros((1, 2)), measured(mosaic.calibration))


def off_by(fit: GammaFit, truth: Any = GAMMA) -> float:
    """The largest error of gamma, in half widths of its interval."""
    return float((np.abs(fit.gamma - truth) / fit.half_width).max())


@cache
def leaves() -> FloatArray:
    """The built-in scene, drawn once."""
    return builtin_scene(660, 440).rgb


def grey(rgb: FloatArray) -> FloatArray:
    return np.repeat(rgb.mean(axis=2, keepdims=True), 3, axis=2)


@pytest.mark.parametrize("tile", ["K=4", "K=6", "K=8", "WBWG/BWGW/WGWR/GWRW", SONY, "RG/BW"])
def test_gamma_of_a_chart_and_of_its_surroundings_is_the_truth_whatever_the_file_says(tile: str) -> None:
    pattern = CfaPattern.of_letters(tile, (1, 2))
    fit = of_chart(on_chart(frame(chart().rgb, pattern=pattern)))
    assert np.abs(fit.gamma - GAMMA).max() < 0.01
    assert off_by(fit) < 1.6
    assert 0.5 < fit.spread < 1.6
    assert abs(fit.black_deviation) < 4
    said = of_chart(on_chart(frame(chart().rgb, pattern=pattern, says=replace(BLIND, gamma=(3.0, 0.2, 1.0)))))
    np.testing.assert_allclose(said.gamma, fit.gamma, rtol=1e-5)
    scene = around(frame(leaves(), pattern=pattern))
    assert scene is not None
    assert np.abs(scene.gamma / GAMMA - 1).max() < 0.03
    assert off_by(scene) < 1.7
    assert (scene.half_width > 1.9 * TEXTURE * GAMMA).all()


def test_least_squares_would_come_out_too_small_and_this_does_not() -> None:
    rng = np.random.default_rng(0)
    colours = rng.uniform(0.05, 0.2, (400, 3))
    estimates, plain, covered = [], [], []
    for seed in range(60):
        noisy = places(colours, GAMMA, 0.06, (9, 18, 9, 300), seed)
        fit = of_chart(noisy)
        estimates.append(fit.gamma)
        covered.append(np.abs(fit.gamma - GAMMA) <= fit.half_width)
        plain.append(np.linalg.lstsq(noisy.mean[:, :3], noisy.mean[:, 3], rcond=None)[0])
    error = np.std(estimates, axis=0) / np.sqrt(60)
    assert (np.abs(np.mean(estimates, axis=0) - GAMMA) < 4 * error + 0.004).all()
    assert (np.abs(np.mean(plain, axis=0) - GAMMA).max()) > 0.02  # the tempting wrong way is seen to be wrong
    assert 0.86 < np.mean(covered) < 0.995


def test_any_number_of_channels() -> None:
    rng = np.random.default_rng(3)
    for gamma in ([0.7, 1.3], [0.5, 1.0, 0.8, 1.2, 0.6]):
        count = [50] * len(gamma) + [900]
        fit = of_chart(places(rng.uniform(0.02, 0.2, (40, len(gamma))), gamma, 0.005, count, 1))
        assert off_by(fit, gamma) < 1.7
        assert fit.worst < 0.03


def test_light_that_falls_off_across_patches_is_no_noise() -> None:
    samples = on_chart(frame(chart().rgb * np.linspace(1, 0.2, WIDTH)[:, None]))
    signal = samples.mean[:, 3] * GAMMA.sum()
    expected = (NOISE.shot[3] * signal + NOISE.read[3] ** 2) / GAMMA.sum() ** 2
    assert np.median(samples.variance[:, 3] / expected) == pytest.approx(1, abs=0.05)


def test_a_reflection_on_one_patch_is_left_out() -> None:
    samples = on_chart(frame(chart().rgb))
    mean = samples.mean.copy()
    mean[7, 3] *= 1.2
    fit = of_chart(replace(samples, mean=mean))
    assert not fit.used[7]
    assert fit.used.sum() >= 22
    assert np.abs(fit.gamma - GAMMA).max() < 0.01


def test_reconciled_levels_obey_equation_7_and_are_nearer_to_the_truth() -> None:
    colours = np.random.default_rng(5).uniform(0.02, 0.2, (200, 3))
    noisy = places(colours, GAMMA, 0.05, (9, 18, 9, 300), 2)
    better = reconciled(noisy, GAMMA)
    # Exact but for the panchromatic mean's own, far smaller, share of the blame.
    assert np.abs(better @ GAMMA - noisy.mean[:, 3]).max() < 0.1 * np.abs(noisy.mean[:, :3] @ GAMMA - noisy.mean[:, 3]).max()
    assert ((better - colours) ** 2).mean() < 0.8 * ((noisy.mean[:, :3] - colours) ** 2).mean()


def mixed() -> Mosaic:
    """A scene whose five channels are mixtures of three."""
    parts = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.5, 0.5], [0.5, 0.5, 0]]).T
    pattern = CfaPattern.of_letters("WRWG/BWCW/WYWG/GWWW", channels="RGBCY")
    camera = SensorCalibration.of_bits(12, headroom=False, channels="RGBCY")
    return simulate_sensor((leaves() @ parts).astype(np.float32), pattern, camera, 1.0, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("measure", "words"),
    [
        (lambda: check_determined(of_chart(on_chart(frame(grey(chart().rgb))))), "(?s)gamma.*shoot a ColorChecker"),
        (lambda: of_chart(on_chart(frame(8 * chart().rgb + 0.5))), "clipped.*expose less"),
    ],
)
def test_what_does_not_tell_gamma_is_refused_with_the_reason_and_a_remedy(measure: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        measure()


@pytest.mark.parametrize("shot", [lambda: frame(grey(leaves())), lambda: frame(leaves()[:60, :90]), mixed])
def test_surroundings_of_little_colour_do_not_count(shot: Callable[[], Mosaic]) -> None:
    assert around(shot()) is None


def made(gamma: Any, deviation: float) -> GammaFit:
    one, says = np.ones(1), SensorCalibration.of_bits(12, channels="RG")
    information = np.zeros((unknowns(np.zeros((1, 2)), None).size,) * 2)
    information[:2, :2] = np.eye(2) / deviation**2
    equations = NormalEquations(information, information[:, :2] @ np.array(gamma))
    return GammaFit(equations, measured(says), says, 50, one, one, one > 0, 2.0, 1.0, np.zeros((1, 2)))


def test_fits_add_up_by_their_information() -> None:
    both = combined([made([1.0, 2.0], 0.1), made([1.1, 2.0], 0.05)])
    np.testing.assert_allclose(both.gamma, [1.08, 2.0])
    np.testing.assert_allclose(np.diag(both.covariance), 0.1**2 * 0.05**2 / (0.1**2 + 0.05**2))
    quarrel = combined([made([1.0, 2.0], 0.1), made([3.0, 2.0], 0.1)])
    assert quarrel.half_width.max() > 1.0
    with pytest.raises(InputError, match="only known to be"):
        check_determined(quarrel)


def test_the_report_shows_the_blocks_around_a_chart_which_are_more_than_it_has_patches() -> None:
    scene = np.concatenate([chart().rgb, leaves()[: chart().shape[0]]], axis=1)
    taken = frame(scene)
    shot = measure_chart("leaves.dng", taken, REFERENCE, true_place().corners)
    page = report(conclude(Observations(taken, shots=[shot]), REFERENCE), {}).decode()
    assert page.count("leaves.dng, block: measured ") > 300
    assert page.count("leaves.dng, white: measured ") == 1


def test_gamma_of_a_small_chart_in_a_photograph_is_known_to_three_per_cent() -> None:
    """A fifth of the frame wide, beside the middle; nothing is known of black level and shading but what the shot states."""
    says, pattern = SensorCalibration.of_bits(12), CfaPattern.bayer(6)
    rgb = load_scene(str(photograph("raw/indoor1.dng"))).rgb
    taken = simulate_additive(rgb, pattern, says, 0.003, np.random.default_rng(0))
    fit = combined(measure_chart("indoor1.dng", Mosaic(taken.codes, pattern, says), REFERENCE).fits)
    assert np.abs(fit.gamma - 1).max() < 0.015
    assert fit.worst < 0.03


def test_a_chart_in_a_corner_tells_gamma_there_whatever_the_lens_does() -> None:
    """In the middle nothing measures gamma; an interval that covered this would be too wide to be of use."""
    falls = np.zeros((4, 4))
    falls[0, 0], falls[2, 0] = 0.1, -0.04
    camera = replace(SIMPLE, falls=falls)
    scene = np.full((800, 1200, 3), 0.35)
    scene[:400, :600] = chart().rgb
    fit = combined(measure_chart("corner.dng", camera.shot(scene, np.random.default_rng(2)), REFERENCE, true_place().corners).fits)
    there = SIMPLE.gamma / (1 - falls[:3, 0] * (fit.where**2).sum())
    assert np.abs(there / SIMPLE.gamma - 1).max() > 0.02
    assert (np.abs(fit.gamma - there) < 1.2 * fit.half_width).all()
    assert fit.worst < 0.02
