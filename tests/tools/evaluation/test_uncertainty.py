"""The weights of what foretells errors are found again, and errors of a kind count as is said."""

import numpy as np
import pytest

from offline.rows.uncertainty import WEIGHTS
from shared import CfaPattern, SensorCalibration
from shared.sensor import simulate_additive
from tests.tools.evaluation.examples import small_scene
from tools.evaluation.uncertainty import Errors, errors_of, fitted


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
