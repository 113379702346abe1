"""A JPEG that was joined from strips shows the pixels of one that was encoded as a whole."""

import imagecodecs
import numpy as np
import pytest

from shared.jpeg_check import read_header
from shared.jpeg_writing import ROWS, Subsampling, encode_strip, join_strips


@pytest.mark.parametrize("subsampling", ["444", "420"])
@pytest.mark.parametrize("shape", [(1, 1), (64, 33), (65, 16), (200, 70), (64 * 11 + 5, 9)])
def test_the_same_pixels(shape: tuple[int, int], subsampling: Subsampling) -> None:
    codes = np.random.default_rng(0).integers(0, 256, (*shape, 3), np.uint8)
    joined = join_strips([encode_strip(codes[top : top + ROWS], 90, subsampling) for top in range(0, shape[0], ROWS)])
    whole = imagecodecs.jpeg8_encode(codes, level=90, subsampling=subsampling)
    assert np.array_equal(imagecodecs.jpeg8_decode(joined), imagecodecs.jpeg8_decode(whole))
    header = read_header(joined)
    assert (header.rows, header.columns, header.scans) == (*shape, 1)
