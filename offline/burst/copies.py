"""Frames of a burst that are copies of one another: their noise is the same, and does not fall when they are merged."""

from collections.abc import Iterable, Sequence

import numpy as np

from shared.arrays import FloatArray, IndexArray, strips
from shared.mosaic import Mosaic

_ALIKE = 0.99  # of the samples, chosen: a copy in which somebody has mended some is a copy too
_LOOKED = 1 << 14  # samples that are compared first: enough to see that most frames are no copies
_HALF = 0.5001  # of a code: as far as rounding moves one, and the rounding of that


def copies(frames: Sequence[Mosaic], reference: int | None = None) -> dict[int, int]:
    """The index of each frame that is a copy, and that of the frame which stays: the reference, or the first that is alike.

    frames: of any cameras and sizes. reference: index of a frame that stays, whatever it is a copy of; None = of any.

    Frames are copies if 99 % of their samples differ by half a code or less, or have the same code. In independent frames that is
    so only where there is hardly any noise and nothing moves: the second one tells nothing new. Samples like those beside them
    (blacks, clipped light) count only if there are no others: most of a frame may be black, and a star on it move.

    >>> import numpy as np
    >>> from offline.burst import copies
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> one, other = (np.random.default_rng(seed).integers(5000, 6000, (24, 36), np.uint16) for seed in (1, 2))
    >>> copies([Mosaic(codes, CfaPattern.bayer(6), SensorCalibration()) for codes in (one, other, one.copy())])
    {2: 0}
    """
    found: dict[int, int] = {}
    stay: list[int] = []
    for number in sorted(range(len(frames)), key=lambda each: each != reference):
        original = next((each for each in stay if _alike(frames[each], frames[number])), None)
        if original is None:
            stay.append(number)
        else:
            found[number] = original
    return found


def _alike(one: Mosaic, other: Mosaic) -> bool:
    """Whether these frames are copies."""
    if (one.shape, one.pattern) != (other.shape, other.pattern):
        return False
    height, width = one.shape
    some = np.unique(np.linspace(0, height - 1, min(max(_LOOKED // width, 1), height)).astype(np.intp))
    return _share(one, other, [some]) >= _ALIKE and (len(some) == height or _share(one, other, strips(height)) >= _ALIKE)


def _share(one: Mosaic, other: Mosaic, parts: Iterable[slice | IndexArray]) -> float:
    """The share of the samples in some parts (rows) that are the same, 0 to 1, of those that are not like the ones beside them."""
    period, counts = one.pattern.period, np.zeros(4)
    half = max(_HALF / _range(mosaic) for mosaic in (one, other))
    for rows in parts:
        first, second = _levels(one, rows), _levels(other, rows)
        same = np.abs(first - second) <= half
        if one.samples.dtype == other.samples.dtype == np.uint16:
            same |= one.samples[rows] == other.samples[rows]  # whatever levels somebody has given them
        unlike = [np.abs(each[:, period:] - each[:, :-period]) > half for each in (first, second)]
        counted = unlike[0] | unlike[1]
        counts += (same[:, period:] & counted).sum(), counted.sum(), same.sum(), same.size
    return float(counts[0] / counts[1] if counts[1] else counts[2] / counts[3])


def _levels(mosaic: Mosaic, rows: slice | IndexArray) -> FloatArray:
    """The samples of some rows: panchromatic black is 0, white 1."""
    levels = mosaic.samples[rows].astype(np.float32)
    if mosaic.samples.dtype == np.float32:
        return levels / np.float32(mosaic.calibration.full_scale)
    return (levels - np.float32(mosaic.calibration.black_level[-1])) / np.float32(_range(mosaic))


def _range(mosaic: Mosaic) -> float:
    """Codes from panchromatic black to white."""
    return mosaic.calibration.white_level - mosaic.calibration.black_level[-1]
