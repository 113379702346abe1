"""Whether a picture that states how far it is off is taken at its word, and how what foretells errors is weighed."""

import numpy as np
import pytest

from offline import render
from offline.rows.uncertainty import WEIGHTS
from shared import CfaPattern, SensorCalibration
from shared.arrays import FloatArray
from shared.sensor import simulate_additive
from tests.data import photograph
from tests.tools.evaluation.examples import small_scene
from tools.evaluation.coverage import KINDS, area, coverage, foretold, histograms, kinds
from tools.evaluation.hue import wrong_hue
from tools.evaluation.measures import Measures
from tools.evaluation.uncertainty import Errors, errors_of, fitted
from tools.scenes.load import load_scene


def stating(truth: FloatArray, said: float) -> tuple[FloatArray, FloatArray]:
    """A picture off by normal errors, larger to the right, and `said` times their standard deviations."""
    random, size = np.random.default_rng(0), np.linspace(0.001, 0.1, truth.shape[1])[:, None]
    light, colour = random.normal(0, 1, truth.shape[:2]) * size[:, 0], random.normal(0, 1, truth.shape) * size
    colour -= colour.mean(axis=2, keepdims=True)
    sigma = np.concatenate(
        [np.broadcast_to(size, (*truth.shape[:2], 1)), np.broadcast_to(size * (2 / 3) ** 0.5, truth.shape)], axis=2
    )
    return (truth + colour + light[..., None] / 3).astype(np.float32), (said * sigma).astype(np.float32)


def test_normal_errors_lie_within_one_and_two_deviations_as_often_as_they_should() -> None:
    truth = np.full((300, 330, 3), 0.5, np.float32)
    for said, within in ((1.0, (0.683, 0.954)), (0.5, (0.383, 0.683))):
        found = coverage(*stating(truth, said)[:1], truth, stating(truth, said)[1]).sum(axis=1)
        np.testing.assert_allclose(found[:, :2] / found[:, 2:], [within] * 2, atol=0.01)


def test_what_is_measured_without_noise_does_not_count() -> None:
    truth = np.full((60, 60, 3), 0.5, np.float32)
    picture, sigma = stating(truth, 1.0)
    sigma[:30] = 0
    assert coverage(picture, truth, sigma)[0, 0, 2] == 30 // 2 * 30


def test_places_are_flat_edges_or_fine_colour() -> None:
    truth = np.full((40, 90, 3), 0.4, np.float32)
    truth[:, 30:45] = 0.7  # an edge of luminance
    truth[::2, 60:] = 0.2, 0.4, 0.6  # stripes of colour
    found = [KINDS[kinds(truth)[20, column]] for column in (10, 30, 75)]
    assert found == ["flat places", "edges", "fine colour"]


def test_larger_statements_foretell_wrong_hues() -> None:
    truth = small_scene(120, 126, 0)
    picture, sigma = stating(truth, 1.0)
    wrong = wrong_hue(picture, truth)
    score = foretold(picture, truth, sigma)
    found = area(histograms(score, wrong))
    order = np.argsort(np.argsort(score[np.isfinite(score)].ravel())) + 1.0
    count = np.count_nonzero(wrong), np.count_nonzero(~wrong)
    exact = (order[wrong.ravel()].sum() - count[0] * (count[0] + 1) / 2) / (count[0] * count[1])
    assert found == pytest.approx(exact, abs=0.01)
    assert exact > 0.75
    assert area(histograms(np.ones_like(score), wrong)) == pytest.approx(0.5)
    assert area(histograms(score, np.zeros_like(wrong))) is None


def test_measures_keep_what_was_stated_and_none_where_nothing_was() -> None:
    truth = small_scene(60, 66, 0)
    picture, sigma = stating(truth, 1.0)
    plain, full = Measures.of(picture, truth), Measures.of(np.concatenate([picture, sigma], axis=2), truth)
    assert not plain.covered.any()
    assert plain.quality == full.quality
    again = Measures.decode(full.encode())
    assert np.array_equal(again.covered, full.covered)
    assert again.covered[1].sum() > 0
    assert np.array_equal(again.doubts, full.doubts)


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
def test_it_is_true_of_photographs_that_it_was_not_learned_from(sigma: float) -> None:
    """Parts of three test photographs: more of them vary by less (`panchroma evaluate` shows all)."""
    counts = 0
    for name in ("linear/intel_tau_003.png", "linear/intel_tau_012.png", "raw/s40_pantone.crw"):
        scene = np.ascontiguousarray(load_scene(str(photograph(name))).rgb[:240, :240])
        mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), sigma, np.random.default_rng(0))
        found = render(mosaic, uncertainty=True)
        counts = counts + coverage(found.rgb, scene, found.uncertainty).sum(axis=1)
    within, twice, everything = np.moveaxis(np.asarray(counts), 1, 0)
    np.testing.assert_allclose(within / everything, 0.68, atol=0.08)
    np.testing.assert_allclose(twice / everything, 0.95, atol=0.08)


def test_the_weights_of_errors_that_have_some_are_found() -> None:
    random, weights = np.random.default_rng(0), np.array([0.5, 0.0, 2.0])
    foretold = random.exponential(1, (40000, 3)) ** 2
    errors = random.normal(0, 1, 40000) * np.sqrt(foretold @ weights)
    np.testing.assert_allclose(fitted(Errors(errors, foretold, np.zeros(40000, np.intp)), [1]), weights, atol=0.1)


def test_errors_of_long_tails_lie_within_as_often_as_they_should_by_both_shares() -> None:
    random, foretold = np.random.default_rng(0), np.ones((40000, 1))
    errors = random.standard_t(4, 40000)
    stated = fitted(Errors(errors, foretold, np.zeros(40000, np.intp)), [1])[0] ** 0.5
    within = [(np.abs(errors) <= times * stated).mean() for times in (1, 2)]
    assert 0.683 < within[0] < 0.73
    assert 0.91 < within[1] < 0.954


def test_kinds_count_as_is_said_however_many_errors_they_have() -> None:
    random, kinds = np.random.default_rng(0), np.repeat([0, 1], [20000, 2000])
    errors = random.normal(0, np.where(kinds, 2.0, 1.0))
    one = fitted(Errors(errors, np.ones((22000, 1)), kinds), [1, 1])
    few = np.r_[errors[:2000], errors[20000:]]
    same = fitted(Errors(few, np.ones((4000, 1)), np.repeat([0, 1], 2000)), [1, 1])
    np.testing.assert_allclose(one, same, rtol=0.1)
    assert fitted(Errors(errors, np.ones((22000, 1)), kinds), [10, 1]) < 0.8 * one


@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_what_a_render_states_is_the_weighted_sum_of_what_is_learned_from(sigma: float) -> None:
    scene = small_scene(90, 96, 0)
    shot = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), sigma, np.random.default_rng(0))
    luminance, colour = errors_of(shot, scene, 1.0, np.random.default_rng(0))
    assert colour.foretold.shape == (3 * 60 * 66, len(WEIGHTS[1]))
    assert len(luminance.errors) == len(luminance.foretold) == len(luminance.kinds)
    assert (len(luminance.errors) < len(colour.errors) / 3) == (sigma == 0)  # panchromatic samples are exact without noise
