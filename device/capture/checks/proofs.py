"""What a frame shows, what that proves wrong in the description of its sensor, and what it advises."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from math import gcd

import numpy as np

from shared.arrays import CodeArray
from shared.pattern import CfaPattern

from ..frames import RawFrame, Sensor
from .colour_search import alike
from .layout_search import CLEARER, PLAIN, LayoutSearch, Reading, likely_strides
from .level_check import Levels, Proof, columns_of_light
from .pattern_search import Found, find_pattern

_TRIED = 2  # strides; the right one is the likeliest or the next


class Look:
    """A look at a frame; what it shows is found when it is first asked for.

    frame: the frame.
    sensor: its description.
    confirmed: whether an earlier frame has shown the pattern where it is said to be: stride and format are right, then.
    thorough: whether stride and format are searched for in a frame that shows nothing; this takes time.
    """

    def __init__(self, frame: RawFrame, sensor: Sensor, *, confirmed: bool, thorough: bool) -> None:
        self.confirmed, self._thorough = confirmed, thorough
        self.layout, self.pattern, self.calibration = sensor.layout, sensor.pattern, sensor.calibration
        self.codes = self.layout.unpack(frame.data)
        self.search = LayoutSearch(frame.data, self.layout, self.pattern)

    @cached_property
    def width(self) -> int:
        """Number of columns before padding at the end of the rows."""
        return columns_of_light(self.codes, min(self.calibration.black_level), self.calibration.white_level)

    @cached_property
    def levels(self) -> Levels:
        """The levels of the samples without padding."""
        return self.levels_of(self.codes[:, : self.width])

    def levels_of(self, codes: CodeArray) -> Levels:
        """The levels of some samples of the frame."""
        return Levels(codes, self.calibration, are_words=self.layout.has_words)

    @cached_property
    def wrong_levels(self) -> Proof | None:
        """What the levels prove wrong, and the remedy; None if nothing."""
        return self.levels.wrong(in_right_format=self.found is not None)

    @cached_property
    def found(self) -> Found | None:
        """The pattern, at the declared place or, if that is certain, at another one."""
        found = find_pattern(self.codes, self.pattern)
        return found if found and (found.sure or found.fits(self.pattern)) else None

    @property
    def shown(self) -> Found | None:
        """The pattern, if the frame shows it where it is said to be."""
        return self.found if self.found and self.found.fits(self.pattern) else None

    @cached_property
    def searched(self) -> bool:
        """Whether stride and format are searched for: where they may matter."""
        return not self.confirmed and bool(self.found or self.wrong_levels or self._thorough)

    @cached_property
    def strides(self) -> list[int]:
        """The strides that rows may have, the likeliest first."""
        return likely_strides(self.search.data, self.layout.stride) if self.searched else [self.layout.stride]

    @property
    def aligned(self) -> bool:
        """Whether rows resemble each other at the declared stride: what repeats after a row also repeats after several."""
        return bool(self.strides) and self.strides[0] % self.layout.stride == 0

    @property
    def restrided(self) -> Reading | None:
        """A reading at another stride: a part of the rows has the period of all if the two have no divisor in common."""
        ours, period = self.layout.stride, self.pattern.period
        others = [each for each in self.strides if each != ours and (each % ours or gcd(each // ours, period) > 1)][:_TRIED]
        return self.search.best(others)

    @cached_property
    def reading(self) -> Reading | None:
        """Another format, at the declared stride, in which the pattern appears; None where the declared one shows it plainly."""
        if (self.shown and self.shown.explained >= PLAIN) or not (self.searched or self.aligned):
            return None
        return self.search.best([self.layout.stride])

    @cached_property
    def coloured(self) -> CfaPattern | None:
        """The pattern with its colours as the frame shows them, the declared one where no frame can; None if it shows none."""
        if self.found is None:
            return None
        pattern, candidates = self.pattern, [self.pattern]
        if pattern.is_scattered:
            places = sorted(self.found.places, key=lambda place: (place != pattern.origin, place))
            candidates = [replace(pattern, origin=place) for place in places]
        elif len(pattern.sites) == 4 and pattern.block_shape == (2, 2):
            rows = [row[:2][::-1] for row in pattern.letters_from(pattern.block_origin)[:2]]
            candidates.append(CfaPattern.with_block((rows[0], rows[1]), pattern.period, pattern.block_origin, pattern.channels))
        black = float(np.mean(self.calibration.black_level))
        return alike(self.codes, candidates, black, self.calibration.white_level)


def proofs(look: Look) -> Iterator[Proof | None]:
    """What a frame that has seen light proves wrong: the first proof is the one that is told; None: a check that found nothing.

    How bytes are read comes before what they say: in a wrong format levels and place are wrong too, and their remedies lead astray.
    """
    yield from (_misread(look, reading) for reading in _clearer_readings(look))
    if look.shown or not look.aligned:
        yield look.wrong_levels
    if _has_another_below(look):
        yield _too_tall(look)
    if look.found and not look.shown:
        yield _wrong_place(look, look.found)
    reading = look.reading if look.aligned and not look.found else None
    if reading:
        same = look.confirmed and (reading.format, reading.skipped) == (look.layout.format, 0)
        yield _too_tall(look) if same else _misread(look, reading)
    if not look.found:
        yield look.wrong_levels
    if not look.found and look.aligned and look.levels.show_no_filters(look.pattern):
        seen = "the samples at the places of the colour filters are as bright as their neighbours"
        yield Proof(seen, "a sensor without colour filters, or another `pattern`, `period` or `origin`")
    padding = look.layout.width - look.width
    if look.shown and padding:
        seen = f"its rows have {padding} samples at the end that are the same in all of them"
        yield Proof(seen, f"`width={look.width}` `stride={look.layout.stride}`")
    if look.shown and look.coloured not in (None, look.pattern):
        yield _wrong_colours(look)


def _clearer_readings(look: Look) -> Iterator[Reading]:
    """Other strides, formats and orders of bytes in which the pattern shows more clearly."""

    def is_clearer(other: Found, times: float = CLEARER) -> bool:
        return look.found is None or other.explained > times * look.found.explained

    layout = look.layout
    if not (look.shown and look.aligned):
        reading = look.restrided
        if reading and is_clearer(reading.found, CLEARER if look.aligned else 1 / CLEARER):
            yield reading
    reading = look.reading if look.searched else None
    if reading and reading.format != layout.format and is_clearer(reading.found):
        yield reading
    swapped_format = {"u16": "u16be", "u16be": "u16"}.get(layout.format)
    if look.shown and swapped_format:  # the low byte alone may show the pattern too, faintly
        swapped = find_pattern(look.codes.byteswap(), look.pattern)
        if swapped and is_clearer(swapped):
            yield Reading(swapped_format, layout.stride, 0, layout.width, swapped)


def _has_another_below(look: Look) -> bool:
    """Whether the pattern is at another row in the lower part: then the next frame begins in this one."""
    codes, pattern = look.codes, look.pattern
    if not look.shown:
        above = None if look.found else find_pattern(codes[: len(codes) // 2], pattern)
        if above is None or not above.fits(pattern):
            return False
    for part in (2, 4):
        top = len(codes) * (part - 1) // part
        found = find_pattern(codes[top:], pattern)
        if found and found.sure and found.period == pattern.period:
            rows = {(row + top) % found.period for row, _ in found.places}
            if pattern.block_origin[0] not in rows:
                return True
    return False


def _too_tall(look: Look) -> Proof:
    return Proof(f"a frame ends and the next begins at another row than after {look.layout.height}", "another `height`")


def _wrong_place(look: Look, found: Found) -> Proof:
    """The period of the colour sites, and where they are: elsewhere than described."""
    layout, pattern = look.layout, look.pattern
    if look.confirmed:
        return _too_tall(look)
    if found.period == 2:
        bayer = "an ordinary Bayer sensor, whose raw files other programs develop"
        return Proof("its colours repeat every 2 pixels", f"{bayer}, or one with scattered colours, which `pattern` describes")
    if pattern.is_scattered and look.coloured:
        found = replace(found, block_origin=look.coloured.origin)
    reading = look.search.refined(Reading(layout.format, layout.stride, 0, layout.width, found))
    if reading.stride != layout.stride:
        return _misread(look, reading)
    where = f"its colour sites repeat every {found.period} pixels, from row and column {found.block_origin} on"
    return Proof(where, " ".join(_place(look, found)))


def _wrong_colours(look: Look) -> Proof:
    pattern = look.coloured or look.pattern
    if pattern.is_scattered:
        return Proof("its colours are at other sites of the tile", f"`origin={pattern.origin[0]} {pattern.origin[1]}`")
    letters = "".join(pattern.channels[channel] for *_, channel in pattern.sites)
    others = "RGGB or BGGR" if letters in ("RGGB", "BGGR") else "GRBG or GBRG"
    return Proof("the two greens of a block lie on the other diagonal", f"`pattern` with blocks {others}")


def _misread(look: Look, reading: Reading) -> Proof:
    """What to say of a frame in which the pattern appears in another reading."""
    layout, reading = look.layout, look.search.refined(reading)
    seen, options = [], []
    if reading.stride != layout.stride:
        seen.append(f"its rows repeat every {reading.stride} bytes, not {layout.stride}")
    if reading.format == "u8":
        seen.append("its samples are single bytes")
        remedy = "`pixel_format=u8`, or unpacked frames, if that is a lossy compression: rpicam-raw --mode W:H:12:U"
        return Proof(", and ".join(seen), remedy)
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
    elif not reading.found.fits(look.pattern):
        options += _place(look, reading.found)
    return Proof(", and ".join(seen or ["its samples lie elsewhere"]), " ".join(options))


def _place(look: Look, found: Found) -> list[str]:
    """The options that describe where the pattern was found."""
    pattern = look.pattern
    same = found.period == pattern.period
    shift = [origin - block if same else 0 for origin, block in zip(pattern.origin, pattern.block_origin, strict=True)]
    row, column = ((place + moved) % found.period for place, moved in zip(found.block_origin, shift, strict=True))
    return [*([] if same else [f"`period={found.period}`"]), f"`origin={row} {column}`"]
