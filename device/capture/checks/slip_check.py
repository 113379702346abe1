"""Comparison of each frame of a stream with where the filters are said to be: after a loss of bytes they are elsewhere.

The last rows of each frame are looked at, for whatever slipped before them has moved them; where they show no filters, rows from
all over the frame. Nothing shows where filters are where they belong although the picture is cut in two: where whole periods of
rows are missing and the height is a multiple of the period, or where a step leaves scattered colours at sites of one other colour.
"""

from dataclasses import replace

import numpy as np

from shared.errors import InputError

from ..frames import FORMATS, Bytes, RawFrame, Sensor
from .colours import shows_colours
from .filters import is_misread, shows_filters
from .tiles import Tiles

_SIDE, _PERIODS = 32, 4  # pixels along a tile, and periods in it, at least
_TILES, _LEAST = 48, 24  # of a look: with more it costs more, with fewer of them a strip of rows is taller
_STRIPS = 4  # parts of a frame from which rows are taken where its last ones show nothing


class SlippedError(InputError):
    """A stream has lost or gained bytes: this frame, and perhaps some before it, are not what the camera has sent."""


class SlipCheck:
    """Comparison of each frame of a stream with the description that earlier frames have confirmed. sensor: the description."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor, self._layout, self._pattern = sensor, sensor.layout, sensor.pattern
        self._has_colours = False
        self._side = min(max(_SIDE, _PERIODS * sensor.pattern.period), sensor.layout.width, sensor.layout.height)
        beside = max(sensor.layout.width // self._side, 1)
        self._rows = min(self._side * -(-_LEAST // beside), sensor.layout.height)

    def look(self, frame: RawFrame, *, covered: bool = False) -> bool:
        """Return whether the frame shows the filters where they are said to be. Raises SlippedError if they are elsewhere.

        covered: the frame is dark, and only the order of its bits can be checked.
        """
        if len(frame.data) != self._layout.frame_bytes:  # whoever reads it says so
            return False
        top = self._layout.height - self._rows
        codes = replace(self._layout, height=self._rows).unpack(memoryview(frame.data)[top * self._layout.stride :])
        tiles = Tiles.of(codes, self._side, _TILES, top)
        # Samples from the wrong bytes may show the filters at the right place.
        slipped = is_misread(tiles, self._pattern, FORMATS[self._layout.format].pixels, self._sensor.calibration.bits)
        shown = None
        if not (slipped or covered):
            shown = shows_filters(tiles, self._pattern)
            if shown and self._pattern.is_scattered:
                coloured = shows_colours(codes, self._pattern, self._sensor.calibration, top)
                slipped = coloured is False and self._has_colours  # until a frame shows them they may as well be described wrongly
                self._has_colours |= coloured is True
            if shown is None:
                shown = shows_filters(self._some_rows(frame.data), self._pattern)
        if slipped or shown is False:
            raise SlippedError(
                "the frame does not show the filters where those before it did: the stream has lost or gained bytes; start the "
                "camera again. If it has not, add `unchecked`"
            )
        return shown is True

    def _some_rows(self, data: Bytes) -> Tiles:
        """Tiles from all over the frame."""
        layout, side = replace(self._layout, height=self._side), self._side
        strips = []
        for top in np.linspace(0, self._layout.height - side, _STRIPS).astype(int).tolist():
            codes = layout.unpack(memoryview(data)[top * layout.stride : (top + side) * layout.stride])
            strips.append(Tiles.of(codes, side, _TILES // _STRIPS, top))
        return Tiles(np.concatenate([strip.parts for strip in strips]), np.concatenate([strip.places for strip in strips]))
