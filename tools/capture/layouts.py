"""The layout of a raw frame that shows no filters as it is described: the format and stride with
which the bytes do.

Whatever the format, rows resemble each other: the stride is the distance at which the bytes
resemble themselves most.
"""

from collections.abc import Iterator
from contextlib import suppress
from itertools import product

import numpy as np

from ...device.capture.frames import FORMATS, Bytes, FrameLayout
from ...shared import CodeArray
from .identity import identify

# strides at which rows repeat most; groups of samples by which they may be wrong
_LIKELY, _NEAR = 2, 2
_BYTES = 1 << 19  # of the middle of a frame
# What each reading is tried with: rows in the middle of the frame, and windows of these; all of a
# frame would take ten times as long.
_TRIED_ROWS, _TRIED_WINDOWS = 512, 64
_SMOOTH = 61  # samples of the running mean that is subtracted
_BAND = 2049  # frequencies over which the spectrum is evened out
# A frequency counts at most this many times its surroundings: the lower bits of packed samples come
# at regular distances.
_LINE = 30.0
_CLEAR = 8.0  # a peak stands out by this many times the usual deviation


def likely_reading(data: Bytes, layout: FrameLayout) -> str:
    """Name the options with which the bytes of a frame show a tile that has a name, and that name.
    "" if there are none.

    A wrong layout hardly ever shows such a tile: of 108 pairs of formats and tiles none did.

    data: the bytes of a frame. layout: the layout in which they show no tile.
    """
    for readings in _readings(data, layout):
        named = []
        for name, stride in readings:
            identity = identify(_read_as(data, layout.width, name, stride), _TRIED_WINDOWS)
            if identity and identity.name:
                named.append((identity.certainty, identity.name, name, stride))
        if named:
            _, tile, name, stride = max(named)
            options = _options(layout, name, stride)
            return f"likely {options}, which shows the tile {tile}" if options else ""
    return ""


def _readings(data: Bytes, layout: FrameLayout) -> Iterator[set[tuple[str, int]]]:
    """Yield the likely readings of a frame, format and stride in bytes, then less likely ones:
    strides that are a little off.
    """
    # Scattered sites repeat in every other row, too, and rows that are shifted by a pixel or two
    # resemble each other even more.
    likely = list[int]()
    with suppress(ModuleNotFoundError):  # SciPy is needed, which a camera may not have
        likely = likely_strides(data, layout.stride)
    repeats = [each for stride in likely for each in (stride, stride // 2)]
    tight = {name: FrameLayout(layout.width, 1, name).stride for name in FORMATS}
    strides = [layout.stride, tight[layout.format], *repeats]
    yield {*product(FORMATS, strides), *tight.items()}
    most = _NEAR * FORMATS[layout.format].length
    near = (stride + shift for stride in repeats for shift in range(-most, most + 1))
    yield {(layout.format, stride) for stride in near if stride > 0}


def _read_as(data: Bytes, most: int, name: str, stride: int) -> CodeArray:
    """Unpack the samples in the middle of a frame in another reading, `most` of a line at most;
    empty if no line is as short.
    """
    packing = FORMATS[name]
    height, width = len(data) // stride, min(most, stride // packing.length * packing.pixels)
    if min(height, width) < 1:
        return np.empty((0, 0), np.uint16)
    rows = min(height, _TRIED_ROWS)
    middle = memoryview(data)[(height - rows) // 2 * stride :][: rows * stride]
    return FrameLayout(width, rows, name, stride).unpack(middle)


def _options(layout: FrameLayout, name: str, stride: int) -> str:
    """The options of a reading that differ from those of a layout."""
    packing = FORMATS[name]
    width = min(layout.width, stride // packing.length * packing.pixels)
    options = [f"`pixel_format={name}`"] if name != layout.format else []
    declared = layout.stride if name == layout.format else 0
    if stride != FrameLayout(width, 1, name, declared).stride:
        options.append(f"`stride={stride}`")
    if width < layout.width:
        options.append(f"`width={width}` or less")
    return " ".join(options)


def likely_strides(data: Bytes, stride: int) -> list[int]:
    """Find the two strides that the rows are likeliest to have; fewer where nothing repeats.

    data: the bytes of a frame. stride: the declared one, bytes; those from a third of it to three
    times it are found.
    """
    from scipy.fft import irfft, rfft
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import find_peaks

    start, heights = max((len(data) - _BYTES) // 4 * 2, 0), dict[int, float]()
    middle = np.frombuffer(data, np.uint8)[start : start + min(_BYTES, len(data) // 2 * 2)]
    for words in (middle, middle.view("<u2"), middle.view(">u2")):
        around = stride // words.itemsize
        first, last = max(around // 3, 8), min(3 * around + 1, words.size // 2)
        if last - first < _SMOOTH:
            continue
        values = words.astype(np.float64)
        values -= uniform_filter1d(values, _SMOOTH, mode="mirror")
        # twice as long: the end is not compared with the beginning
        power = np.abs(rfft(values, 2 * values.size)) ** 2
        even = uniform_filter1d(np.sqrt(power), _BAND, mode="mirror")
        alike = irfft(np.minimum(power / (even**2 + 1e-9), _LINE))[first:last]
        alike -= np.median(alike)
        alike /= np.median(np.abs(alike)) / 0.6745 + 1e-12
        peaks, _ = find_peaks(np.pad(alike, 1), height=_CLEAR, distance=9)
        for place in peaks - 1:
            distance = (first + int(place)) * words.itemsize
            heights[distance] = max(float(alike[place]), heights.get(distance, 0.0))
    return sorted(heights, key=lambda distance: -heights[distance])[:_LIKELY]
