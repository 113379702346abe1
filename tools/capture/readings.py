"""Other readings of a frame's bytes: strides at which its rows repeat, and formats.

Whatever the format, rows resemble each other: the stride is the distance at which the bytes resemble themselves most.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from device.capture.frames import FORMATS, Bytes, FrameLayout
from shared.arrays import CodeArray, DoubleArray

_BYTES = 1 << 19  # of the middle of a frame
_SMOOTH = 61  # samples of the running mean that is subtracted
_BAND = 2049  # frequencies over which the spectrum is evened out
# A frequency counts at most this many times its surroundings: the lower bits of packed samples come at regular distances.
_LINE = 30.0
_CLEAR = 8.0  # a peak stands out by this many times the usual deviation
_HALF = 0.4  # of the height of another peak


def candidates(layout: FrameLayout, strides: Sequence[int]) -> Iterator[tuple[str, int, int]]:
    """Yield (format, stride, bytes before the first sample) of other readings of a frame that is described, the likeliest first."""
    declared, others = layout.format, [name for name in FORMATS if name != layout.format]
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
