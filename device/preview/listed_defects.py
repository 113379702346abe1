"""Listed defects, for a preview graph, which knows none: each takes the median of the nearest good samples of its filter."""

from functools import lru_cache

import numpy as np

from ...shared.arrays import CodeArray, IndexArray
from ...shared.pattern import CfaPattern

_SAMPLES = 6  # in a median: those beside a pixel without one of its rows or columns
_SEARCHED = 12, 400  # samples, the nearest first, of which the good ones are taken; the second for clusters, lines and edges
_REACH = 4  # periods


def without_defects(codes: CodeArray, pattern: CfaPattern, defects: tuple[tuple[int, int], ...]) -> CodeArray:
    """Return the codes of a frame, uint16 (H, W), with the samples of its defects replaced; `codes` itself if it has none.

    pattern: the filter pattern of the frame.
    defects: (row, column) of each; those outside of the frame are ignored, those far from good samples of their filter stay.

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
        same = _same_filter(pattern, *phase.tolist())
        left = places[(phases == phase).all(axis=1)]
        for count in _SEARCHED:
            if not len(left):
                break
            around = left[:, None] + same[:count]
            inside = ((around >= 0) & (around < codes.shape)).all(axis=2)
            rows, columns = np.where(inside[..., None], around, 0).transpose(2, 0, 1)
            is_good = inside & good[rows, columns]
            nearest = np.argsort(~is_good, axis=1, kind="stable")[:, :_SAMPLES]
            values = np.where(is_good, codes[rows, columns], np.nan)
            values = np.take_along_axis(values, nearest, axis=1)
            known = np.isfinite(values).any(axis=1) if count == _SEARCHED[-1] else np.isfinite(values).all(axis=1)
            mended[tuple(left[known].T)] = np.rint(np.nanmedian(values[known], axis=1))
            left = left[~known]
    return mended


@lru_cache(maxsize=1024)  # of a stream: a period of 16 has 256 places
def _same_filter(pattern: CfaPattern, row: int, column: int) -> IndexArray:
    """Steps (n, 2) from a pixel to others with its filter, the nearest first."""
    period, reach = pattern.period, _REACH * pattern.period
    planes = pattern.filter_map((period, period))
    steps = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    steps = steps[planes[tuple((steps + np.array((row, column))).T % period)] == planes[row, column]]
    return steps[np.argsort(np.square(steps).sum(axis=1), kind="stable")[1 : _SEARCHED[-1] + 1]]
