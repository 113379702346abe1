"""What the levels of samples say of their number of bits, of black, and of the filters before them."""

from typing import NamedTuple

import numpy as np

from shared import CfaPattern, SensorCalibration
from shared.arrays import BoolArray, CodeArray

from .pattern_search import Tiles

_MARGIN = 1 / 16  # of the black level: a black level that is known less well than this is wrong
_LEAST_MARGIN = 1 / 1024  # of the range of codes: a low black level may be off by as much
_NARROW = 1 / 16  # of the range of codes: the samples of a dark frame differ by less, but for defects
_DEFECTS = 1  # percent of the samples at either end that may be defects
_DEEP = 3 / 4  # of the black level: no tile of a frame is darker, on average
_PILE = 8  # samples at the highest code that show that light was clipped there
_LIT = 0.03  # of the range of codes: a tile with less light says nothing of its filters
_SAME = 0.85  # a colour filter that passes more than this, of what all filters pass together, is none
_LEAST = 10  # bits of the samples of any sensor but those of 8 bits
_WORD = 16  # bits of a word, into whose upper bits some drivers shift samples
_HIGH = 2.0  # times the black level: the darkest samples of a frame are rarely brighter
_UNUSED = 2  # bits
_OVEREXPOSED = 0.1  # of the samples: so many clipped ones may hide the filters


class Proof(NamedTuple):
    """What a frame proves wrong in its description, and what is likely right."""

    seen: str
    likely: str


def end_of(flags: BoolArray) -> int:
    """Number of elements up to the last True; 0 if there is none."""
    return len(flags) - int(flags[::-1].argmax()) if flags.any() else 0


def columns_of_light(codes: CodeArray, black: float, white: int) -> int:
    """Number of columns before those at the end of all rows that hold padding: a value that is the same in every row.

    Padding is darker than black, or, where no other column is even, neither black nor clipped light.

    codes: a frame, (H, W).
    """
    uneven = codes.max(axis=0) > codes.min(axis=0)
    if not (kept := end_of(uneven)):
        return len(uneven)
    ends = codes[0, kept:]
    dark = ends < black * _DEEP
    other = (ends < white) & (abs(ends - black) > 1) & uneven[:kept].all()
    return kept + end_of(~(dark | other | (ends > white)))


class Levels:
    """The levels of the samples of a frame, compared with those of its sensor.

    codes: the frame, (H, W).
    calibration: the declared levels.
    are_words: whether the format leaves open how many bits are used.
    """

    def __init__(self, codes: CodeArray, calibration: SensorCalibration, *, are_words: bool) -> None:
        self._codes, self._calibration, self._are_words = codes, calibration, are_words
        self._declared, self._highest = calibration.bits, int(codes.max())
        self._black = float(np.mean(calibration.black_level))
        self._margin = max(_MARGIN * self._black, _LEAST_MARGIN * (1 << self._declared))
        self._low, self._high = (float(np.percentile(codes[::8, ::8], part)) for part in (_DEFECTS, 100 - _DEFECTS))
        # With all samples alike, as in the dark, zeros at the end say nothing.
        used = int(np.bitwise_or.reduce(codes, axis=None))
        shift = (used & -used).bit_length() - 1 if used else 0
        self._shift = shift if self._highest - int(codes.min()) >= 16 << shift else 0
        bits = max(self._highest.bit_length(), min(self._declared, _LEAST))
        self._bits = bits + bits % 2

    def wrong(self, *, in_right_format: bool) -> Proof | None:
        """What they prove wrong, and the remedy; None if nothing.

        in_right_format: the frame shows a pattern, so that its format is right; otherwise that may be what is wrong.
        """
        if not (seen := self._impossible()):
            return None
        if in_right_format or self._seem_covered():
            return Proof(seen, self._likely())
        return Proof(seen, "another `pixel_format`, `stride`, `sensor_bits`, or `camera` with its levels")

    def lit(self) -> Proof | None:
        """What proves that a frame is not dark, or is read in a wrong way, and the remedy; None if nothing does."""
        if self._bits > self._declared:
            return Proof(self._impossible(), self._likely())
        if not self._are_narrow(self._declared):
            seen = f"its samples are {self._low:.0f} to {self._high:.0f}, and those of a dark frame are nearly equal"
            return Proof(seen, "light on the sensor (cover the lens, or leave `covered` out), or another `pixel_format`")
        return None

    def _impossible(self) -> str:
        """What no frame of the sensor is like; "" if nothing."""
        if self._bits > self._declared:
            return f"a sample is {self._highest}, more than {self._declared} bits hold"
        mean, darkest = float(self._codes.mean()), float(Tiles.of(self._codes).parts.mean(axis=(1, 2)).min())
        if mean < self._black - self._margin:
            return f"the mean of all samples is {mean:.0f}, darker than black, which is {self._black:.0f}"
        if darkest < self._black * _DEEP:
            return f"a part of it has a mean of {darkest:.0f}, darker than black, which is {self._black:.0f}"
        if self._bits < self._declared and self._highest == (1 << self._bits) - 1:
            clipped, below = (int((self._codes == code).sum()) for code in (self._highest, self._highest - 1))
            if clipped > 4 * below + _PILE:
                limits = f"the highest code of {self._bits} bits, not at {self._calibration.white_level}"
                return f"its light is clipped at {self._highest}, {limits}"
        return ""

    def are_dark(self) -> bool:
        """Whether all are near black, as in no wrong layout of a lit frame."""
        return abs(float(self._codes.mean()) - self._black) < self._margin and self._highest < _HIGH * self._black + self._margin

    def hiding(self) -> str:
        """What keeps a frame that is not dark from showing its filters."""
        clipped = float((self._codes >= self._calibration.white_level).mean())
        if clipped > _OVEREXPOSED:
            return f"{100 * clipped:.0f} % of its samples are clipped: it is overexposed"
        return "it is even, noisy or too dim"

    def unsettled(self) -> str:
        """A remark on what they leave open; "" if nothing. Packed samples always have the bits of their format."""
        declared = self._declared
        if not self._are_words:
            return ""
        if self._shift >= _UNUSED and declared < _WORD:
            shifted = f"its samples never use the lowest {self._shift} bits: they may be shifted up"
            return f"{shifted}; then `sensor_bits={_WORD}` is right"
        if declared - self._highest.bit_length() >= _UNUSED:
            dim = f"its samples never use the highest of {declared} bits: the light is dim"
            return f"{dim}, or they have fewer; then give `sensor_bits`"
        if self._low > _HIGH * self._black + self._margin and self._highest < self._calibration.white_level:
            return f"even its darkest samples are far above black, {self._black:.0f}: is `sensor_bits={declared}` right?"
        return ""

    def show_no_filters(self, pattern: CfaPattern) -> bool:
        """Whether there is light, and the colour sites are as bright as the panchromatic ones."""
        black, white = self._calibration.black_level[-1], self._calibration.white_level
        tiles = Tiles.of(self._codes)
        side = tiles.parts.shape[1]
        ratios = []
        for part, (top, left) in zip(tiles.parts - black, tiles.places.tolist(), strict=True):
            panchromatic = pattern.panchromatic_mask((side, side), (top, left))
            level = part[panchromatic].mean()
            if level / (white - black) > _LIT and part.max() < white - black:
                ratios.append(part[~panchromatic].mean() / level)
        return len(ratios) > _PILE and bool(np.mean(ratios) - 4 * np.std(ratios) / len(ratios) ** 0.5 > _SAME)

    def _likely(self) -> str:
        if self._seem_covered():
            return (
                "`covered`, if the lens is covered, and `black=N` with the sensor's black level if it is known; or another "
                "`pixel_format`, `stride` or `sensor_bits`"
            )
        bits = self._bits
        if self._shift >= _UNUSED:
            bits = _WORD
        elif bits < 12 and self._low > _HIGH * (1 << (bits - 4)):  # a sensor of 10 bits has its black at 64, one of 12 at 256
            bits = 12
        if self._are_words and bits != self._declared:
            return f"`sensor_bits={bits}`"
        return "`black=N` with the sensor's own black level, another `pixel_format`, or `camera` with its levels"

    def _seem_covered(self) -> bool:
        """Whether they may be a dark frame's, of a sensor whose black level is lower."""
        return self._are_narrow(self._bits) and self._highest < self._black

    def _are_narrow(self, bits: int) -> bool:
        return self._high - self._low < _NARROW * (1 << bits)
