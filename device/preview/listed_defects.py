"""Listed defects, for a preview graph, which knows none: each takes the median of the nearest good
samples of its filter.
"""

from functools import lru_cache

import numpy as np

from ...shared.arrays import CodeArray, IndexArray
from ...shared.pattern import CfaPattern

_SAMPLES = 6  # in a median: those beside a pixel without one of its rows or columns
_SEARCHED = 400  # samples, the nearest first, of which the good ones are taken
_REACH = 4  # periods


def without_defects(
    codes: CodeArray, pattern: CfaPattern, defects: tuple[tuple[int, int], ...]
) -> CodeArray:
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
    >>> from panchroma.device.preview.listed_defects import without_defects
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
        missing = np.arange(len(alike))
        for step in _same_filter(pattern, *phase.tolist()):
            if not len(missing):
                break
            around = alike[missing] + step
            inside = ((around >= 0) & (around < codes.shape)).all(axis=1)
            rows, columns = np.where(inside[:, None], around, 0).T
            is_good = inside & good[rows, columns]
            filled = missing[is_good]
            values[filled, counts[filled]] = codes[rows, columns][is_good]
            counts[filled] += 1
            missing = missing[counts[missing] < _SAMPLES]
        known = counts > 0
        mended[tuple(alike[known].T)] = np.rint(np.nanmedian(values[known], axis=1))
    return mended


@lru_cache(maxsize=1024)  # of a stream: a period of 16 has 256 places
def _same_filter(pattern: CfaPattern, row: int, column: int) -> IndexArray:
    """Steps (n, 2) from a pixel to others with its filter, the nearest first."""
    period, reach = pattern.period, _REACH * pattern.period
    planes = pattern.filter_map((period, period))
    steps = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    steps = steps[
        planes[tuple((steps + np.array((row, column))).T % period)] == planes[row, column]
    ]
    return steps[np.argsort(np.square(steps).sum(axis=1), kind="stable")[1 : _SEARCHED + 1]]
