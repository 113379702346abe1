"""Comparison of frames with the description of their sensor: until two have confirmed it, and whether later ones still do.

Raw frames have no header. In a wrong layout, or with a wrong pattern, they would be saved as pictures that look like noise or have
false colours. A frame that contradicts its description is refused; what would be right, `panchroma identify` finds out.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from shared.arrays import CodeArray
from shared.errors import InputError

from ..frames import FORMATS, RawFrame, Sensor
from .colours import shows_colours
from .filters import has_other_period, is_misread, lacks_filters, shows_filters
from .levels import columns_of_light, hindrance, impossible_level, is_dark, is_even, light_in_the_dark, open_bits
from .slip_check import SlipCheck, SlippedError
from .tiles import Tiles

_NEXT = "; the next frames are looked at"
_UNPROVEN = "the frame does not show whether size, format and pattern are right ({reason})" + _NEXT
_GREENS = f"the frame does not show whether the greens are on the right diagonal (it has little colour){_NEXT}"
_COLOURS = f"the frame does not show whether each colour is where `pattern` says (it has little colour){_NEXT}"
_ENOUGH = 2  # frames that confirm the description; the second shows that the first has as many rows as described
_TILES = 64
_STRAY = 0.1  # of the groups of packed samples: more with unused bits are no error of transmission


def checked(
    frames: Iterable[RawFrame],
    sensor: Sensor,
    note: Callable[[str], None],
    *,
    covered: bool = False,
    refused: Callable[[InputError], None] | None = None,
) -> Iterator[RawFrame]:
    """Pass frames on, and look at them: until some have confirmed the description of their sensor, and whether they still do.

    note: called with each sentence on what a frame leaves open, once.
    covered: whether the lens is covered. Then all that is checked is that no sample is too large or lit: the rest takes light.
    refused: called for a file that is not like those before it, which is left out: the next one begins anew. None = raise.
    Raises InputError, before the frame is passed on, at the first that contradicts the description.
    Raises SlippedError when a stream has lost or gained bytes since.
    """
    check, slips = _Check(sensor, covered=covered), SlipCheck(sensor)
    noted: set[str] = set()
    for frame in frames:
        try:
            is_checked = check.is_sure and slips.look(frame, covered=covered)
            remarks = check.look(frame)
        except SlippedError as error:
            reason = SlippedError(frame.named(error))
            if refused is None or not frame.source:
                raise reason from None
            refused(reason)
            continue
        except InputError as error:
            raise InputError(frame.named(error)) from None
        for remark in remarks:
            if remark not in noted:
                note(remark)
                noted.add(remark)
        yield replace(frame, is_checked=is_checked)


class _Check:
    """Frames so far, and what they have confirmed. For the arguments see `checked`."""

    def __init__(self, sensor: Sensor, *, covered: bool) -> None:
        self._sensor, self._covered = sensor, covered
        self._count = self._confirmed = 0
        self._colours = self._bits = False

    @property
    def is_sure(self) -> bool:
        """Whether frames so far have shown what all others have to be like; dark ones are compared with the first."""
        return self._confirmed >= _ENOUGH or (self._covered and self._count > 0)

    def look(self, frame: RawFrame) -> list[str]:
        """Return what the frame leaves open, a sentence each.

        Frames are looked at until two have shown the pattern, and then the less often, the more have left something open.
        Raises InputError if the frame contradicts the description.
        """
        self._count += 1
        rarely, confirmed = self._count & (self._count - 1) == 0, self._confirmed >= _ENOUGH
        if (confirmed and self._colours and self._bits) or ((self._covered or confirmed) and not rarely):
            return []
        layout, pattern, calibration = self._sensor.layout, self._sensor.pattern, self._sensor.calibration
        codes = layout.unpack(frame.data)
        if self._covered:
            self._refuse(frame, light_in_the_dark(codes, calibration))
            return []
        width = columns_of_light(codes, calibration)
        codes = codes[:, :width]
        tiles = Tiles.of(codes, min(max(32, 4 * pattern.period), *codes.shape), _TILES)
        shown = shows_filters(tiles, pattern)
        if shown is None and is_dark(codes, calibration):
            return [_UNPROVEN.format(reason="it is dark")]
        self._refuse(frame, impossible_level(codes, tiles, calibration) or self._contradiction(codes, tiles, shown=shown))
        self._refuse(frame, self._unused_bits(frame))
        if shown is None:
            return [_UNPROVEN.format(reason=hindrance(codes, calibration))]
        if padding := layout.width - width:
            self._refuse(frame, f"its rows have {padding} samples at the end that are the same in all of them (`width={width}`?)")
        coloured = shows_colours(codes, pattern, calibration)
        if coloured is False:
            greens = "the two greens of a block lie on the other diagonal"
            self._refuse(frame, "its colours are at other sites of the tile" if pattern.is_scattered else greens)
        self._confirmed += 1
        self._colours |= coloured is not None
        open_question = open_bits(codes, calibration) if layout.has_words else ""
        self._bits |= not open_question
        left = [] if self._colours else [_COLOURS if pattern.is_scattered else _GREENS]
        return left if self._bits else [*left, f"{open_question}{_NEXT}"]

    def _contradiction(self, codes: CodeArray, tiles: Tiles, *, shown: bool | None) -> str:
        """Return what the tiles of a frame that is not dark prove wrong; "" if nothing."""
        pattern, calibration, layout = self._sensor.pattern, self._sensor.calibration, self._sensor.layout
        if is_misread(tiles, pattern, FORMATS[layout.format].pixels, calibration.bits):
            return f"the bits of its samples are not in the order of {layout.format}"
        if shown is False and self._confirmed:
            return f"it does not begin where the frame before it ended: frames have another number of rows than {layout.height}"
        if shown is False or has_other_period(tiles, pattern):
            rows = "or rows do not begin where `stride` and `width` say"
            return f"the colour sites are not where `pattern`, `period` and `origin` say, {rows}"
        black, white = float(np.mean(calibration.black_level)), calibration.white_level
        if shown is None and not is_even(codes, calibration) and lacks_filters(tiles, pattern, black, white):
            return "the samples at the places of the colour filters are as bright as their neighbours"
        return ""

    def _unused_bits(self, frame: RawFrame) -> str:
        """Return what is wrong with bits of packed groups that hold no sample: 0 is right, as in Mono10Packed; "" if nothing."""
        layout, packing = self._sensor.layout, FORMATS[self._sensor.layout.format]
        if packing.words:
            return ""
        used = np.frombuffer(sum(packing.moves.values()).to_bytes(packing.length, "little"), np.uint8)
        lines = np.frombuffer(frame.data, np.uint8).reshape(layout.height, layout.stride)[:: max(layout.height // 64, 1)]
        groups = lines[:, : layout.line_bytes].reshape(-1, packing.length)
        return f"bits that {layout.format} leaves unused hold something" if (groups & ~used).any(axis=1).mean() > _STRAY else ""

    def _refuse(self, frame: RawFrame, reason: str) -> None:
        """Raise InputError with the reason, if there is one."""
        if reason:
            width, height, name = self._sensor.layout.width, self._sensor.layout.height, self._sensor.layout.format
            raise InputError(
                f"the frame is not as described: {reason}; run `panchroma identify {frame.source or 'FRAME'} --width {width} "
                f"--height {height} --pixel-format {name} --stride {self._sensor.layout.stride}`. If the description is right, "
                "add `unchecked`"
            )
