"""The covariance of errors at the sites of a block."""

import numpy as np
import pytest

from shared import CfaPattern
from shared.site_errors import error_correlation, nearness

PATTERNS = [
    CfaPattern.bayer(6),
    CfaPattern.bayer(4, "GBRG"),
    CfaPattern.with_block(("RGB",), 5),
    CfaPattern.with_block(("RG", "WB"), 6),
]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_it_is_a_correlation(pattern: CfaPattern) -> None:
    near = nearness(pattern)
    every, measured = error_correlation(pattern)
    assert near.shape == (len(pattern.sites),) * 2
    assert every.shape == (len(pattern.sites) * len(pattern.channels),) * 2
    for matrix in (near, every):
        assert np.array_equal(matrix, matrix.T)
        assert np.allclose(np.diag(matrix), 1)
        assert np.linalg.eigvalsh(matrix).min() > 0
    assert [index % len(pattern.channels) for index in measured] == [channel for _, _, channel in pattern.sites]
    assert [index // len(pattern.channels) for index in measured] == list(range(len(pattern.sites)))


def test_it_falls_with_distance_and_between_channels() -> None:
    every, measured = error_correlation(CfaPattern.bayer(6))
    red, first_green, second_green, blue = measured
    assert 1 > every[first_green, second_green] > every[red, first_green] > every[red, blue] > 0
