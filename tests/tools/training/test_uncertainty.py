"""The weights of what foretells errors are found again, and standard deviations are as large as the errors."""

import numpy as np

from tools.training.uncertainty import Errors, fitted, learn, scale


def test_the_weights_of_errors_that_have_some_are_found() -> None:
    random, weights = np.random.default_rng(0), np.array([0.5, 0.0, 2.0])
    foretold = random.exponential(1, (40000, 3)) ** 2
    errors = random.standard_t(4, 40000) * np.sqrt(foretold @ weights)
    np.testing.assert_allclose(fitted(errors, foretold), weights, atol=0.1)


def test_kinds_of_pictures_count_the_same_and_their_errors_lie_within() -> None:
    random = np.random.default_rng(0)
    groups = []
    for size, number in ((1.0, 20000), (1.0, 2000)):
        foretold = random.uniform(0.5, 2, (number, 2))
        groups.append([Errors(random.normal(0, size, number) * np.sqrt(foretold[:, 0]), foretold)])
    np.testing.assert_allclose(learn(groups), (1.0, 0.0), atol=0.1)
    assert abs(scale(random.normal(0, 1.2, 50000)) - 1.2) < 0.02
