"""Square windows of a frame, and the means of their samples at each place of a pattern."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...shared import BoolArray, CfaPattern, CodeArray, DoubleArray, FloatArray

FEWEST_WINDOWS = 4  # fewer have no standard error
_WIDTH = 17  # pixels, along the squares of local means
_FLAT = 0.25  # codes: differences below this are rounding
_LIMIT = 4.0  # mean deviations: the edges of a scene count no more than this


@dataclass(frozen=True)
class Windows:
    """Windows of a frame, evenly spread.

    Attributes
    ----------
    codes : FloatArray
        float32 (N, S, S).
    places : NDArray[np.intp]
        Sensor (row, column) of each, (N, 2).
    """

    codes: FloatArray
    places: NDArray[np.intp]

    @classmethod
    def of(cls, codes: CodeArray, side: int, most: int, top: int = 0) -> "Windows":
        """Cut about `most` windows at most, `side` pixels along, out of rows (H, W).

        Parameters
        ----------
        top : int, optional
            Sensor row of the first.
        """
        density = min(1.0, (most * side**2 / codes.size) ** 0.5)
        rows, columns = (
            np.linspace(0, size - side, max(int(size // side * density), 1)).astype(np.intp)
            for size in codes.shape
        )
        places = np.array([(row, column) for row in rows for column in columns])
        cut = [codes[row : row + side, column : column + side] for row, column in places]
        return cls(np.stack(cut).astype(np.float32), places + np.array((top, 0)))

    def flattened(self, width: int = _WIDTH) -> "Windows":
        """Return the samples minus their local mean, in local mean deviations, limited: all places
        of a scene count the same.

        Parameters
        ----------
        width : int, optional
            Pixels along the squares of local means.
        """
        rest = self.codes - _local_mean(self.codes, width)
        rest /= _local_mean(np.abs(rest), width) + np.float32(_FLAT)
        return Windows(rest.clip(-_LIMIT, _LIMIT), self.places)

    def quarter(self, down: int, right: int) -> "Windows":
        """Return the upper (0) or lower (1), left or right quarter of each window."""
        half = self.codes.shape[1] // 2
        top, left = down * half, right * half
        codes = self.codes[:, top : top + half, left : left + half]
        return Windows(codes, self.places + np.array((top, left)))

    def folded(self, period: int) -> DoubleArray:
        """Return the mean of each window at each place of a K x K square, minus the mean of all
        places: (N, K, K).
        """
        down, across = _averages(self.codes.shape[1], period)[self.places.T % period]
        means = (down @ self.codes @ across.transpose(0, 2, 1)).astype(np.float64)
        return means - means.mean(axis=(1, 2), keepdims=True)

    def levels(self, period: int) -> DoubleArray:
        """Return the mean of each window at each place of a K x K square: (N, K, K)."""
        return self.folded(period) + self.codes.mean(axis=(1, 2), keepdims=True)

    def panchromatic(self, pattern: CfaPattern) -> BoolArray:
        """Return the mask of panchromatic samples, (N, S, S)."""
        shape = self.codes.shape[1], self.codes.shape[2]
        return np.stack([pattern.panchromatic_mask(shape, place) for place in self.places])


@lru_cache(maxsize=64)
def _averages(side: int, period: int) -> FloatArray:
    """Weights of a window's rows in the mean at each place of a period: (phase of the first row,
    place, row), (K, K, `side`).
    """
    of_place = np.arange(side) % period == np.arange(period)[:, None]
    shifted = np.stack([of_place[np.arange(period) - phase] for phase in range(period)])
    return np.asarray(shifted / shifted.sum(axis=2, keepdims=True), np.float32)


def _local_mean(codes: FloatArray, width: int) -> FloatArray:
    down, across = (_box(side, width) for side in codes.shape[1:])
    return np.asarray(down @ codes @ across.T, np.float32)


@lru_cache(maxsize=64)
def _box(side: int, width: int) -> FloatArray:
    """Weights of the samples of a line in the mean around each, mirrored at its ends: (`side`,
    `side`).
    """
    before = max(min(width // 2, side - 2), 0)
    after = max(before - 1 + width % 2, 0)
    lines = np.pad(np.eye(side, dtype=np.float32), ((before, after), (0, 0)), "reflect")
    return sliding_window_view(lines, before + after + 1, axis=0).mean(axis=2)
