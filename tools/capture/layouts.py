"""The layout of a raw frame: as described, or, where that shows no filters, the format and stride
with which the bytes do.

Whatever the format, rows resemble each other: the stride is the distance at which the bytes
resemble themselves most.
"""

import os
import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...device.capture.frames import FORMATS, Bytes, FrameLayout, read_frames
from ...shared.arrays import CodeArray
from ...shared.reading import opened_file
from .identity import identify
from .source import STREAM, SourceOptions, layout_of, recording, standard_input

# strides at which rows repeat most; groups of samples by which they may be wrong
_LIKELY, _NEAR = 2, 2
_BYTES = 1 << 19  # of the middle of a frame
_SMOOTH = 61  # samples of the running mean that is subtracted
_BAND = 2049  # frequencies over which the spectrum is evened out
# A frequency counts at most this many times its surroundings: the lower bits of packed samples come
# at regular distances.
_LINE = 30.0
_CLEAR = 8.0  # a peak stands out by this many times the usual deviation
_HALF = 0.4  # of the height of another peak
Reading = tuple[str, int, int]
"""Format, stride in bytes, and bytes before the first sample."""


def first_frame(options: SourceOptions) -> tuple[Bytes, FrameLayout]:
    """Read the first frame of a file or stream as it is described; returns its bytes and their
    layout.

    Raises
    ------
    InputError
        For what cannot be read, and for a description that does not fit.
    """
    layout, _ = layout_of(options)
    if options.source == STREAM:
        recording()
        with standard_input() as stream:
            return next(read_frames(stream, layout)).data, layout
    with opened_file(options.source, sys.maxsize, "a raw frame") as file:
        layout.check_recording(file.seek(0, os.SEEK_END))
        file.seek(0)
        data = file.read(layout.frame_bytes)
    layout.unpack(data)  # raises InputError
    return data, layout


def likely_reading(data: Bytes, layout: FrameLayout) -> str:
    """Name the options with which the bytes of a frame show a tile that has a name, and that name.
    "" if there are none.

    A wrong layout hardly ever shows such a tile: of 108 pairs of formats and tiles none did.

    Parameters
    ----------
    data
        The bytes of a frame.
    layout
        The layout in which they show no tile.
    """
    for readings in _readings(data, layout):
        named = []
        for reading in readings:
            identity = identify(_read_as(data, layout, *reading))
            if identity and identity.name:
                named.append((identity.certainty, identity.name, reading))
        if named:
            _, tile, reading = max(named)
            return _advice(layout, *reading, tile)
    return ""


def _readings(data: Bytes, layout: FrameLayout) -> Iterator[list[Reading]]:
    """Yield the likely readings of a frame, then less likely ones: strides that are a little
    off.
    """
    declared, group = layout.format, FORMATS[layout.format].length
    # Scattered sites repeat in every other row, too, and rows that are shifted by a pixel or two
    # resemble each other even more.
    likely = likely_strides(data, layout.stride)[:_LIKELY]
    repeats = [part for stride in likely for part in (stride, stride // 2)]
    tight = {name: FrameLayout(layout.width, 1, name).stride for name in FORMATS}
    strides = list(dict.fromkeys([layout.stride, tight[declared], *repeats]))
    first = [(name, stride, 0) for name in FORMATS for stride in strides]
    first += [(name, tight[name], 0) for name in FORMATS]
    first += [(declared, stride, skip) for stride in strides for skip in range(1, group)]
    yield list(dict.fromkeys(first))
    shifts = range(-_NEAR * group, _NEAR * group + 1)
    near = ((declared, stride + shift, 0) for stride in repeats for shift in shifts if shift)
    yield [reading for reading in near if reading[1] > 0]


def _read_as(data: Bytes, layout: FrameLayout, name: str, stride: int, skipped: int) -> CodeArray:
    """Unpack the samples of a frame in another reading; empty if no line is as short. layout: for
    its width.
    """
    packing = FORMATS[name]
    height = (len(data) - skipped) // stride
    width = min(layout.width, stride // packing.length * packing.pixels)
    if min(height, width) < 1:
        return np.empty((0, 0), np.uint16)
    part = memoryview(data)[skipped : skipped + height * stride]
    return FrameLayout(width, height, name, stride).unpack(part)


def _advice(layout: FrameLayout, name: str, stride: int, skipped: int, tile: str) -> str:
    packing = FORMATS[name]
    width = stride // packing.length * packing.pixels
    options = [f"`pixel_format={name}`"] if name != layout.format else []
    declared = layout.stride if name == layout.format else 0
    if stride != FrameLayout(min(layout.width, width), 1, name, declared).stride:
        options.append(f"`stride={stride}`")
    if width < layout.width:
        options.append(f"`width={width}` or less")
    if skipped:
        bytes_before = f"{skipped} bytes (or whole groups of samples more)"
        options.append(f"a stream without {bytes_before} before the first sample")
    return f"likely {' '.join(options)}, which shows the tile {tile}"


def likely_strides(data: Bytes, stride: int) -> list[int]:
    """Find the strides that the rows may have, the likeliest first; none where nothing repeats.

    Parameters
    ----------
    data
        The bytes of a frame.
    stride
        The declared one, bytes; those from a third of it to three times it are found.
    """
    every = np.frombuffer(data, np.uint8)
    start = max((len(every) - _BYTES) // 4 * 2, 0)
    middle = every[start : start + min(_BYTES, len(every) // 2 * 2)]
    heights: dict[int, float] = {}
    for words in (middle, middle.view("<u2"), middle.view(">u2")):
        for lag, height in _repeats(words, stride // words.itemsize):
            distance = lag * words.itemsize
            heights[distance] = max(height, heights.get(distance, 0.0))

    def is_multiple(lag: int) -> bool:
        """Two rows further down the picture resembles itself too, and may even do so a little
        more.
        """
        divisors = (other for other in heights if other < lag and lag % other == 0)
        return any(heights[divisor] > _HALF * heights[lag] for divisor in divisors)

    return sorted((lag for lag in heights if not is_multiple(lag)), key=lambda lag: -heights[lag])


def _repeats(samples: NDArray[np.unsignedinteger], around: int) -> list[tuple[int, float]]:
    """The two distances at which samples repeat most clearly, each with its height in usual
    deviations.
    """
    from scipy.fft import irfft, rfft
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import find_peaks

    first, last = max(around // 3, 8), min(3 * around + 1, samples.size // 2)
    if last - first < _SMOOTH:
        return []
    values = samples.astype(np.float64)
    values -= uniform_filter1d(values, _SMOOTH, mode="mirror")
    # twice as long: the end is not compared with the beginning
    power = np.abs(rfft(values, 2 * samples.size)) ** 2
    if power.size > 2 * _BAND:
        even = uniform_filter1d(np.sqrt(power), _BAND, mode="mirror")
        power = np.minimum(power / (even**2 + 1e-9), _LINE)
    alike = irfft(power)[first:last]
    heights = alike - np.median(alike)
    heights /= np.median(np.abs(heights)) / 0.6745 + 1e-12
    peaks, _ = find_peaks(np.pad(heights, 1), height=_CLEAR, distance=9)
    best = sorted(peaks - 1, key=lambda place: -heights[place])[:2]
    return [(first + int(place), float(heights[place])) for place in best]
