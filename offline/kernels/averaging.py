"""Non-local averaging of chromaticity (Eqs. 15-16), in windows that stay in the cache.

Weights are computed once, for half the offsets: the distance from n' to n equals that from n to n'. They live in a ring buffer.
When row r's weights are ready, repetition i can process row r - i * radius; all repetitions therefore advance together, some rows
at a time. A window is a strip of rows and a range of columns; around it, repetitions before the last are computed again as far as
the window reaches.

A row of a window is cut into as many pieces as a vector has lanes, one piece per lane: then a neighbour is a whole vector, and
vectors are always aligned. A few columns of the next piece follow each piece, and a few of the one before precede it.
"""

import numpy as np

from shared.arrays import FloatArray, IndexArray

from .compile import kernel, parallel_kernel, prange
from .functions import LEAST_EXPONENT, exponential, mirrored, zeros
from .lanes import WIDTH, Lanes, Scalar, greater, load, quotient, shifted, store, total, where_less

_STRIP, _COLUMNS, _BATCH = 128, 244, 4
_TOGETHER = 4  # planes summed at a time: the light and three channels
_LAST = WIDTH - 1
_NONE, _ONE = np.float32(0), np.float32(1)
_LEAST = np.finfo(np.float32).tiny

Area = tuple[int, int, int, int]
Similarity = tuple[int, FloatArray, Scalar]
"""(radius, blur, falloff), as `average` takes them."""
Memory = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""(light, squares, blurred, weights, colour): what one worker computes with. All but `squares` are ring buffers of rows."""
Four = tuple[Lanes, Lanes, Lanes, Lanes]


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
    width, around = luminance.shape[1], repetitions * radius
    along = (width + _COLUMNS - 1) // _COLUMNS
    wide = (width + along - 1) // along
    windows = (rows[1] - rows[0] + _STRIP - 1) // _STRIP * along
    for worker in prange(workers):
        # Memory is allocated once per worker.
        piece = max((wide + 2 * around + 2 * WIDTH - 1) // (2 * WIDTH), (radius + 1) // 2) * 2  # an even number of columns
        offsets, reach = radius * (2 * radius + 1) + radius, len(blur) // 2
        planes = (initial.shape[2] + _TOGETHER) // _TOGETHER * _TOGETHER
        light = zeros(radius + 1, piece + 2 * (radius + reach), WIDTH)
        squares = zeros(piece + 2 * reach + 1, WIDTH)
        blurred = zeros(offsets, _BATCH + 2 * reach, piece, WIDTH)
        weights = zeros(around + _BATCH, offsets, piece + 2 * radius, WIDTH)
        colour = zeros(repetitions, 2 * radius + _BATCH, planes, piece + 2 * radius, WIDTH)
        similarity, memory = (radius, blur, np.float32(falloff)), (light, squares, blurred, weights, colour)
        for window in range(worker, windows, workers):
            top, left = rows[0] + window // along * _STRIP, window % along * wide
            area = top, min(top + _STRIP, rows[1]), left, min(left + wide, width)
            _window(initial, first, luminance, area, similarity, memory, out[top - rows[0] :])


@kernel
def _window(
    initial: FloatArray, first: int, luminance: FloatArray, area: Area, similarity: Similarity, memory: Memory, out: FloatArray
) -> None:
    """Average one window. area: first and end row, first and end column."""
    (height, width), (top, bottom, left, right) = luminance.shape, area
    (radius, blur, _), (_, _, blurred, weights, colour) = similarity, memory
    repetitions, ring, piece, reach = colour.shape[0], colour.shape[1], blurred.shape[2], len(blur) // 2
    edge = left - repetitions * radius  # the frame's column at the first column of the first piece
    places = _places(edge, width, piece, radius + reach)
    sums = zeros(colour.shape[2], piece, WIDTH)
    begin, end = max(-radius, top - repetitions * radius), bottom + (repetitions - 1) * radius
    coloured = max(top - repetitions * radius, 0)  # the first row that is not in colour[0] yet
    for batch in range(begin, end, _BATCH):
        after = min(batch + _BATCH, end)
        if batch < height:
            _weigh(luminance, (begin, batch, min(after, height)), places, similarity, memory)
        for repetition in range(repetitions):
            behind, around = repetition * radius, (repetitions - 1 - repetition) * radius
            for row in range(max(batch - behind, top - around, 0), min(after - behind, bottom + around, height)):
                while repetition == 0 and coloured < min(row + radius + 1, height):
                    _colour(initial[coloured - first], luminance[coloured], edge, radius, colour[0, coloured % ring])
                    coloured += 1
                _sum(weights, colour[repetition], row, height, radius, sums)
                if repetition == repetitions - 1:
                    _finish(sums, initial[row - first], (left, right), edge, out[row - top])
                else:
                    _pass_on(sums, colour[repetition, row % ring], edge, width, colour[repetition + 1, row % ring])


@kernel
def _places(edge: int, width: int, piece: int, margin: int) -> IndexArray:
    """The frame's column at each column of each piece, and of a margin on both sides, (columns, WIDTH)."""
    places = np.empty((piece + 2 * margin, WIDTH), np.intp)
    for column in range(len(places)):
        for lane in range(WIDTH):
            places[column, lane] = mirrored(edge + lane * piece + column - margin, width)
    return places


@kernel
def _weigh(luminance: FloatArray, rows: tuple[int, int, int], places: IndexArray, similarity: Similarity, memory: Memory) -> None:
    """Compute the weights of Eq. 16, without the light, for some rows; 0 below an exponent of -87.

    rows: the first row of the window that has weights, and first and end row of those to compute.
    """
    (radius, blur, falloff), (light, squares, blurred, weights, _) = similarity, memory
    (begin, top, bottom), (offsets, ring, piece, _), height, reach = rows, blurred.shape, len(luminance), len(blur) // 2
    # Rows are counted from the first that is blurred, `reach` above the first that has weights.
    for row in range(0 if top == begin else top - begin + 2 * reach, bottom - begin + 2 * reach):
        for below in range(0 if row == 0 else radius, radius + 1):
            source = luminance[mirrored(begin - reach + row + below, height)]
            _gather(source, places, light[(row + below) % len(light)])
        offset = 0
        for down in range(radius + 1):
            for across in range(-radius if down else 1, radius + 1):
                here, there = row % len(light), (row + down) % len(light)
                for column in range(piece + 2 * reach):
                    difference = load(light, (there, column + radius + across, 0)) - load(light, (here, column + radius, 0))
                    store(squares, (column, 0), difference * difference)
                for column in range(0, piece, 2):
                    following = load(squares, (column + 1, 0))
                    one, two = blur[0] * load(squares, (column, 0)), blur[0] * following
                    for tap in range(1, len(blur)):
                        one += blur[tap] * following
                        following = load(squares, (column + tap + 1, 0))
                        two += blur[tap] * following
                    store(blurred, (offset, row % ring, column, 0), one)
                    store(blurred, (offset, row % ring, column + 1, 0), two)
                offset += 1
    slots = np.arange(top - begin, bottom - begin + 2 * reach + 1) % ring
    for offset in range(offsets):
        for row in range(0, bottom - top, 2):  # if their number is odd, one row that nobody needs comes last
            slot, other = (top + row) % len(weights), (top + row + 1) % len(weights)
            for column in range(piece):
                following = load(blurred, (offset, slots[row + 1], column, 0))
                one, two = blur[0] * load(blurred, (offset, slots[row], column, 0)), blur[0] * following
                for tap in range(1, len(blur)):
                    one += blur[tap] * following
                    following = load(blurred, (offset, slots[row + tap + 1], column, 0))
                    two += blur[tap] * following
                store(weights, (slot, offset, column + radius, 0), _weight(one * falloff))
                store(weights, (other, offset, column + radius, 0), _weight(two * falloff))
            _join(weights[slot, offset], radius)
            _join(weights[other, offset], radius)


@kernel
def _weight(exponent: Lanes) -> Lanes:
    """e^x, and 0 below an exponent of -87."""
    return where_less(exponent, LEAST_EXPONENT, _NONE, exponential(exponent))


@kernel
def _gather(source: FloatArray, places: IndexArray, row: FloatArray) -> None:
    """Store the elements of a row of the frame that `places` names."""
    for column in range(len(places)):
        for lane in range(WIDTH):
            row[column, lane] = source[places[column, lane]]


@kernel
def _join(row: FloatArray, margin: int) -> None:
    """Copy the ends of pieces to the margins of their neighbours. What the outermost margins then hold is not used."""
    piece = len(row) - 2 * margin
    for column in range(margin):
        last, first = load(row, (piece + column, 0)), load(row, (margin + column, 0))
        store(row, (column, 0), shifted(last, last, _LAST))
        store(row, (margin + piece + column, 0), shifted(first, first, 1))


@kernel
def _colour(initial: FloatArray, luminance: FloatArray, edge: int, radius: int, colour: FloatArray) -> None:
    """Store light, and light times chromaticity, of a row: Eq. 16 multiplies each weight by the light of the other pixel."""
    width, channels = initial.shape
    piece = colour.shape[1] - 2 * radius
    for lane in range(WIDTH):
        start = edge + lane * piece
        if start >= 0 and start + piece <= width:
            lights, tints = luminance[start : start + piece], initial[start : start + piece]
            for column in range(piece):
                colour[0, column + radius, lane] = max(lights[column], _NONE)
            for channel in range(channels):
                for column in range(piece):
                    colour[channel + 1, column + radius, lane] = max(lights[column], _NONE) * tints[column, channel]
        else:
            for column in range(piece):
                place = mirrored(start + column, width)
                light = max(luminance[place], _NONE)
                colour[0, column + radius, lane] = light
                for channel in range(channels):
                    colour[channel + 1, column + radius, lane] = light * initial[place, channel]
    for plane in range(len(colour)):
        _join(colour[plane], radius)


@kernel
def _sum(weights: FloatArray, colour: FloatArray, row: int, height: int, radius: int, sums: FloatArray) -> None:
    """Compute both sums of Eq. 15 along a row, for two columns at a time, which have most neighbours in common.

    Each weight is used twice: for the pixel at its offset and for the opposite one.
    """
    kept, ring = len(weights), len(colour)
    here, at = row % kept, row % ring
    slots = np.empty((radius + 1, 3), np.intp)
    for down in range(radius + 1):
        slots[down, 0] = mirrored(row + down, height) % ring
        slots[down, 1] = mirrored(row - down, height) % ring
        slots[down, 2] = (row - down) % kept
    for plane in range(0, colour.shape[1], _TOGETHER):
        for column in range(0, sums.shape[1], 2):
            x = column + radius
            one, two = _four(colour, at, plane, x), _four(colour, at, plane, x + 1)
            offset = 0
            for down in range(radius + 1):
                below, above, before = slots[down]
                start = -radius if down else 1
                lower, upper = _four(colour, below, plane, x + start), _four(colour, above, plane, x + 1 - start)
                for across in range(start, radius + 1):
                    y, z = x + across, x - across
                    one = _add(one, load(weights, (here, offset, x, 0)), lower)
                    lower = _four(colour, below, plane, y + 1)
                    two = _add(two, load(weights, (here, offset, x + 1, 0)), lower)
                    two = _add(two, load(weights, (before, offset, z + 1, 0)), upper)
                    upper = _four(colour, above, plane, z)
                    one = _add(one, load(weights, (before, offset, z, 0)), upper)
                    offset += 1
            _store_four(sums, plane, column, one)
            _store_four(sums, plane, column + 1, two)


@kernel
def _four(colour: FloatArray, row: int, plane: int, column: int) -> Four:
    """One column of four planes."""
    return (
        load(colour, (row, plane, column, 0)), load(colour, (row, plane + 1, column, 0)),
        load(colour, (row, plane + 2, column, 0)), load(colour, (row, plane + 3, column, 0)),
    )  # fmt: skip


@kernel
def _add(sums: Four, weight: Lanes, colour: Four) -> Four:
    """Add four weighted values to four sums."""
    return (
        sums[0] + weight * colour[0], sums[1] + weight * colour[1],
        sums[2] + weight * colour[2], sums[3] + weight * colour[3],
    )  # fmt: skip


@kernel
def _store_four(sums: FloatArray, plane: int, column: int, values: Four) -> None:
    """Store one column of four planes."""
    a, b, c, d = values
    store(sums, (plane, column, 0), a)
    store(sums, (plane + 1, column, 0), b)
    store(sums, (plane + 2, column, 0), c)
    store(sums, (plane + 3, column, 0), d)


@kernel
def _finish(sums: FloatArray, initial: FloatArray, columns: tuple[int, int], edge: int, out: FloatArray) -> None:
    """Divide the sums of Eq. 15 and write them to `out`; a pixel without light keeps its initial chromaticity."""
    piece = sums.shape[1]
    dark = _NONE * load(sums, (0, 0, 0))
    for column in range(piece):
        light = load(sums, (0, column, 0))
        dark += where_less(_LEAST, light, _NONE, _ONE)
        share = quotient(_ONE, greater(light, _LEAST))
        for channel in range(out.shape[1]):
            store(sums, (channel + 1, column, 0), load(sums, (channel + 1, column, 0)) * share)
    for lane in range(WIDTH):
        start = edge + lane * piece
        first, end = max(start, columns[0]), min(start + piece, columns[1])
        if first < end:
            target, source = out[first:end], sums[:, first - start : end - start]
            for channel in range(out.shape[1]):
                for place in range(end - first):
                    target[place, channel] = source[channel + 1, place, lane]
            if total(dark) > 0:
                for place in range(end - first):
                    if not source[0, place, lane] > _LEAST:
                        for channel in range(out.shape[1]):
                            target[place, channel] = initial[first + place, channel]


@kernel
def _pass_on(sums: FloatArray, colour: FloatArray, edge: int, width: int, following: FloatArray) -> None:
    """Divide the sums of Eq. 15 and multiply by light again, for the next repetition; a pixel without light has no weight there."""
    piece = sums.shape[1]
    radius = (colour.shape[1] - piece) // 2
    for column in range(piece):
        light = load(colour, (0, column + radius, 0))
        share = light * quotient(_ONE, greater(load(sums, (0, column, 0)), _LEAST))
        store(following, (0, column + radius, 0), light)
        for plane in range(1, len(sums)):
            store(following, (plane, column + radius, 0), load(sums, (plane, column, 0)) * share)
    # The row is mirrored beyond the frame's edges, if the window reaches them.
    for step in range(1, radius + 1):
        for beyond in (-step, width - 1 + step):
            target, source = beyond - edge, mirrored(beyond, width) - edge
            if 0 <= target < WIDTH * piece:
                for plane in range(len(sums)):
                    value = following[plane, source % piece + radius, source // piece]
                    following[plane, target % piece + radius, target // piece] = value
    for plane in range(len(sums)):
        _join(following[plane], radius)
