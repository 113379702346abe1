"""The covariance of errors at the sites of a block."""

import numpy as np
import pytest

from panchroma.shared import CfaPattern
from panchroma.shared.site_errors import error_correlation

PATTERNS = [
    CfaPattern.bayer(4, "GBRG"),
    CfaPattern.with_block(("RGB",), 5),
    CfaPattern.with_block(("RG", "WB"), 6),
]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_it_is_a_correlation(pattern: CfaPattern) -> None:
    matrix, measured = error_correlation(pattern)
    assert np.array_equal(matrix, matrix.T)
    assert np.allclose(np.diag(matrix), 1)
    assert np.linalg.eigvalsh(matrix).min() > 0
    channels = len(pattern.channels)
    assert measured == [
        site * channels + channel for site, (*_, channel) in enumerate(pattern.sites)
    ]
