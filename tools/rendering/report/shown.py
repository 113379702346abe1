"""Renderings as people see them, and the places to look at."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from shared import Mosaic
from shared.arrays import ByteArray, FloatArray
from shared.display import ColourTransform
from tools.pictures.samples import Sample, display_codes, upright

CELL = 96
"""Pixels, each way, of a place to look at."""


class Shown:
    """A rendering in sRGB, 8 bits, taken while its bands go by: 3 bytes per pixel.

    mosaic: its shot.
    exposure: gain, stops.
    Raises InputError if nothing is known of the sensor's colours.
    """

    def __init__(self, mosaic: Mosaic, exposure: float) -> None:
        self._colours = ColourTransform.to_space(mosaic.calibration)
        self._channels = len(mosaic.pattern.channels)
        self._exposure, self._orientation = exposure, mosaic.metadata.orientation
        self._codes = np.empty((*mosaic.shape, 3), np.uint8)

    def taken(self, bands: Iterable[FloatArray]) -> Iterator[FloatArray]:
        """Yield the bands of the rendering, from top to bottom, as they are."""
        top = 0
        for band in bands:
            picture = band[..., : self._channels]  # without what it may state behind them
            self._codes[top : top + len(band)] = display_codes(picture, self._colours, 8, self._exposure)
            top += len(band)
            yield band

    @property
    def picture(self) -> ByteArray:
        """The picture, uint8 (H, W, 3), upright."""
        return self.upright(self._codes)

    def upright(self, plane: NDArray[Sample]) -> NDArray[Sample]:
        """A plane of the sensor (H, W, ...), turned like the picture."""
        return upright(plane, self._orientation)


def most_different(one: ByteArray, other: ByteArray, count: int) -> list[tuple[int, int]]:
    """The places, at most `count`, at which two pictures uint8 (H, W, 3) differ most: (row, column) of their first pixels.

    >>> one, other = np.zeros((2, 200, 300, 3), np.uint8)
    >>> other[110:120, 150:160] = 255
    >>> most_different(one, other, 1)
    [(48, 96)]
    """
    return _highest(_cells(np.square(one.astype(np.float32) - other).sum(axis=2)), one.shape, count)


def _cells(plane: FloatArray) -> FloatArray:
    """Means of a plane over cells of half the size of a place, those at the border smaller."""
    half = CELL // 2
    starts = [np.arange(0, size, half) for size in plane.shape]
    sums = np.add.reduceat(np.add.reduceat(plane, starts[0], axis=0), starts[1], axis=1)
    return (sums / half**2).astype(np.float32)


def _highest(cells: FloatArray, shape: tuple[int, ...], count: int) -> list[tuple[int, int]]:
    """The places with the largest sums of 2 x 2 cells, which do not overlap."""
    around = np.pad(cells, ((0, 1), (0, 1)))
    sums = around[:-1, :-1] + around[1:, :-1] + around[:-1, 1:] + around[1:, 1:]
    found: list[tuple[int, int]] = []
    while len(found) < count and sums.max() > 0:
        row, column = (int(each) for each in np.unravel_index(np.argmax(sums), sums.shape))
        sums[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] = 0
        found.append((min(row * CELL // 2, max(shape[0] - CELL, 0)), min(column * CELL // 2, max(shape[1] - CELL, 0))))
    return found
