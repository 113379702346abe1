"""Whether a stream still begins its frames where it did: one that loses or gains bytes shows its filters at another place.

The last rows of each frame are looked at, for whatever slipped before them has moved them; where they show no filters, rows from
all over the frame. Of the bytes that hold a few samples, those with the lowest bits differ the most: they tell in the dark, too.
Nothing is seen where filters are where they belong although the picture is cut in two: where whole periods of rows are missing and
the height is a multiple of the period, or where a step leaves scattered colours at sites of one other colour each.
"""

from dataclasses import replace
from math import gcd

import numpy as np

from shared.arrays import CodeArray, DoubleArray
from shared.errors import InputError

from ..frames import FORMATS, Bytes, RawFrame, Sensor
from .colour_search import alike
from .pattern_search import Tiles, is_elsewhere, places_alike

_SIDE, _PERIODS = 32, 4  # pixels along a tile, and periods in it, at least
_TILES, _LEAST = 48, 24  # of a look: with more it costs more, with fewer of them a strip of rows is taller
_STRIPS = 4  # parts of a frame from which rows are taken where its last ones show nothing
_UNEVEN = 0.35  # standard deviation of logarithms: the bytes of a group differ by a factor of two
_SAME, _OTHER = 0.9, 0.5  # correlation with the usual differences of bytes, shifted and as they are


class SlippedError(InputError):
    """A stream has lost or gained bytes: this frame, and perhaps some before it, are not what the camera has sent."""


class SlipCheck:
    """Compares each frame of a stream with where the filters are said to be.

    sensor: the description, which frames have confirmed.
    """

    def __init__(self, sensor: Sensor) -> None:
        self._layout, self._pattern, self._calibration = sensor.layout, sensor.pattern, sensor.calibration
        self._usual: DoubleArray | None = None
        self._has_colours = False
        self._side = min(max(_SIDE, _PERIODS * sensor.pattern.period), sensor.layout.width, sensor.layout.height)
        beside = max(sensor.layout.width // self._side, 1)
        self._rows = min(self._side * -(-_LEAST // beside), sensor.layout.height)

    def look(self, frame: RawFrame, *, covered: bool = False) -> bool:
        """Return whether the frame shows the filters where they are said to be. Raises SlippedError if they are elsewhere.

        covered: the frame is dark, and its bytes alone are compared with those of the one before.
        """
        if len(frame.data) != self._layout.frame_bytes:  # whoever reads it says so
            return False
        top = self._layout.height - self._rows
        data = memoryview(frame.data)[top * self._layout.stride :]
        differences, shows = self._differences(data), covered
        self._check_bytes(differences)  # samples from the wrong bytes may show the filters at the right place
        if not covered:
            last = replace(self._layout, height=self._rows).unpack(data)
            elsewhere = self._is_elsewhere(last, top)
            if elsewhere is None:
                elsewhere = is_elsewhere(self._some_rows(frame.data), self._pattern)
            if elsewhere:
                raise SlippedError(_SLIPPED)
            shows = elsewhere is False
        if shows:
            self._usual = differences
        return shows and not covered

    def _is_elsewhere(self, codes: CodeArray, top: int) -> bool | None:
        """See `is_elsewhere`; colours at sites of other colours are elsewhere, too. top: sensor row of the first."""
        tiles = Tiles.of(codes, self._side, _TILES)
        pattern = self._pattern
        elsewhere = is_elsewhere(Tiles(tiles.parts, tiles.places + np.array((top, 0))), pattern)
        if elsewhere is not False or not pattern.is_scattered:
            return elsewhere
        black, white = float(np.mean(self._calibration.black_level)), self._calibration.white_level
        places = [((row - top) % pattern.period, column) for row, column in places_alike(pattern, pattern.block_origin)]
        candidates = [replace(pattern, origin=place) for place in places]
        seen = alike(codes, candidates, black, white)
        self._has_colours |= seen == candidates[0]  # until then they may as well be described wrongly
        return self._has_colours and seen not in (None, candidates[0])

    def _some_rows(self, data: Bytes) -> Tiles:
        """Tiles from all over the frame."""
        layout, side = replace(self._layout, height=self._side), self._side
        parts, places = [], []
        for top in np.linspace(0, self._layout.height - side, _STRIPS).astype(int).tolist():
            strip = layout.unpack(memoryview(data)[top * layout.stride : (top + side) * layout.stride])
            tiles = Tiles.of(strip, side, _TILES // _STRIPS)
            parts.append(tiles.parts)
            places.append(tiles.places + np.array((top, 0)))
        return Tiles(np.concatenate(parts), np.concatenate(places))

    def _differences(self, data: Bytes) -> DoubleArray:
        """Logarithms of the mean differences of bytes that hold the same part of samples with one filter, less their mean."""
        packing, period = FORMATS[self._layout.format], self._pattern.period
        lines = np.frombuffer(data, np.uint8).reshape(-1, self._layout.stride)[:, : self._layout.line_bytes]
        groups = lines.reshape(len(lines), -1, packing.length).astype(np.int16)
        lag = period // gcd(period, packing.pixels)
        if groups.shape[1] <= lag:
            return np.zeros(packing.length)
        means = np.abs(groups[:, lag:] - groups[:, :-lag]).mean(axis=(0, 1))
        logarithms: DoubleArray = np.log(means + 1.0)
        return logarithms - logarithms.mean()

    def _check_bytes(self, differences: DoubleArray) -> None:
        """Raise SlippedError if other bytes of a group differ the most than those that usually do."""
        if self._usual is None or min(differences.std(), self._usual.std()) < _UNEVEN:
            return
        norm = float(np.linalg.norm(differences) * np.linalg.norm(self._usual))
        here, *shifted = (float(differences @ np.roll(self._usual, shift)) / norm for shift in range(len(differences)))
        if here < _OTHER and max(shifted) > _SAME:
            raise SlippedError(_SLIPPED)


_SLIPPED = (
    "the frame does not show the filters where those before it did: the stream has lost or gained bytes; start the camera again. "
    "If it has not, add `unchecked`"
)
