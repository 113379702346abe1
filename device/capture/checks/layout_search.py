"""Other readings of a frame's bytes: the stride and the format in which its filter pattern appears.

Whatever the format, rows resemble each other: the stride is the distance at which the bytes resemble themselves most.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray

from shared.arrays import CodeArray, DoubleArray
from shared.pattern import PERIODS, CfaPattern

from ..frames import FORMATS, Bytes, FrameLayout
from .level_check import end_of
from .pattern_search import Found, find_pattern

_ENOUGH = 1 << 20  # samples, of which half show the pattern as well as all
CLEARER = 1.3
"""Times as much variance explained, by which one reading of a frame is better than another."""
PLAIN = 0.06
"""Part of the variance that a pattern explains in the right format alone. Of eight photographs and the built-in scene, at K = 4, 6
and 8, with noise up to 0.03, at most 0.03 is explained in a wrong format, and 0.12 or more in the right one."""
_OBVIOUS = 4 * PLAIN  # in few tiles too; rows that are shifted by two pixels explain up to 0.1
_NEAR = 12  # periods by which a row may be longer or shorter
_LEAST_GROUPS = 8  # of samples in a row
_PARTS = (2, 3)  # rows that may be taken for one
_SEARCHED = ("raw10", "raw12", "u16", "u16be", "u8", "raw14")  # machine vision says which format it sends

_BYTES = 1 << 19  # of the middle of a frame
_SMOOTH = 61  # samples of the running mean that is subtracted
_BAND = 2049  # frequencies over which the spectrum is evened out
# A frequency counts at most this many times its surroundings: the lower bits of packed samples come at regular distances.
_LINE = 30.0
_CLEAR = 8.0  # a peak stands out by this many times the usual deviation
_HALF = 0.4  # of the height of another peak


@dataclass(frozen=True)
class Reading:
    """A reading of a frame in which the colour sites appear.

    format: a key of FORMATS.
    stride: bytes from one line to the next.
    skipped: bytes before the first sample, less than a group of packed samples.
    width: pixels, the declared ones if as many fit; otherwise those before the padding, whose bytes are the same in all rows.
    found: where the colour sites are.
    """

    format: str
    stride: int
    skipped: int
    width: int
    found: Found


@dataclass(frozen=True)
class LayoutSearch:
    """A search for the layout of a frame. data: its bytes. layout, pattern: the declared ones."""

    data: Bytes
    layout: FrameLayout
    pattern: CfaPattern

    def best(self, strides: Sequence[int]) -> Reading | None:
        """The reading that shows the pattern most clearly; None if none does. strides: those to try."""
        best: Reading | None = None
        for name, stride, skipped in candidates(self.layout, strides):
            if not (reading := self._reading(name, stride, skipped)):
                continue
            is_declared, plain = name == self.layout.format, reading.found.explained >= PLAIN
            is_there = reading.found.fits(self.pattern)
            # Stripes may repeat in a wrong format too, but hardly at the declared place, nor as plainly.
            if not (is_declared or is_there or plain):
                continue
            if best is None or reading.found.explained > best.found.explained:
                best = reading
            if is_declared and is_there and plain:
                break
        return best

    def refined(self, reading: Reading) -> Reading:
        """The reading, or one that shows the pattern more clearly among those that resemble it: the likely right one.

        Rows that are some whole periods too long, or several rows in one, show the pattern too, but at drifting places.
        """
        packing, period, stride = FORMATS[reading.format], self.pattern.period, reading.stride
        if reading.skipped or reading.found.period != period:
            return reading
        step = period * packing.length // gcd(period * packing.length, packing.pixels)
        # Where every other pixel has a colour, rows that are shifted by a pixel or two show the pattern too.
        shifts = range(-2 * packing.length, 2 * packing.length + 1)
        # Stride -> how much less clearly the pattern may show there. Of several rows in one, a part that shows it as well is right.
        others = {stride + step * count: 1 / CLEARER for count in range(-_NEAR, _NEAR + 1)}
        others |= {stride * factor: 1 / CLEARER for factor in _PARTS}
        others |= {(stride + shift) // factor: 1.0 for factor in (1, *_PARTS) for shift in shifts if (stride + shift) % factor == 0}
        others |= {stride // factor: CLEARER for factor in _PARTS if stride % factor == 0}
        best, clearest = reading, reading.found.explained
        for other, weight in others.items():
            if other < packing.length * _LEAST_GROUPS or (other, reading.format) == (self.layout.stride, self.layout.format):
                continue
            found = self._reading(reading.format, other)
            if found and weight * found.found.explained > clearest:
                best, clearest = found, weight * found.found.explained
        return best

    def _reading(self, name: str, stride: int, skipped: int = 0) -> Reading | None:
        """The frame in one format and stride, if it shows the pattern's period there."""
        layout, period = self.layout, self.pattern.period
        codes = read_as(self.data, layout, name, stride, skipped)
        height, width = codes.shape
        if min(height, width) <= period:
            return None
        # In a wrong layout the next frame may begin below the middle, with its pattern at another place.
        for part in [codes[: height // 2]] if codes.size > _ENOUGH else [codes, codes[: height // 2]]:
            found = find_pattern(part, self.pattern) if len(part) > period else None
            if found and (found.sure or found.explained >= _OBVIOUS):
                known = found.period == period or (name != layout.format and found.period in PERIODS)
                width = width if width == layout.width else end_of(codes.max(axis=0) > codes.min(axis=0))
                return Reading(name, stride, skipped, width, found) if known else None
        return None


def candidates(layout: FrameLayout, strides: Sequence[int], formats: Iterable[str] = _SEARCHED) -> Iterator[tuple[str, int, int]]:
    """Yield (format, stride, bytes before the first sample) of other readings of a frame that is described, the likeliest first."""
    declared, others = layout.format, [name for name in formats if name != layout.format]
    yield from ((declared, stride, 0) for stride in strides)
    yield from ((name, stride, 0) for stride in strides for name in others)
    tight = ((name, FrameLayout(layout.width, 1, name).stride) for name in others)  # without padding
    yield from ((name, stride, 0) for name, stride in tight if stride not in strides)
    yield from ((declared, stride, skipped) for stride in strides for skipped in range(1, FORMATS[declared].length))


def read_as(data: Bytes, layout: FrameLayout, name: str, stride: int, skipped: int) -> CodeArray:
    """The samples of a frame in another reading; empty if no line is as short. layout: the declared one, for its width."""
    packing = FORMATS[name]
    height, width = (len(data) - skipped) // stride, min(layout.width, stride // packing.length * packing.pixels)
    if min(height, width) < 1:
        return np.empty((0, 0), np.uint16)
    return FrameLayout(width, height, name, stride).unpack(memoryview(data)[skipped : skipped + height * stride])


def likely_strides(data: Bytes, stride: int) -> list[int]:
    """The strides, in bytes, that the rows in `data` may have, the likeliest first; none where nothing repeats.

    stride: the declared one; from a third of it to three times as long are found.
    """
    whole = np.frombuffer(data, np.uint8)
    start = max((len(whole) - _BYTES) // 4 * 2, 0)
    part = whole[start : start + min(_BYTES, len(whole) // 2 * 2)]
    found: dict[int, float] = {}
    for words in (part, part.view("<u2"), part.view(">u2")):
        for lag, height in _repeats(words, stride // words.itemsize):
            found[lag * words.itemsize] = max(height, found.get(lag * words.itemsize, 0.0))
    # Two rows further down the picture resembles itself too, and may even do so a little more.
    single = [
        lag for lag in found if not any(lag > other and lag % other == 0 and found[other] > _HALF * found[lag] for other in found)
    ]
    return sorted(single, key=lambda lag: -found[lag])


def _repeats(samples: NDArray[np.unsignedinteger], around: int) -> list[tuple[int, float]]:
    """The two distances at which samples repeat most clearly, each with its height in usual deviations."""
    lags = slice(max(around // 3, 8), min(3 * around + 1, samples.size // 2))
    if lags.stop - lags.start < _SMOOTH:
        return []
    values = samples.astype(np.float64)
    values -= _running_mean(values, _SMOOTH)
    # Twice as long, so that the end is not compared with the beginning.
    power = np.square(np.abs(np.fft.rfft(values, 2 * samples.size)))
    if power.size > 2 * _BAND:
        power = np.minimum(power / (_running_mean(np.sqrt(power), _BAND) ** 2 + 1e-9), _LINE)
    alike = np.fft.irfft(power)[lags]
    heights = alike - np.median(alike)
    heights /= np.median(np.abs(heights)) / 0.6745 + 1e-12
    found = []
    for _ in range(2):
        place = int(heights.argmax())
        if heights[place] > _CLEAR:
            found.append((lags.start + place, float(heights[place])))
        heights[max(place - 8, 0) : place + 9] = 0.0
    return found


def _running_mean(values: DoubleArray, size: int) -> DoubleArray:
    sums = np.cumsum(np.pad(values, (size // 2 + 1, size // 2), "reflect"))
    return (sums[size:] - sums[:-size]) / size
