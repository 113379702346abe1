"""Whether frames are what their description says: the first that shows its filter pattern proves it, or proves it wrong.

Raw frames have no header. In a wrong layout, or with a wrong pattern, they would be saved as pictures that look like noise or have
false colours. The samples themselves tell: rows resemble the next ones, colour sites are darker than their neighbours at one
period and one place only, the two greens of a block are equal, and no picture is darker than black.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import gcd
from typing import TYPE_CHECKING

import numpy as np

from shared.arrays import CodeArray
from shared.errors import InputError

from ..frames import RawFrame
from .block_order import greens_are_on_their_diagonal
from .colour_places import likely_place
from .layout_search import BIG_ENDIAN, BYTES, CLEARER, PLAIN, RAW14, Reading, best_reading, refined
from .level_check import Levels, columns_of_light
from .pattern_search import Found, find_pattern
from .stride_search import likely_strides

if TYPE_CHECKING:
    from ..sensor import Sensor

_NEXT = "; the next frames are looked at"
_UNPROVEN = f"the frame does not show whether size, format and pattern are right (dark, even or noisy){_NEXT}"
_GREENS = f"the frame does not show whether the greens are on the right diagonal (it has little colour){_NEXT}"
_COLOURS = f"the frame does not show whether each colour is where `pattern` says (it has little colour){_NEXT}"
_TRIED = 2  # strides; the right one is the likeliest or the next
_TWICE = 2  # convincing frames; the second shows that the first has as many rows as described


class FrameCheck:
    """Compares frames with the description of their sensor, until some have confirmed it.

    sensor: the description.
    dark: whether the lens is covered. Then all that is checked is that no sample is too large or lit: the rest takes light.
    """

    def __init__(self, sensor: "Sensor", *, dark: bool = False) -> None:
        self._sensor, self._dark = sensor, dark
        self._seen = 0
        self._confirmed = 0
        self._order = self._bits = False

    def look(self, frame: RawFrame) -> list[str]:
        """What the frame leaves open, a sentence each.

        Frames are looked at until two have shown the pattern, and then the less often, the more have left something open.
        Raises InputError, with the likely right value, if the frame proves something wrong.
        """
        self._seen += 1
        rarely = self._seen & (self._seen - 1) == 0
        if self._dark:
            if lit := self._levels(self._sensor.layout.unpack(frame.data)).lit() if rarely else None:
                raise _misfit(*lit)
            return []
        if self._confirmed >= _TWICE and (not rarely or (self._order and self._bits)):
            return []
        layout, calibration = self._sensor.layout, self._sensor.calibration
        codes = layout.unpack(frame.data)
        width = columns_of_light(codes, min(calibration.black_level), calibration.white_level)
        levels = self._levels(codes[:, :width])
        found = self._found(frame, codes, levels, rarely=rarely)
        if not found:
            return [_UNPROVEN]
        if width < layout.width:
            rows = f"`width={width}` `stride={layout.stride}`"
            raise _misfit(f"its rows have {layout.width - width} samples at the end that are the same in all of them", rows)
        self._confirmed += 1
        self._order |= self._shows_order(codes, found)
        unsettled = levels.unsettled()
        self._bits |= not unsettled
        left = [] if self._order else [_COLOURS if self._sensor.pattern.is_scattered else _GREENS]
        return left if self._bits else [*left, f"{unsettled}{_NEXT}"]

    def _levels(self, codes: CodeArray) -> Levels:
        return Levels(codes, self._sensor.calibration, are_words=self._sensor.layout.format == "u16")

    def _shows_order(self, codes: CodeArray, found: Found) -> bool:
        """Whether the frame shows that the colours are where they are said to be; InputError if they are elsewhere."""
        pattern, calibration = self._sensor.pattern, self._sensor.calibration
        if pattern.is_scattered:
            place = likely_place(codes, pattern, found.places)
            if place and place != pattern.block_origin:
                raise _misfit("its colours are at other sites of the tile", f"`origin={place[0]} {place[1]}`")
            return place is not None
        black = float(np.mean(calibration.black_level))
        greens = greens_are_on_their_diagonal(codes, pattern, black, calibration.white_level)
        if greens is False:
            raise _misfit("the two greens of a block lie on the other diagonal", self._other_orders())
        return greens is True

    def _found(self, frame: RawFrame, codes: CodeArray, levels: Levels, *, rarely: bool) -> Found | None:
        """The pattern, if the frame shows it where it is said to be; None if it does not show it. InputError if it is wrong."""
        pattern, layout = self._sensor.pattern, self._sensor.layout
        found = find_pattern(codes, pattern)
        confirmed = self._is_declared(found)
        if found and not (confirmed or found.sure):
            found = None
        proven = levels.wrong(in_right_format=found is not None)
        wrong_levels = _misfit(*proven) if proven else None
        if not found and levels.are_dark():
            return None
        # The stride is searched for where it may matter; a frame that shows nothing is searched rarely.
        searched = not self._confirmed and (found or wrong_levels or rarely)
        strides = likely_strides(frame.data, layout.stride) if searched else [layout.stride]
        # What repeats after a row also repeats after several.
        aligned = bool(strides) and strides[0] % layout.stride == 0
        # A part of the rows has the same period as all, if the two have no divisor in common.
        others = [stride for stride in strides if stride % layout.stride or gcd(stride // layout.stride, pattern.period) > 1]
        others = [stride for stride in others if stride != layout.stride][:_TRIED]
        if others and not (confirmed and aligned):
            self._check_stride(frame, found, others, aligned=aligned)
        # Packing before levels and place: in a wrong format both are wrong too, and their remedies lead astray.
        plain = confirmed and found and found.explained >= PLAIN
        reading = None if plain or not (searched or aligned) else best_reading(frame.data, layout, pattern, [layout.stride])
        clearer = reading and (not found or reading.found.explained > CLEARER * found.explained)
        if searched and clearer and reading and reading.format != layout.format:
            raise self._misread(frame, reading)
        if confirmed and found and layout.format == "u16":  # the low byte alone may show the pattern, faintly
            swapped = find_pattern(codes.byteswap(), pattern)
            if swapped and swapped.explained > CLEARER * found.explained:
                raise self._misread(frame, Reading(BIG_ENDIAN, layout.stride, 0, layout.width, swapped))
        if wrong_levels and (confirmed or not aligned):
            raise wrong_levels
        if confirmed:
            self._check_below(codes)
            return found
        if found:
            raise self._elsewhere(frame, codes, found)
        if self._is_declared(find_pattern(codes[: len(codes) // 2], pattern)):
            self._check_below(codes)
        if aligned:
            if reading and self._confirmed and (reading.format, reading.skipped) == (layout.format, 0):
                raise self._too_tall()
            if reading:
                raise self._misread(frame, reading)
            if wrong_levels:
                raise wrong_levels
            if levels.show_no_filters(pattern):
                raise _misfit(
                    "the samples at the places of the colour filters are as bright as their neighbours",
                    "a sensor without colour filters, or another `pattern`, `period` or `origin`",
                )
        return None

    def _is_declared(self, found: Found | None) -> bool:
        pattern = self._sensor.pattern
        return found is not None and found.period == pattern.period and pattern.block_origin in found.places

    def _check_below(self, codes: CodeArray) -> None:
        """Refuse a frame in whose lower part the pattern is at another row: the next frame begins in this one."""
        pattern = self._sensor.pattern
        for part in (2, 4):
            top = len(codes) * (part - 1) // part
            found = find_pattern(codes[top:], pattern)
            if (
                found
                and found.sure
                and found.period == pattern.period
                and pattern.block_origin[0] not in {(row + top) % found.period for row, _ in found.places}
            ):
                raise self._too_tall()

    def _too_tall(self) -> InputError:
        height = self._sensor.layout.height
        return _misfit(f"a frame ends and the next begins at another row than after {height}", "another `height`")

    def _check_stride(self, frame: RawFrame, found: Found | None, others: list[int], *, aligned: bool) -> None:
        layout = self._sensor.layout
        reading = best_reading(frame.data, layout, self._sensor.pattern, others)
        clearer = CLEARER if aligned else 1 / CLEARER
        if reading and (found is None or reading.found.explained > clearer * found.explained):
            raise self._misread(frame, reading)

    def _elsewhere(self, frame: RawFrame, codes: CodeArray, found: Found) -> InputError:
        if self._confirmed:
            return self._too_tall()
        if found.period == 2:
            return _misfit(
                "its colours repeat every 2 pixels",
                "an ordinary Bayer sensor, whose raw files other programs develop, or one with scattered colours, which `pattern` "
                "describes",
            )
        layout, pattern = self._sensor.layout, self._sensor.pattern
        if pattern.is_scattered and (place := likely_place(codes, pattern, found.places)):
            found = replace(found, block_origin=place)
        reading = refined(frame.data, layout, pattern, Reading(layout.format, layout.stride, 0, layout.width, found))
        if reading.stride != layout.stride:
            return self._misread(frame, reading)
        period = pattern.period
        where = f"its colour sites repeat every {found.period} pixels, from row and column {found.block_origin} on"
        return _misfit(where, f"{f'`period={found.period}` ' if found.period != period else ''}{self._origin(found)}")

    def _misread(self, frame: RawFrame, reading: Reading) -> InputError:
        layout = self._sensor.layout
        reading = refined(frame.data, layout, self._sensor.pattern, reading)
        seen = []
        if reading.stride != layout.stride:
            seen.append(f"its rows repeat every {reading.stride} bytes, not {layout.stride}")
        if reading.format == BIG_ENDIAN:
            seen.append("its samples are words with the high byte first")
            return _misfit(", and ".join(seen), "a source with little-endian words (swap the bytes)")
        if reading.format == BYTES:
            seen.append("its samples are single bytes")
            remedy = "8 bits or a lossy compression; ask the camera for unpacked frames: rpicam-raw --mode W:H:12:U"
            return _misfit(", and ".join(seen), remedy)
        if reading.format == RAW14:
            seen.append(f"its samples are packed as {RAW14}")
            return _misfit(", and ".join(seen), "a mode of the camera with 10, 12 or 16 bits")
        options = []
        if reading.format != layout.format:
            seen.append(f"its samples are packed as {reading.format}, not as {layout.format}")
            options.append(f"`pixel_format={reading.format}`")
        if reading.stride != layout.stride:
            options.append(f"`stride={reading.stride}`")
        if reading.width < layout.width:
            options.append(f"`width={reading.width}` or less")
        if reading.skipped:
            bytes_ = f"{reading.skipped} bytes (or whole groups of samples more)"
            seen.append(f"its samples begin {bytes_} after the beginning of the frame")
            options.append("a stream without a header")
        if not self._is_declared(reading.found) and not reading.skipped:
            if reading.found.period != self._sensor.pattern.period:
                options.append(f"`period={reading.found.period}`")
            options.append(self._origin(reading.found))
        return _misfit(", and ".join(seen or ["its samples lie elsewhere"]), " ".join(options))

    def _origin(self, found: Found) -> str:
        pattern = self._sensor.pattern
        shift = [origin - block for origin, block in zip(pattern.origin, pattern.block_origin, strict=True)]
        if found.period != pattern.period:
            shift = [0, 0]
        row, column = ((place + moved) % found.period for place, moved in zip(found.block_origin, shift, strict=True))
        return f"`origin={row} {column}`"

    def _other_orders(self) -> str:
        letters = "".join(self._sensor.pattern.channels[channel] for *_, channel in self._sensor.pattern.sites)
        return "`pattern` with blocks GRBG or GBRG" if letters in ("RGGB", "BGGR") else "`pattern` with blocks RGGB or BGGR"


def checked(frames: Iterable[RawFrame], sensor: "Sensor", note: Callable[[str], None], *, dark: bool = False) -> Iterator[RawFrame]:
    """Pass frames on, and look at them until some have confirmed the description of their sensor.

    note: called with each sentence on what a frame leaves open, once.
    dark: whether the lens is covered, so that checks that take light are left out.
    Raises InputError, before the frame is passed on, at the first that proves the description wrong; it names the likely right one.
    """
    check = FrameCheck(sensor, dark=dark)
    told: set[str] = set()
    for frame in frames:
        try:
            remarks = check.look(frame)
        except InputError as error:
            raise InputError(f"{frame.source}: {error}" if frame.source else str(error)) from None
        for remark in remarks:
            if remark not in told:
                note(remark)
                told.add(remark)
        yield frame


def _misfit(seen: str, likely: str) -> InputError:
    return InputError(f"the frame is not as described: {seen}; likely {likely}. If the description is right, add `unchecked`")
