from itertools import product

import numpy as np
import pytest

from panchroma.device.preview.border import ExtendedFrame
from panchroma.shared import CfaPattern
from panchroma.shared.arrays import CodeArray

MARGINS = (-13, 11), (-9, 14)


def extended(codes: CodeArray, pattern: CfaPattern) -> CodeArray:
    rows, columns = ((low, size + high) for (low, high), size in zip(MARGINS, codes.shape, strict=True))
    whole = np.empty((rows[1] - rows[0], columns[1] - columns[0]), np.uint16)
    ExtendedFrame(codes, pattern, rows, columns).copy_rows(rows[0], whole)
    return whole


PATTERNS = [
    CfaPattern.bayer(period, order, origin) for (period, order), origin in product([(6, "RGGB"), (3, "GBRG")], [(0, 0), (1, 2)])
]


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("shape", [(6, 6), (7, 40), (23, 17)])
def test_the_pattern_goes_on(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    """A frame of the filters' numbers is continued by the filters' numbers."""
    planes = pattern.filter_map(shape).astype(np.uint16)
    whole = extended(planes, pattern)
    assert np.array_equal(whole, pattern.filter_map((whole.shape[0], whole.shape[1]), (MARGINS[0][0], MARGINS[1][0])))


@pytest.mark.parametrize("shape", [(7, 40), (23, 17)])
def test_samples_repeat_their_place_in_the_tile(shape: tuple[int, int]) -> None:
    pattern, codes = CfaPattern.bayer(6, origin=(1, 2)), np.arange(shape[0] * shape[1], dtype=np.uint16).reshape(shape)
    whole = extended(codes, pattern)
    for place in np.ndindex(whole.shape):
        at = [index + low for index, (low, _) in zip(place, MARGINS, strict=True)]
        alike = [np.arange(each % 6, size, 6) for each, size in zip(at, shape, strict=True)]
        repeated = tuple(int(same[np.abs(same - each).argmin()]) for same, each in zip(alike, at, strict=True))
        assert whole[place] == codes[repeated]


def test_pieces_are_those_of_the_whole() -> None:
    pattern, codes = CfaPattern.bayer(6, origin=(2, 5)), np.arange(23 * 17, dtype=np.uint16).reshape(23, 17)
    whole = extended(codes, pattern)
    (above, below), (left, right) = MARGINS
    frame = ExtendedFrame(codes, pattern, (above, 23 + below), (left, 17 + right))
    for first, count in ((above, 14), (-3, 8), (0, 23), (5, 4), (15, 12), (20, 14)):
        piece = np.zeros((count, whole.shape[1]), np.uint16)
        frame.copy_rows(first, piece)
        assert np.array_equal(piece, whole[first - above : first - above + count]), (first, count)


@pytest.mark.parametrize("shape", [(2, 2), (2, 9), (9, 2), (3, 5)])
def test_a_frame_smaller_than_the_tile_takes_what_there_is(shape: tuple[int, int]) -> None:
    codes = np.arange(1, 1 + shape[0] * shape[1], dtype=np.uint16).reshape(shape)
    whole = extended(codes, CfaPattern.bayer(16))
    assert np.array_equal(whole[13 : 13 + shape[0], 9 : 9 + shape[1]], codes)
    assert np.isin(whole, codes).all()
