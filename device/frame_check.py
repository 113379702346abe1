"""Whether frames are what their description says: the first that shows its filter pattern proves it, or proves it wrong.

Raw frames have no header. In a wrong layout, or with a wrong pattern, they would be saved as pictures that look like noise or have
false colours. The samples themselves tell: rows resemble the next ones, colour sites are darker than their neighbours at one
period and one place only, the two greens of a block are equal, and no picture is darker than black.
"""

from collections.abc import Callable, Iterable, Iterator
from math import gcd
from typing import TYPE_CHECKING

import numpy as np

from shared.arrays import CodeArray
from shared.errors import InputError

from .block_order import green_diagonal_is_wrong
from .frames import RawFrame
from .layout_search import BIG_ENDIAN, BYTES, Reading, best_reading
from .pattern_search import Found, Tiles, find_pattern
from .stride_search import likely_strides

if TYPE_CHECKING:
    from .capture import Sensor

_UNPROVEN = "the first frame does not show whether size, format and pattern are right (dark, even or noisy): the next are looked at"
_MARGIN = 1 / 16  # of the black level: a black level that is known less well than this is wrong
_DEEP = 3 / 4  # of the black level: no tile of a frame is darker, on average
_CLEARER = 1.3  # times as much variance explained: one reading is better than another
_PILE = 8  # samples at the highest code that show that light was clipped there
_LIT = 0.03  # of the range of codes: a tile with less light says nothing of its filters
_SAME = 0.85  # a colour filter that passes more than this, of what all filters pass together, is none
_TWICE = 2  # convincing frames; the second shows that the first has as many rows as described


class FrameCheck:
    """Compares frames with the description of their sensor, until some have confirmed it.

    sensor: the description.
    """

    def __init__(self, sensor: "Sensor") -> None:
        self._sensor = sensor
        self._sites = tuple((row, column) for row, column, _ in sensor.pattern.sites)
        self._looked = 0
        self._confirmed = 0

    @property
    def done(self) -> bool:
        """Whether enough frames have confirmed the description."""
        return self._confirmed == _TWICE

    def look(self, frame: RawFrame) -> bool:
        """Whether the frame confirms the description. Raises InputError, with the likely right one, if it proves it wrong."""
        self._looked += 1
        pattern, layout = self._sensor.pattern, self._sensor.layout
        codes = layout.unpack(frame.data)
        wrong_levels = self._wrong_levels(codes)
        found = find_pattern(codes, self._sites)
        confirmed = self._is_declared(found)
        if found and not (confirmed or found.sure):
            found = None
        # The stride is searched for where it may matter; a frame that shows nothing is searched the less often, the more there are.
        if self._confirmed or not (found or wrong_levels or self._looked & (self._looked - 1) == 0):
            strides = [layout.stride]
        else:
            strides = likely_strides(frame.data, layout.stride)
        # What repeats after a row also repeats after several.
        aligned = bool(strides) and strides[0] % layout.stride == 0
        # A part of the rows has the same period as all, if the two have no divisor in common.
        others = [stride for stride in strides if stride % layout.stride or gcd(stride // layout.stride, pattern.period) > 1]
        others = [stride for stride in others if stride != layout.stride]
        if others and not (confirmed and aligned):
            self._check_stride(frame, found, others, aligned=aligned)
        if confirmed and found and layout.format == "u16":  # the low byte alone may show the pattern, faintly
            swapped = find_pattern(codes.byteswap(), self._sites)
            if swapped and swapped.explained > _CLEARER * found.explained:
                raise self._misread(Reading(BIG_ENDIAN, layout.stride, 0, layout.width, swapped))
        if wrong_levels and (confirmed or not aligned):
            raise wrong_levels
        if confirmed:
            if green_diagonal_is_wrong(codes, pattern, self._sensor.calibration.white_level):
                raise _misfit("the two greens of a block lie on the other diagonal", self._other_orders())
            self._check_below(codes)
            self._confirmed += 1
            return True
        if found:
            raise self._elsewhere(found)
        if self._is_declared(find_pattern(codes[: len(codes) // 2], self._sites)):
            self._check_below(codes)
        if aligned:
            if reading := best_reading(frame.data, layout, pattern, [layout.stride]):
                raise self._misread(reading)
            if wrong_levels:
                raise wrong_levels
            self._check_filters(codes)
        return False

    def _is_declared(self, found: Found | None) -> bool:
        pattern = self._sensor.pattern
        return found is not None and (found.period, found.block_origin) == (pattern.period, pattern.block_origin)

    def _check_below(self, codes: CodeArray) -> None:
        """Refuse a frame in whose lower part the pattern is at another row: the next frame begins in this one."""
        pattern = self._sensor.pattern
        for part in (2, 4):
            top = len(codes) * (part - 1) // part
            found = find_pattern(codes[top:], self._sites)
            if (
                found
                and found.sure
                and found.period == pattern.period
                and (found.block_origin[0] + top) % found.period != pattern.block_origin[0]
            ):
                raise self._too_tall()

    def _too_tall(self) -> InputError:
        height = self._sensor.layout.height
        return _misfit(f"a frame ends and the next begins at another row than after {height}", "another --height")

    def _check_stride(self, frame: RawFrame, found: Found | None, others: list[int], *, aligned: bool) -> None:
        layout = self._sensor.layout
        reading = best_reading(frame.data, layout, self._sensor.pattern, others)
        clearer = _CLEARER if aligned else 1 / _CLEARER
        if reading and (found is None or reading.found.explained > clearer * found.explained):
            raise self._misread(reading)

    def _wrong_levels(self, codes: CodeArray) -> InputError | None:
        """What the levels of the samples prove wrong, if anything."""
        calibration, layout = self._sensor.calibration, self._sensor.layout
        highest = int(codes.max())
        black = float(np.mean(calibration.black_level))
        bits = max(highest.bit_length(), 10)
        # Sensors have 10 bits or 12; one of 10 has its black at 64, and no dim frame lies twice as high.
        stored = 12 if bits < 12 and np.percentile(codes[::8, ::8], 1) > 2 << (bits - 4) else bits
        likely = (
            f"--bits {stored}"
            if layout.format == "u16" and stored != calibration.bits
            else "another --format, or --camera with its levels"
        )
        if bits > calibration.bits:
            return _misfit(f"a sample is {highest}, more than {calibration.bits} bits hold", likely)
        if codes.mean() < black * (1 - _MARGIN):
            return _misfit(f"the mean of all samples is {codes.mean():.0f}, darker than black, which is {black:.0f}", likely)
        darkest = float(Tiles.of(codes).parts.mean(axis=(1, 2)).min())
        if darkest < black * _DEEP:
            return _misfit(f"a part of it has a mean of {darkest:.0f}, darker than black, which is {black:.0f}", likely)
        if bits < calibration.bits and highest == (1 << bits) - 1:
            clipped, below = (int((codes == code).sum()) for code in (highest, highest - 1))
            if clipped > 4 * below + _PILE:
                return _misfit(
                    f"its light is clipped at {highest}, the highest code of {bits} bits, not at {calibration.white_level}", likely
                )
        return None

    def _check_filters(self, codes: CodeArray) -> None:
        """Refuse a lit frame in which the colour sites are as bright as the panchromatic ones, so that they have no filters."""
        calibration, pattern = self._sensor.calibration, self._sensor.pattern
        black = calibration.black_level[-1]
        tiles = Tiles.of(codes)
        side = tiles.parts.shape[1]
        ratios = []
        for part, (top, left) in zip(tiles.parts - black, tiles.places.tolist(), strict=True):
            panchromatic = pattern.panchromatic_mask((side, side), (top, left))
            level = part[panchromatic].mean()
            if level / (calibration.white_level - black) > _LIT and part.max() < calibration.white_level - black:
                ratios.append(part[~panchromatic].mean() / level)
        if len(ratios) > _PILE and np.mean(ratios) - 4 * np.std(ratios) / len(ratios) ** 0.5 > _SAME:
            raise _misfit(
                "the samples at the places of the colour filters are as bright as their neighbours",
                "a sensor without colour filters, or another --period and --origin",
            )

    def _elsewhere(self, found: Found) -> InputError:
        if self._confirmed:
            return self._too_tall()
        if found.period == 2:
            return _misfit("its colours repeat every 2 pixels", "an ordinary Bayer sensor, whose raw files other programs develop")
        period = self._sensor.pattern.period
        where = f"its colour sites repeat every {found.period} pixels, from row and column {found.block_origin} on"
        return _misfit(where, f"{f'--period {found.period} ' if found.period != period else ''}{self._origin(found)}")

    def _misread(self, reading: Reading) -> InputError:
        layout = self._sensor.layout
        seen = (
            f"its rows repeat every {reading.stride} bytes, not {layout.stride}"
            if reading.stride != layout.stride
            else "its samples"
        )
        if reading.format == BIG_ENDIAN:
            return _misfit(f"{seen} are words with the high byte first", "a source with little-endian words (swap the bytes)")
        if reading.format == BYTES:
            return _misfit(
                f"{seen} are single bytes",
                "8 bits or a lossy compression; ask the camera for unpacked frames: rpicam-raw --mode W:H:12:U",
            )
        options = []
        if reading.format != layout.format:
            seen += f" are packed as {reading.format}, not as {layout.format}"
            options.append(f"--format {reading.format}")
        if reading.stride != layout.stride:
            options.append(f"--stride {reading.stride}")
        if reading.width < layout.width:
            options.append(f"--width {reading.width} or less")
        if reading.skipped:
            seen += f" begin {reading.skipped} bytes (or whole groups of samples more) after the beginning of the frame"
            options.append("a stream without a header")
        if not self._is_declared(reading.found) and not reading.skipped:
            if reading.found.period != self._sensor.pattern.period:
                options.append(f"--period {reading.found.period}")
            options.append(self._origin(reading.found))
        return _misfit(seen, " ".join(options))

    def _origin(self, found: Found) -> str:
        pattern = self._sensor.pattern
        shift = [origin - block for origin, block in zip(pattern.origin, pattern.block_origin, strict=True)]
        if found.period != pattern.period:
            shift = [0, 0]
        row, column = ((place + moved) % found.period for place, moved in zip(found.block_origin, shift, strict=True))
        return f"--origin {row} {column}"

    def _other_orders(self) -> str:
        letters = "".join(self._sensor.pattern.channels[channel] for *_, channel in self._sensor.pattern.sites)
        return "--order GRBG or GBRG" if letters in ("RGGB", "BGGR") else "--order RGGB or BGGR"


def checked(frames: Iterable[RawFrame], sensor: "Sensor", note: Callable[[str], None]) -> Iterator[RawFrame]:
    """Pass frames on, and look at them until some have confirmed the description of their sensor.

    note: called with a sentence if the first frame shows nothing.
    Raises InputError, before the frame is passed on, at the first that proves the description wrong; it names the likely right one.
    """
    check = FrameCheck(sensor)
    for number, frame in enumerate(frames):
        if not check.done:
            try:
                confirmed = check.look(frame)
            except InputError as error:
                raise InputError(f"{frame.source}: {error}" if frame.source else str(error)) from None
            if not number and not confirmed:
                note(_UNPROVEN)
        yield frame


def _misfit(seen: str, likely: str) -> InputError:
    return InputError(f"the frame is not as described: {seen}; likely {likely}. If the description is right, add --unchecked")
