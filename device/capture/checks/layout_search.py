"""Other readings of a frame's bytes: the stride and the format in which its filter pattern appears."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import gcd

import numpy as np

from shared.arrays import CodeArray
from shared.pattern import PERIODS, CfaPattern

from ..frames import FORMATS, FrameLayout
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


def best_reading(
    data: bytes | bytearray | memoryview, layout: FrameLayout, pattern: CfaPattern, strides: list[int]
) -> Reading | None:
    """The reading that shows the pattern most clearly; None if none does.

    data: a frame, in the declared `layout`.
    strides: those to try, such as `likely_strides` finds.
    """
    best: Reading | None = None
    for name, stride, skipped in _candidates(layout, strides):
        reading = _reading(data, layout, pattern, name, stride, skipped)
        if reading is None:
            continue
        is_there = reading.found.fits(pattern)
        # Stripes may repeat in a wrong format too, but hardly at the declared place, nor as plainly.
        if name != layout.format and not is_there and reading.found.explained < PLAIN:
            continue
        if best is None or reading.found.explained > best.found.explained:
            best = reading
        if name == layout.format and is_there and reading.found.explained >= PLAIN:
            break
    return best


def refined(data: bytes | bytearray | memoryview, layout: FrameLayout, pattern: CfaPattern, reading: Reading) -> Reading:
    """The reading, or one that shows the pattern more clearly among those that resemble it: the likely right one.

    Rows that are some whole periods too long, or several rows in one, show the pattern too, but at drifting places.
    """
    packing = FORMATS[reading.format]
    if reading.skipped or reading.found.period != pattern.period:
        return reading
    stride, step = reading.stride, pattern.period * packing.length // gcd(pattern.period * packing.length, packing.pixels)
    # Where every other pixel has a colour, rows that are shifted by a pixel or two show the pattern too.
    shifts = range(-2 * packing.length, 2 * packing.length + 1)
    # Stride -> how much less clearly the pattern may show there. Of several rows in one, the part that shows it as well is right.
    others = {stride + step * count: 1 / CLEARER for count in range(-_NEAR, _NEAR + 1)}
    others |= {stride * factor: 1 / CLEARER for factor in _PARTS}
    others |= {(stride + shift) // factor: 1.0 for factor in (1, *_PARTS) for shift in shifts if (stride + shift) % factor == 0}
    others |= {stride // factor: CLEARER for factor in _PARTS if stride % factor == 0}
    best, clearest = reading, reading.found.explained
    for other, weight in others.items():
        if other < packing.length * _LEAST_GROUPS or (other, reading.format) == (layout.stride, layout.format):
            continue
        found = _reading(data, layout, pattern, reading.format, other, 0)
        if found and weight * found.found.explained > clearest:
            best, clearest = found, weight * found.found.explained
    return best


def _reading(
    data: bytes | bytearray | memoryview, layout: FrameLayout, pattern: CfaPattern, name: str, stride: int, skipped: int
) -> Reading | None:
    """The frame in one format and stride, if it shows the pattern's period there."""
    codes = _unpacked(memoryview(data)[skipped:], name, stride, layout.width)
    # In a wrong layout the next frame may begin below the middle, with its pattern at another place.
    parts = [codes[: len(codes) // 2]] if codes.size > _ENOUGH else [codes, codes[: len(codes) // 2]]
    for part in parts:
        if min(part.shape, default=0) > pattern.period:
            found = find_pattern(part, pattern)
            if found and (found.sure or found.explained >= _OBVIOUS):
                known = found.period == pattern.period or (name != layout.format and found.period in PERIODS)
                width = layout.width if codes.shape[1] == layout.width else _unlike(codes)
                return Reading(name, stride, skipped, width, found) if known else None
    return None


def _unlike(codes: CodeArray) -> int:
    """Number of columns up to the last one in which rows differ."""
    return int(np.flatnonzero(codes.max(axis=0) > codes.min(axis=0))[-1]) + 1


def _candidates(layout: FrameLayout, strides: list[int]) -> Iterator[tuple[str, int, int]]:
    for stride in strides:
        yield layout.format, stride, 0
    for stride in strides:
        yield from ((name, stride, 0) for name in _SEARCHED if name != layout.format)
    for name in _SEARCHED:  # without padding
        tight = FrameLayout(layout.width, 1, name).stride
        if name != layout.format and tight not in strides:
            yield name, tight, 0
    for stride in strides:
        yield from ((layout.format, stride, skipped) for skipped in range(1, FORMATS[layout.format].length))


def _unpacked(data: memoryview, name: str, stride: int, width: int) -> CodeArray:
    height = len(data) // stride
    lines = data[: height * stride]
    packing = FORMATS[name]
    fits = min(width, stride // packing.length * packing.pixels)
    if not fits or not height:
        return np.empty((0, 0), np.uint16)
    return FrameLayout(fits, height, name, stride).unpack(lines)
