"""What one frame shows: everything that checks compare with the description of its sensor."""

from dataclasses import replace
from functools import cached_property
from math import gcd

import numpy as np

from shared.arrays import CodeArray
from shared.pattern import CfaPattern

from ..frames import RawFrame
from ..sensor import Sensor
from .colour_search import alike
from .layout_search import PLAIN, Reading, best_reading
from .level_check import Levels, Proof, columns_of_light
from .pattern_search import Found, find_pattern
from .stride_search import likely_strides

_TRIED = 2  # strides; the right one is the likeliest or the next


class Look:
    """A look at a frame; what it shows is found when it is first asked for.

    frame: the frame.
    sensor: its description.
    confirmed: whether an earlier frame has shown the pattern where it is said to be: stride and format are right, then.
    thorough: whether stride and format are searched for in a frame that shows nothing; this takes time.
    """

    def __init__(self, frame: RawFrame, sensor: Sensor, *, confirmed: bool, thorough: bool) -> None:
        self.data, self.confirmed, self._thorough = frame.data, confirmed, thorough
        self.layout, self.pattern, self.calibration = sensor.layout, sensor.pattern, sensor.calibration
        self.codes = self.layout.unpack(frame.data)

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
        return likely_strides(self.data, self.layout.stride) if self.searched else [self.layout.stride]

    @property
    def aligned(self) -> bool:
        """Whether rows resemble each other at the declared stride: what repeats after a row also repeats after several."""
        return bool(self.strides) and self.strides[0] % self.layout.stride == 0

    @property
    def restrided(self) -> Reading | None:
        """A reading at another stride: a part of the rows has the period of all if the two have no divisor in common."""
        ours, period = self.layout.stride, self.pattern.period
        others = [each for each in self.strides if each != ours and (each % ours or gcd(each // ours, period) > 1)][:_TRIED]
        return best_reading(self.data, self.layout, self.pattern, others)

    @cached_property
    def reading(self) -> Reading | None:
        """Another format, at the declared stride, in which the pattern appears; None where the declared one shows it plainly."""
        if (self.shown and self.shown.explained >= PLAIN) or not (self.searched or self.aligned):
            return None
        return best_reading(self.data, self.layout, self.pattern, [self.layout.stride])

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
