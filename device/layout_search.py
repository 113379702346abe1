"""Other readings of a frame's bytes: the stride and the format in which its filter pattern appears."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from shared.arrays import CodeArray
from shared.pattern import CfaPattern

from .frames import FORMATS, FrameLayout
from .pattern_search import Found, find_pattern

BIG_ENDIAN, BYTES = "big-endian u16", "8 bits"
_ENOUGH = 1 << 20  # samples, of which half show the pattern as well as all
_FOREIGN = {BIG_ENDIAN: ">u2", BYTES: "u1"}  # not supported, but recognised, so that the right remedy can be named


@dataclass(frozen=True)
class Reading:
    """A reading of a frame in which the colour sites appear.

    format: a key of FORMATS, BIG_ENDIAN or BYTES.
    stride: bytes from one line to the next.
    skipped: bytes before the first sample, less than a group of packed samples.
    width: pixels, the declared ones if so many fit.
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
    sites = tuple((row, column) for row, column, _ in pattern.sites)
    best: Reading | None = None
    for name, stride, skipped in _candidates(layout, strides):
        codes = _unpacked(memoryview(data)[skipped:], name, stride, layout.width)
        # In a wrong layout the next frame may begin below the middle, with its pattern at another place.
        parts = [codes[: len(codes) // 2]] if codes.size > _ENOUGH else [codes, codes[: len(codes) // 2]]
        parts = [part for part in parts if min(part.shape, default=0) > pattern.period]
        found = next((seen for part in parts if (seen := find_pattern(part, sites)) and seen.sure), None)
        if found is None or found.period != pattern.period:
            continue
        # Stripes may repeat in a wrong format too, but hardly at the declared place.
        if name != layout.format and found.block_origin != pattern.block_origin:
            continue
        if best is None or found.explained > best.found.explained:
            best = Reading(name, stride, skipped, codes.shape[1], found)
        if name == layout.format and (found.period, found.block_origin) == (pattern.period, pattern.block_origin):
            break
    return best


def _candidates(layout: FrameLayout, strides: list[int]) -> Iterator[tuple[str, int, int]]:
    for stride in strides:
        yield layout.format, stride, 0
    for stride in strides:
        yield from ((name, stride, 0) for name in (*FORMATS, *_FOREIGN) if name != layout.format)
        yield from ((layout.format, stride, skipped) for skipped in range(1, FORMATS[layout.format].length))


def _unpacked(data: memoryview, name: str, stride: int, width: int) -> CodeArray:
    height = len(data) // stride
    lines = data[: height * stride]
    if name in _FOREIGN:
        rows = np.frombuffer(lines, np.uint8).reshape(height, stride)
        size = np.dtype(_FOREIGN[name]).itemsize
        samples = np.ascontiguousarray(rows[:, : stride // size * size]).view(_FOREIGN[name])
        return samples[:, :width].astype(np.uint16)
    packing = FORMATS[name]
    fits = min(width, stride // packing.length * packing.pixels)
    if not fits or not height:
        return np.empty((0, 0), np.uint16)
    return FrameLayout(fits, height, name, stride).unpack(lines)
