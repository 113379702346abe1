"""Non-local averaging of chromaticity (Eqs. 15-16), in windows that stay in the cache.

Weights are computed once, for half the offsets: the distance from n' to n equals that from n to n'. They live in a ring buffer.
When row r's weights are ready, repetition i can process row r - i * radius; all repetitions therefore advance together, one row at
a time. A window is a strip of rows and a range of columns; around it, repetitions before the last are computed again as far as the
window reaches.
"""

import numpy as np

from shared.arrays import FloatArray

from .compile import kernel, parallel_kernel, prange
from .functions import LEAST_EXPONENT, copy_mirrored, exponential, mirrored, zeros
from .lanes import WIDTH, Scalar, greater, load, quotient, store, where_less

_STRIP, _COLUMNS, _BATCH = 128, 256, 16
_TOGETHER = 4  # planes summed at a time: the light and three channels
_NONE, _ONE = np.float32(0), np.float32(1)
_LEAST = np.finfo(np.float32).tiny

Area = tuple[int, int, int, int]
Similarity = tuple[int, FloatArray, Scalar]
"""(radius, blur, falloff), as `average` takes them."""
Memory = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""(light, blurred, weights, colour): what one worker computes with."""


@parallel_kernel("f4[:, :, ::1], i8, f4[:, ::1], (i8, i8), i8, f4[::1], f8, i8, i8, f4[:, :, ::1]")
def average(
    initial: FloatArray,
    first: int,
    luminance: FloatArray,
    rows: tuple[int, int],
    radius: int,
    blur: FloatArray,
    falloff: Scalar,
    repetitions: int,
    workers: int,
    out: FloatArray,
) -> None:
    """Average the chromaticities of Eq. 10 over rows[0] to rows[1] of the frame.

    initial: (rows, W, C), chromaticities from row `first` of the frame on: radius * repetitions rows more than `rows` on both
        sides, or to the frame's edge.
    first: the frame's row at initial[0].
    luminance: (H, W), scene units.
    rows: first and end row of the frame to compute.
    radius: radius of the square window around n, pixels.
    blur: taps of the Gaussian, an odd number.
    falloff: -1 / (2 h^2).
    repetitions: 1 or more.
    workers: how many windows are computed at a time.
    out: (rows[1] - rows[0], W, C), written.
    """
    width = luminance.shape[1]
    along = (width + _COLUMNS - 1) // _COLUMNS
    windows = (rows[1] - rows[0] + _STRIP - 1) // _STRIP * along
    for worker in prange(workers):
        # Memory is allocated once per worker, in rows long enough for the widest window.
        span = (_COLUMNS + 2 * repetitions * radius + 2 * WIDTH) // WIDTH * WIDTH
        offsets = radius * (2 * radius + 1) + radius
        planes = (initial.shape[2] + _TOGETHER) // _TOGETHER * _TOGETHER
        light = zeros(_BATCH + len(blur) + radius, span + len(blur) + 2 * radius)
        blurred = zeros(offsets, _BATCH + len(blur), span)
        weights = zeros(repetitions * radius + _BATCH, offsets, span)
        colour = zeros(repetitions, 2 * radius + _BATCH, planes, span + 2 * radius)
        similarity, memory = (radius, blur, np.float32(falloff)), (light, blurred, weights, colour)
        for window in range(worker, windows, workers):
            top, left = rows[0] + window // along * _STRIP, window % along * _COLUMNS
            area = top, min(top + _STRIP, rows[1]), left, min(left + _COLUMNS, width)
            _window(initial, first, luminance, area, similarity, memory, out[top - rows[0] :])


@kernel
def _window(
    initial: FloatArray, first: int, luminance: FloatArray, area: Area, similarity: Similarity, memory: Memory, out: FloatArray
) -> None:
    """Average one window. area: first and end row, first and end column. `weights` and `colour` are ring buffers of rows."""
    (height, width), (top, bottom, left, right) = luminance.shape, area
    (radius, blur, _), (_, _, weights, colour) = similarity, memory
    repetitions, ring = colour.shape[0], colour.shape[1]
    edge = left - repetitions * radius  # the frame's column at column 0 of the buffers
    columns = right - left + 2 * repetitions * radius
    sums = zeros(colour.shape[2], colour.shape[3])
    begin, end = max(-radius, top - repetitions * radius), bottom + (repetitions - 1) * radius
    coloured = max(top - repetitions * radius, 0)  # the first row that is not in colour[0] yet
    for batch in range(begin, end, _BATCH):
        after = min(batch + _BATCH, end)
        if batch < height:
            known = 0 if batch == begin else len(blur) - 1
            rows = batch, min(after, height)
            _weigh(luminance, rows, known, edge, columns, similarity, memory)
        for repetition in range(repetitions):
            behind, around = repetition * radius, (repetitions - 1 - repetition) * radius
            start, stop = max(left - around, 0) - edge, min(right + around, width) - edge
            for row in range(max(batch - behind, top - around, 0), min(after - behind, bottom + around, height)):
                while repetition == 0 and coloured < min(row + radius + 1, height):
                    _colour(initial[coloured - first], luminance[coloured], edge, columns, radius, colour[0, coloured % ring])
                    coloured += 1
                _sum(weights, colour[repetition], row, height, start, stop, radius, sums)
                if repetition == repetitions - 1:
                    _finish(sums, initial[row - first], start, stop, edge, out[row - top])
                else:
                    following = colour[repetition + 1, row % ring]
                    _pass_on(sums, colour[repetition, row % ring], start, stop, radius, following)
                    _mirror(following, edge, width, start, stop, radius)


@kernel
def _weigh(
    luminance: FloatArray, rows: tuple[int, int], known: int, edge: int, columns: int, similarity: Similarity, memory: Memory
) -> None:
    """Compute the weights of Eq. 16, without the light, for a batch of rows, offset by offset; 0 below an exponent of -87.

    known: how many rows, blurred for the previous batch, are the first rows of this one: 0, or the number of taps less one.
    """
    (radius, blur, falloff), (light, blurred, weights, _) = similarity, memory
    height, reach = len(luminance), len(blur) // 2
    count = rows[1] - rows[0] + 2 * reach
    for row in range(known, count + radius):
        source = luminance[mirrored(rows[0] - reach + row, height)]
        copy_mirrored(source, edge - reach - radius, light[row], columns + 2 * (reach + radius))
    offset = 0
    for down in range(radius + 1):
        for across in range(-radius if down else 1, radius + 1):
            for row in range(known):
                for column in range(0, columns, WIDTH):
                    store(blurred, (offset, row, column), load(blurred, (offset, _BATCH + row, column)))
            for row in range(known, count):
                # Squared differences from the pixel at the offset, stored in the row after the batch's blurred rows.
                for column in range(0, columns + 2 * reach, WIDTH):
                    difference = load(light, (row + down, column + radius + across)) - load(light, (row, column + radius))
                    store(blurred, (offset, count, column), difference * difference)
                for column in range(0, columns, WIDTH):
                    mean = blur[0] * load(blurred, (offset, count, column))
                    for tap in range(1, len(blur)):
                        mean += blur[tap] * load(blurred, (offset, count, column + tap))
                    store(blurred, (offset, row, column), mean)
            for row in range(rows[1] - rows[0]):
                slot = (rows[0] + row) % len(weights)
                for column in range(0, columns, WIDTH):
                    distance = blur[0] * load(blurred, (offset, row, column))
                    for tap in range(1, len(blur)):
                        distance += blur[tap] * load(blurred, (offset, row + tap, column))
                    exponent = distance * falloff
                    weight = where_less(exponent, LEAST_EXPONENT, _NONE, exponential(exponent))
                    store(weights, (slot, offset, column), weight)
            offset += 1


@kernel
def _colour(initial: FloatArray, luminance: FloatArray, edge: int, columns: int, radius: int, colour: FloatArray) -> None:
    """Store light, and light times chromaticity, of a row: Eq. 16 multiplies each weight by the light of the other pixel."""
    width = len(luminance)
    start, stop = max(edge - radius, 0), min(edge + columns + radius, width)
    for place in range(start, stop):
        colour[0, place - edge + radius] = max(luminance[place], _NONE)
    for channel in range(initial.shape[1]):
        for place in range(start, stop):
            colour[channel + 1, place - edge + radius] = max(luminance[place], _NONE) * initial[place, channel]
    _mirror(colour, edge, width, start - edge, stop - edge, radius)


@kernel
def _sum(
    weights: FloatArray, colour: FloatArray, row: int, height: int, start: int, stop: int, radius: int, sums: FloatArray
) -> None:
    """Compute both sums of Eq. 15 along a row. Each weight is used twice: for the pixel at its offset and for the opposite one."""
    kept, ring = len(weights), len(colour)
    here, at = row % kept, row % ring
    slots = np.empty((radius + 1, 3), np.intp)
    for down in range(radius + 1):
        slots[down, 0] = mirrored(row + down, height) % ring
        slots[down, 1] = mirrored(row - down, height) % ring
        slots[down, 2] = (row - down) % kept
    for plane in range(0, colour.shape[1], _TOGETHER):
        for column in range(start, stop, WIDTH):
            x = column + radius
            a, b, c, d = (
                load(colour, (at, plane, x)), load(colour, (at, plane + 1, x)),
                load(colour, (at, plane + 2, x)), load(colour, (at, plane + 3, x)),
            )  # fmt: skip
            offset = 0
            for down in range(radius + 1):
                below, above, before = slots[down]
                for across in range(-radius if down else 1, radius + 1):
                    weight, y = load(weights, (here, offset, column)), x + across
                    a += weight * load(colour, (below, plane, y))
                    b += weight * load(colour, (below, plane + 1, y))
                    c += weight * load(colour, (below, plane + 2, y))
                    d += weight * load(colour, (below, plane + 3, y))
                    weight, y = load(weights, (before, offset, column - across)), x - across
                    a += weight * load(colour, (above, plane, y))
                    b += weight * load(colour, (above, plane + 1, y))
                    c += weight * load(colour, (above, plane + 2, y))
                    d += weight * load(colour, (above, plane + 3, y))
                    offset += 1
            store(sums, (plane, column), a)
            store(sums, (plane + 1, column), b)
            store(sums, (plane + 2, column), c)
            store(sums, (plane + 3, column), d)


@kernel
def _finish(sums: FloatArray, initial: FloatArray, start: int, stop: int, edge: int, out: FloatArray) -> None:
    """Divide the sums of Eq. 15 and write them to `out`; a pixel without light keeps its initial chromaticity."""
    for column in range(start, stop, WIDTH):
        share = quotient(_ONE, greater(load(sums, (0, column)), _LEAST))
        for channel in range(out.shape[1]):
            store(sums, (channel + 1, column), load(sums, (channel + 1, column)) * share)
    dark = False
    for column in range(start, stop):
        dark = dark or sums[0, column] <= _LEAST
    for channel in range(out.shape[1]):
        for column in range(start, stop):
            out[column + edge, channel] = sums[channel + 1, column]
        if dark:
            for column in range(start, stop):
                if sums[0, column] <= _LEAST:
                    out[column + edge, channel] = initial[column + edge, channel]


@kernel
def _pass_on(sums: FloatArray, colour: FloatArray, start: int, stop: int, radius: int, following: FloatArray) -> None:
    """Divide the sums of Eq. 15 and multiply by light again, for the next repetition; a pixel without light has no weight there."""
    for column in range(start, stop, WIDTH):
        light = load(colour, (0, column + radius))
        share = light * quotient(_ONE, greater(load(sums, (0, column)), _LEAST))
        store(following, (0, column + radius), light)
        for plane in range(1, len(sums)):
            store(following, (plane, column + radius), load(sums, (plane, column)) * share)


@kernel
def _mirror(colour: FloatArray, edge: int, width: int, start: int, stop: int, radius: int) -> None:
    """Mirror a row beyond the frame's edges, if it ends there."""
    for step in range(1, radius + 1):
        if start + edge == 0:
            for plane in range(len(colour)):
                colour[plane, radius - edge - step] = colour[plane, radius - edge + mirrored(-step, width)]
        if stop + edge == width:
            for plane in range(len(colour)):
                colour[plane, radius - edge + width - 1 + step] = colour[plane, radius - edge + mirrored(width - 1 + step, width)]
