"""Codes as a preview graph takes them, which knows no shading, no edges and no defects.

**Shading.** A graph takes any 16-bit codes, with their black level and scale as inputs, and its
sums over them are exact. So the gain is applied to the codes, which become as fine as 16 bits
allow: for 12 bits and two stops no coarser than before.

**Edges.** The filter pattern continues outside the frame: each place takes the nearest sample at
the same place of the tile, down and across. A frame smaller than the tile may lack a filter; then
the nearest sample takes its place, whatever its filter.

**Listed defects.** Each takes the median of the nearest good samples of its filter.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shared import CfaPattern, CodeArray, FloatArray, IndexArray, Mosaic
from ...shared.arrays import Pair, strips
from . import contract

_HIGHEST = (1 << 16) - 1


def correct_flat_field(mosaic: Mosaic) -> tuple[CodeArray, dict[str, FloatArray]]:
    """The codes of a mosaic without its shading, uint16 (H, W), and the graph's inputs that say
    what they mean.

    Its own codes, and no inputs, where it has no shading.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.device.preview.codes import correct_flat_field
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, Shading
    >>> calibration = SensorCalibration.of_bits(12, shading=Shading(np.ones((4, 4, 4)).tolist(),
    ...     (12, 18)))
    >>> mosaic = Mosaic(np.full((12, 18), 3839, np.uint16), CfaPattern.bayer(6), calibration)
    >>> codes, levels = correct_flat_field(mosaic)
    >>> round(float((codes[5, 5] - levels["black"][-1]) * levels["scale"][-1]), 3)  # scene units
    3.0
    """
    calibration = mosaic.calibration
    if calibration.shading is None:
        return mosaic.codes, {}
    black, scale = np.array(calibration.black_level), calibration.scale()
    # Codes below black, which noise makes, stay above 0.
    most = float(calibration.shading.sketch.max())
    finer = _HIGHEST / ((1 << calibration.bits) * most)
    offset = float(np.ceil(black.max() * most * finer))
    codes, even = mosaic.codes, np.empty(mosaic.shape, np.uint16)
    panchromatic = ((-1, rows, slice(None)) for rows in strips(mosaic.shape[0]))
    for plane, *lattice in (*panchromatic, *mosaic.pattern.lattices):
        level = codes[*lattice] - np.float32(black[plane])
        level *= calibration.shading.of_plane(mosaic.shape, plane, *lattice)
        level *= np.float32(finer)
        level += np.float32(offset)
        even[*lattice] = np.rint(level, out=level).clip(0, _HIGHEST, out=level)
    levels = {contract.BLACK: np.full(len(black), offset), contract.SCALE: scale / finer}
    return even, {name: level.astype(np.float32) for name, level in levels.items()}


def copy_extended(codes: CodeArray, period: int, row: int, column: int, out: NDArray[Any]) -> None:
    """Fill `out` with the rectangle of a frame of codes, (H, W), extended on all sides, that
    begins at this row and column.

    Parameters
    ----------
    period : int
        K of the filter pattern.
    row, column : int
        Counted from the first row and column of the frame; before it, or in it.
    """
    (tall, wide), (height, width) = out.shape, codes.shape
    rows = _repeated(np.arange(row, row + tall), height, period)
    columns = _repeated(np.arange(column, column + wide), width, period)
    left, right = -column, width - column
    # mostly without a copy
    inside = codes[row : row + tall] if 0 <= row <= height - tall else codes[rows]
    out[:, left:right] = inside
    out[:, :left], out[:, right:] = inside[:, columns[:left]], inside[:, columns[right:]]


def _repeated(places: IndexArray, size: int, period: int) -> IndexArray:
    """Nearest indices inside the frame with the same remainder modulo the period."""
    first = places % period
    last = first + (size - 1 - first) // period * period
    return np.clip(np.where(places < 0, first, np.where(places >= size, last, places)), 0, size - 1)


_SAMPLES = 6  # in a median: those beside a pixel without one of its rows or columns
_SEARCHED = 400  # samples, the nearest first, of which the good ones are taken
_REACH = 4  # periods


def without_defects(codes: CodeArray, pattern: CfaPattern, defects: tuple[Pair, ...]) -> CodeArray:
    """Return the codes of a frame, uint16 (H, W), with the samples of its defects replaced; `codes`
    itself if it has none.

    Parameters
    ----------
    pattern : CfaPattern
        The filter pattern of the frame.
    defects : tuple[tuple[int, int], ...]
        (row, column) of each; those outside of the frame are ignored, those far from good samples
        of their filter stay.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.device.preview.codes import without_defects
    >>> from panchroma.shared import CfaPattern
    >>> codes = np.full((12, 12), 100, np.uint16)
    >>> codes[5, 5] = 4095
    >>> int(without_defects(codes, CfaPattern.bayer(6), ((5, 5),))[5, 5])
    100
    """
    places = np.array(defects, np.intp).reshape(-1, 2)
    places = places[(places < codes.shape).all(axis=1)]
    if not len(places):
        return codes
    mended, good = codes.copy(), np.ones(codes.shape, np.bool_)
    good[tuple(places.T)] = False
    phases = places % pattern.period
    for phase in np.unique(phases, axis=0):
        alike = places[(phases == phase).all(axis=1)]
        values = np.full((len(alike), _SAMPLES), np.nan)
        counts = np.zeros(len(alike), np.intp)
        for step in _same_filter(pattern, *phase.tolist()):
            missing = np.flatnonzero(counts < _SAMPLES)
            if not len(missing):
                break
            around = alike[missing] + step
            inside = ((around >= 0) & (around < codes.shape)).all(axis=1)
            rows, columns = np.where(inside[:, None], around, 0).T
            is_good = inside & good[rows, columns]
            filled = missing[is_good]
            values[filled, counts[filled]] = codes[rows, columns][is_good]
            counts[filled] += 1
        known = counts > 0
        mended[tuple(alike[known].T)] = np.rint(np.nanmedian(values[known], axis=1))
    return mended


@lru_cache(maxsize=1024)  # of a stream: a period of 16 has 256 places
def _same_filter(pattern: CfaPattern, row: int, column: int) -> IndexArray:
    """Steps (n, 2) from a pixel to others with its filter, the nearest first."""
    period, reach = pattern.period, _REACH * pattern.period
    planes = pattern.filter_map((period, period))
    steps = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    there = planes[tuple((steps + np.array((row, column))).T % period)]
    steps = steps[there == planes[row, column]]
    return steps[np.argsort(np.square(steps).sum(axis=1), kind="stable")[1 : _SEARCHED + 1]]
