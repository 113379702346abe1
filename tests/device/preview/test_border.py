import numpy as np
import pytest

from panchroma.device.preview.border import copy_extended

MARGINS = (-13, 11), (-9, 14)


@pytest.mark.parametrize("period", [6, 16])
@pytest.mark.parametrize("shape", [(7, 40), (23, 17), (2, 9), (3, 5)])
def test_samples_repeat_their_place_in_the_tile_as_far_as_the_frame_has_it(
    shape: tuple[int, int], period: int
) -> None:
    codes = np.arange(1, 1 + shape[0] * shape[1], dtype=np.uint16).reshape(shape)
    sides = [size + high - low for (low, high), size in zip(MARGINS, shape, strict=True)]
    whole = np.zeros(sides, np.uint16)
    copy_extended(codes, period, MARGINS[0][0], MARGINS[1][0], whole)
    for place in np.ndindex(whole.shape):
        at = [index + low for index, (low, _) in zip(place, MARGINS, strict=True)]
        axes = zip(at, shape, strict=True)
        alike = [np.arange(index % period, size, period) for index, size in axes]
        if all(map(len, alike)):
            pairs = zip(alike, at, strict=True)
            repeated = tuple(int(same[np.abs(same - index).argmin()]) for same, index in pairs)
            assert whole[place] == codes[repeated]
    assert whole.min() > 0
