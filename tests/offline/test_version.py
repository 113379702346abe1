"""The number of the algorithm stands for its results: neither moves alone, or archives would keep
what they should make anew.
"""

import numpy as np
import pytest

from panchroma.offline.version import ALGORITHM
from tests.golden.render import PRESETS, Golden, now, saved

# Another compiler or processor rounds otherwise: 3e-7 without fused multiply-add
# (NUMBA_CPU_NAME=x86-64). A solver that stops at a residual of 1e-3 may also make one step more or
# less, and so may the 8 bits of the networks for colour. Largest, and RMS.
ROUNDING = {"paper": (1e-3, 2e-5), "best": (1e-2, 2e-4)}
REMEDY = (
    "the same shot gives another picture: raise ALGORITHM in offline/version.py, then "
    "python -m tests.golden.render"
)


@pytest.fixture(scope="module")
def made() -> Golden:
    return now()


def test_the_number_is_the_one_that_was_kept() -> None:
    assert saved().algorithm == ALGORITHM, REMEDY


@pytest.mark.parametrize("preset", PRESETS)
def test_the_picture_is_the_one_that_was_kept(made: Golden, preset: str) -> None:
    """Within rounding on any machine; to the bit where the same compiler made it for the same
    processor.
    """
    difference = made.pictures[preset].astype(np.float64) - saved().pictures[preset]
    most, most_rms = ROUNDING[preset]
    assert np.abs(difference).max() < most, REMEDY
    assert np.sqrt(np.mean(difference**2)) < most_rms, REMEDY
    if made.made_by == saved().made_by:
        assert made.digests[preset] == saved().digests[preset], REMEDY
