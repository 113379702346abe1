"""Non-local means of luminance (Buades, Coll and Morel 2005), in windows that stay in the cache.

A pixel is averaged with others of the same kind of surroundings: 3 x 3 pixels, with binomial weights, of a frame without noise. The
weight of two pixels is the same for both, so each pair is weighed once: pairs that lie the same number of rows apart together, and
then they are added to both rows at once.
"""

import numpy as np

from .arrays import Bools2, Floats1, Floats2, Pair, Scalar, Single
from .compile import Pieces, kernel, parallel_kernel
from .functions import mirrored, tile_at, zeros
from .lanes import WIDTH, greater, load, store
from .pieces import tiles

SURROUNDINGS = 1
"""Pixels around a pixel that are compared. Chosen."""
AREA = 128, 256
"""Rows and columns that have the same share of the mean, and that are computed together; chosen for speed."""
_ROWS, _COLUMNS = AREA
_NONE, _ONE, _TWO = np.float32(0), np.float32(1), np.float32(2)
_LEAST = np.float32(1e-30)  # keeps 0 / 0 finite, at black without read noise
# e^(-x / 2) is about (1 - x / 8)^4, and this is 0 from x = 8 on. x is the mean of squared differences with weights that sum to 16.
_SCALE = np.float32(1 / np.sqrt(8 * 16))

Planes = tuple[Floats2, Floats2, Floats2, Floats2]
"""(even, samples, sums, weights) of a window: what is compared, what is averaged, and what has been added up."""


@parallel_kernel(
    pieces=lambda noisy, uncertain, clean, first, rows, *_: tiles((rows[1] - rows[0], noisy.shape[1]), (_ROWS, _COLUMNS))
)
def average_similar(
    pieces: Pieces,
    noisy: Floats2,
    uncertain: Bools2,
    clean: Floats2,
    first: int,
    rows: Pair,
    radius: int,
    shot: Single,
    read: Single,
    similarity: Single,
    shares: Floats2,
    out: Floats2,
) -> None:
    """Mix the mean of pixels with similar surroundings into rows[0] to rows[1] of a frame.

    noisy: (H, W), scene units; what is averaged.
    uncertain: bool (any rows, W), repeated down the frame: samples that are taken from `clean` instead.
    clean: (rows, W), scene units, the frame without noise, from its row `first` on: `rows`, and as much above and below as offsets
        and surroundings reach, or to the frame's edge.
    rows: first and end row of the frame to compute.
    radius: of the square window around a pixel, pixels.
    shot, read: variance of the noise = shot * signal + read**2.
    similarity: how much surroundings may differ, in standard deviations of the noise: their weight is about
        exp(-d / (2 similarity^2)), d the mean of squared differences.
    shares: of the mean in the result, one for each `AREA` of the frame, float32 (down, across); the rest is `clean`.
    out: (rows[1] - rows[0], W), scene units, written.
    """
    height, width = noisy.shape
    halo = radius + SURROUNDINGS
    tall, wide = _ROWS + 2 * halo, (_COLUMNS + 3 * halo + 2 * WIDTH) // WIDTH * WIDTH
    scale = _SCALE / similarity
    memory, pairs, distances = zeros(4, tall, wide), zeros(2 * radius + 1, wide), zeros(wide)
    even, samples, sums, weights = planes = memory[0], memory[1], memory[2], memory[3]
    for window in range(pieces[0], pieces[1]):
        first_row, end_row, left, right = tile_at(window, (rows[1] - rows[0], width), (_ROWS, _COLUMNS))
        top, down, across = rows[0] + first_row, end_row - first_row, right - left
        used = False
        for row in range(top, top + down):
            used = used or shares[row // _ROWS, left // _COLUMNS] > _NONE
        if not used:
            for row in range(top, top + down):
                for column in range(left, right):
                    out[row - rows[0], column] = clean[row - first, column]
            continue
        for row in range(down + 2 * halo):
            source = mirrored(top - halo + row, height)
            for column in range(across + 2 * halo):
                place = mirrored(left - halo + column, width)
                value = clean[source - first, place]
                even[row, column] = scale * _even(value, shot, read)
                samples[row, column] = value if uncertain[source % len(uncertain), place] else noisy[source, place]
                sums[row, column] = samples[row, column]
        weights[:] = _ONE
        end = down + halo
        for row in range(SURROUNDINGS, end):
            for apart in range(radius + 1):
                rights = (-radius if apart else 1), radius + 1  # each pair of pixels once
                if row >= halo or halo <= row + apart < end:
                    _weigh(even, row, apart, rights, across + 2 * halo, distances, pairs)
                if row >= halo:
                    _add(planes, row, row + apart, rights, (halo, halo + across), (0, 1), pairs)
                if halo <= row + apart < end:
                    _add(planes, row + apart, row, rights, (halo, halo + across), (-1, -1), pairs)
        for row in range(down):
            share = shares[(top + row) // _ROWS, left // _COLUMNS]
            for column in range(across):
                value = clean[top + row - first, left + column]
                mean = sums[row + halo, column + halo] / weights[row + halo, column + halo]
                out[top - rows[0] + row, left + column] = value + share * (mean - value)


@kernel
def _even(signal: Scalar, shot: Scalar, read: Scalar) -> Scalar:
    """A signal transformed so that its noise has a standard deviation of 1 at any brightness (Anscombe 1948); 0 at black.

    Two thirds of a float32's digits would be lost by 2 / shot * (root - read) where there is little shot noise.
    """
    variance = shot * signal + read * read
    if variance < _NONE:  # below the signal at which the model has no noise, all is alike
        variance, signal = _NONE, -read * read / shot
    even: Scalar = _TWO * signal / max(np.sqrt(variance) + read, _LEAST)
    return even


@kernel
def _weigh(even: Floats2, row: int, apart: int, rights: Pair, end: int, distances: Floats1, pairs: Floats2) -> None:
    """Weigh all pixels of a row, to column `end`, with those `apart` rows below and as far right as the span `rights` says."""
    for right in range(rights[0], rights[1]):
        for column in range(0, end, WIDTH):
            above = load(even, (row - 1 + apart, column + right)) - load(even, (row - 1, column))
            middle = load(even, (row + apart, column + right)) - load(even, (row, column))
            below = load(even, (row + 1 + apart, column + right)) - load(even, (row + 1, column))
            store(distances, column, above * above + _TWO * (middle * middle) + below * below)
        for column in range(SURROUNDINGS, end, WIDTH):
            distance = load(distances, column - 1) + _TWO * load(distances, column) + load(distances, column + 1)
            weight = greater(_ONE - distance, _NONE)
            weight = weight * weight
            store(pairs, (right - rights[0], column), weight * weight)


@kernel
def _add(planes: Planes, row: int, other: int, rights: Pair, span: Pair, steps: Pair, pairs: Floats2) -> None:
    """Add weighted samples of the row `other` to `row`, from the first to the end column of `span`.

    steps: columns to the weight of a pair, and to the other sample, in units of the pair's offset.
    """
    (_, samples, sums, weights), (here, there) = planes, steps
    for column in range(span[0], span[1], WIDTH):
        total, light = load(sums, (row, column)), load(weights, (row, column))
        for right in range(rights[0], rights[1]):
            weight = load(pairs, (right - rights[0], column + here * right))
            total += weight * load(samples, (other, column + there * right))
            light += weight
        store(sums, (row, column), total)
        store(weights, (row, column), light)
