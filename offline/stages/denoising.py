"""Denoise luminance by the amount of the sensor's noise: shrinkage in overlapping DCT blocks. The paper has no such stage.

Blocks of n x n pixels are transformed, for each size n: first coefficients below a threshold go, then, in a second pass, Wiener
gains from the first result take their place. With noise of variance v the gains of a block's coefficients x are

    1 where x^2 >= (threshold)^2 v, 0 elsewhere;   e^2 / (e^2 + v), e the coefficient of the first result

and the result is the mean of the blocks that cover a pixel, each with the weight (n^2 / sum of its squared gains)^1.5 / v: those
that need few coefficients are more certain. tests/reference/denoising.py is this with SciPy's DCT.

Shrinkage of overlapping DCT blocks goes back to Yaroslavsky's sliding window (1996); weights and a second pass with Wiener gains
are standard since. Small blocks suit edges, large ones gradients. Neighbouring blocks give nearly the same estimate: a quarter of
them, one in every second column of every second row of the frame, alternate rows shifted by one, loses 0.01 to 0.02 dB. The power
1.5 gains 0.05 dB over 1, which the variance of a block asks for.

The kernel works in windows that stay in the cache. The transform is separable. Its vertical half is computed for a row of blocks,
once per column; what the blocks of a row add to the picture is summed in this half-transformed state and transformed back once per
column, too. Sixteen blocks lie side by side in lanes, each two pixels to the right of the one before; a row of memory has its even
columns first, so that these are neighbours. The rows of a DCT are even or odd, so sums and differences of opposite pixels halve the
number of products. Sums of products are kept in registers, four at a time: one by one they take twice as long.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..numerics.arrays import Area, Bools2, Floats1, Floats2, Floats3, Ints1, Pair, Single
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import mirrored, tile_at, zeros
from ..numerics.lanes import WIDTH, Lanes, greater, load, quotient, square_root, store, where_less
from ..numerics.pieces import tiles
from ..stage import NotNegative, Positive, Range, StageSettings

LARGEST = 32  # pixels: side of a DCT block accepted at most, for time and memory
_SIZES = Range(lambda value: bool(value) and {*value} <= {*range(4, LARGEST + 1, 4)}, f"one or more multiples of 4 up to {LARGEST}")


@dataclass(frozen=True)
class DenoisingSettings(StageSettings):
    """Denoising of luminance; the paper has none.

    strength: how much noise to remove, as a multiple of the noise there is; 0 = none.
    sizes: sides of the DCT blocks, pixels, multiples of 4.
    threshold: threshold of the first pass, in standard deviations of the noise.
    """

    kernels = ("denoise",)
    asked_by = ("strength",)
    strength: NotNegative = 0.0
    sizes: Annotated[tuple[int, ...], _SIZES] = (4, 12)
    threshold: Positive = 2.4


_PIECE, _LEAST_ROWS = 1 << 21, 256  # pixels between two reports of progress, and the least number of rows


def denoise_luminance(
    luminance: FloatArray, mosaic: Mosaic, settings: DenoisingSettings, progress: Progress = SILENT
) -> FloatArray:
    """l[n] without noise, float32 (H, W), scene units; `luminance` itself where there is no noise to remove.

    luminance: (H, W), what `recover_luminance` returns. Its filled samples count as uncertain: the second pass replaces them by the
        result of the first.
    mosaic: its noise model and its pattern are used.
    """
    (height, width), noise = luminance.shape, mosaic.calibration.noise
    shot, read = (settings.strength**2 * noise.shot[-1], settings.strength * noise.read[-1]) if noise else (0.0, 0.0)
    if shot == 0 and read == 0:
        return luminance
    sizes: IndexArray = np.array(settings.sizes, np.intp)
    transforms = np.zeros((len(sizes), sizes.max(), sizes.max()), np.float32)
    for transform, size in zip(transforms, settings.sizes, strict=True):
        transform[:size, :size] = cosines(size)
    uncertain = ~mosaic.pattern.panchromatic_mask((mosaic.pattern.period, width))
    result = np.empty_like(luminance)
    step = max(_PIECE // width // _LEAST_ROWS, 1) * _LEAST_ROWS
    pieces = [(top, min(top + step, height)) for top in range(0, height, step)]
    progress.stage("denoising", len(pieces))
    shrinkage = Shrinkage(sizes, transforms, np.float32(shot), np.float32(read), np.float32(settings.threshold))
    for rows in pieces:
        denoise(luminance, uncertain, rows, shrinkage, result)
        progress.advance()
    return result


def cosines(size: int) -> FloatArray:
    """The matrix of the orthonormal DCT-II of `size` samples, float32 (size, size): [frequency, sample]."""
    frequency, place = np.arange(size)[:, None], np.arange(size) + 0.5
    matrix: DoubleArray = np.sqrt(2 / size) * np.cos(np.pi * frequency * place / size)
    matrix[0] = np.sqrt(1 / size)
    return matrix.astype(np.float32)


_ROWS, _COLUMNS = 256, 512  # of a window; chosen for speed
_STEP = 2  # pixels from one block to the next, down and across; chosen: one takes four times as long
_ZERO, _ONE = np.float32(0), np.float32(1)
_LEAST = np.float32(1e-20)  # variance; sums of weights, which are up to 2000 times its inverse, stay finite

Memory = tuple[Floats3, Floats3, Floats3]
"""What one worker computes with: planes of a window (samples, pilot, sums, weights), half-transformed rows, and blocks in lanes."""


class Shrinkage(NamedTuple):
    """Blocks and noise.

    sizes: n of each kind of block, multiples of 4.
    transforms: (sizes, largest n, largest n), in the first n rows and columns of each the DCT-II matrix [frequency, pixel].
    shot, read: variance of the noise = shot * signal + read**2.
    threshold: threshold of the first pass, in standard deviations of the noise.
    """

    sizes: Ints1
    transforms: Floats3
    shot: Single
    read: Single
    threshold: Single


@parallel_kernel(pieces=lambda noisy, uncertain, rows, *_: tiles((rows[1] - rows[0], noisy.shape[1]), (_ROWS, _COLUMNS)))
def denoise(pieces: Pieces, noisy: Floats2, uncertain: Bools2, rows: Pair, shrinkage: Shrinkage, out: Floats2) -> None:
    """Denoise rows[0] to rows[1] of a frame.

    noisy: (H, W), scene units.
    uncertain: bool (any rows, W), repeated down the frame: samples that the second pass replaces by the first pass's result.
    rows: first and end row to compute.
    out: (H, W), the computed rows are written.
    """
    height, width = noisy.shape
    most = shrinkage.transforms.shape[1]
    halo = 2 * (most - 1)
    tall, half = _ROWS + 2 * halo, (_COLUMNS + 2 * halo + 3 * _STEP * WIDTH) // (_STEP * WIDTH) * WIDTH
    wide = _STEP * half
    planes, halves, block = zeros(4, tall, wide), zeros(4, most, wide), zeros(3, most * most, WIDTH)
    samples, pilot, sums, weights = planes[0], planes[1], planes[2], planes[3]
    for window in range(pieces[0], pieces[1]):
        first_row, end_row, left, right = tile_at(window, (rows[1] - rows[0], width), (_ROWS, _COLUMNS))
        top, down, across = rows[0] + first_row, end_row - first_row, right - left
        for row in range(down + 2 * halo):
            source = mirrored(top - halo + row, height)
            for column in range(across + 2 * halo):
                samples[row, _place(column, half)] = noisy[source, mirrored(left - halo + column, width)]
        inner = halo // 2
        area = 0, down + 2 * halo, 0, across + 2 * halo
        _aggregate((planes, halves, block), False, area, top - halo, shrinkage)
        for row in range(inner, down + 2 * halo - inner):
            source = mirrored(top - halo + row, height)
            for column in range(inner, across + 2 * halo - inner):
                place = _place(column, half)
                pilot[row, place] = sums[row, place] / weights[row, place]
                if uncertain[source % len(uncertain), mirrored(left - halo + column, width)]:
                    samples[row, place] = pilot[row, place]
        area = inner, down + 2 * halo - inner, inner, across + 2 * halo - inner
        _aggregate((planes, halves, block), True, area, top - halo, shrinkage)
        for row in range(down):
            for column in range(across):
                place = _place(column + halo, half)
                out[top + row, left + column] = sums[row + halo, place] / weights[row + halo, place]


@kernel
def _place(column: int, half: int) -> int:
    """Where a column of a window lies in a row of memory, of which the first half has the even columns."""
    return column % _STEP * half + column // _STEP


@kernel
def _aggregate(memory: Memory, guided: bool, area: Area, first: int, shrinkage: Shrinkage) -> None:
    """Sum the shrunk blocks inside `area` with their weights, and the weights. area: first and end row, first and end column.

    first: the frame's row at row 0 of the window; the frame's column at column 0 is even.
    """
    planes, halves, block = memory
    samples, pilot, sums, weights = planes[0], planes[1], planes[2], planes[3]
    forward, expected, backward, light = halves[0], halves[1], halves[2], halves[3, 0]
    half = samples.shape[1] // _STEP
    sums[:] = _ZERO
    weights[:] = _ZERO
    for kind in range(len(shrinkage.sizes)):
        size, transform = shrinkage.sizes[kind], shrinkage.transforms[kind]
        for row in range(area[0] + (first + area[0]) % _STEP, area[1] - size + 1, _STEP):
            shift = ((first + row) // _STEP + area[2]) % _STEP
            _down(samples, row, size, transform, block[1], forward)
            if guided:
                _down(pilot, row, size, transform, block[1], expected)
            for k in range(size):
                backward[k] = _ZERO
            light[:] = _ZERO
            for column in range(area[2] + shift, area[3] - size + 1, _STEP * WIDTH):
                _across(forward, column, size, transform, block[1], block[0])
                if guided:
                    _across(expected, column, size, transform, block[1], block[2])
                    weight = _wiener(block, size, shrinkage)
                else:
                    weight = _hard(block, size, shrinkage)
                # Lanes beyond the last block reach only columns that nobody takes: fewer than `size` at the end of the area.
                _back(block[0], column, size, transform, weight, backward)
                for i in range(size):
                    place = _place(column + i, half)
                    store(light, place, load(light, place) + weight)
            _up(backward, light, row, size, transform, planes)


@kernel
def _down(plane: Floats2, row: int, size: int, transform: Floats2, folded: Floats2, out: Floats2) -> None:
    """Compute the vertical DCT of rows row .. row + size - 1 at every column."""
    half = size // 2
    for column in range(0, plane.shape[1], 2 * WIDTH):
        for i in range(half):
            for side in range(2):
                x = column + side * WIDTH
                a, b = load(plane, (row + i, x)), load(plane, (row + size - 1 - i, x))
                store(folded, (2 * i + side, 0), a + b)
                store(folded, (size + 2 * i + side, 0), a - b)
        for k in range(0, size, 4):
            for odd in range(2):
                a, b, c, d = _products(folded, size, transform, k + odd, odd * size)
                store(out, (k + odd, column), a)
                store(out, (k + odd + 2, column), b)
                store(out, (k + odd, column + WIDTH), c)
                store(out, (k + odd + 2, column + WIDTH), d)


@kernel
def _products(folded: Floats2, size: int, transform: Floats2, frequency: int, first: int) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """Two frequencies, the second one two above the first, of two vectors side by side in `folded` from row `first` on.

    The sums of more do not fit in the registers of AVX2.
    """
    a = b = c = d = load(folded, (0, 0)) * _ZERO
    for i in range(size // 2):
        one, other = load(folded, (first + 2 * i, 0)), load(folded, (first + 2 * i + 1, 0))
        a, b = a + transform[frequency, i] * one, b + transform[frequency + 2, i] * one
        c, d = c + transform[frequency, i] * other, d + transform[frequency + 2, i] * other
    return a, b, c, d


@kernel
def _across(halves: Floats2, column: int, size: int, transform: Floats2, folded: Floats2, out: Floats2) -> None:
    """Compute the horizontal DCT of sixteen blocks, to out[vertical frequency * size + horizontal frequency]."""
    half, apart = size // 2, halves.shape[1] // _STEP
    for k in range(0, size, 2):
        for i in range(half):
            left, right = _place(column + i, apart), _place(column + size - 1 - i, apart)
            for row in range(2):
                a, b = load(halves, (k + row, left)), load(halves, (k + row, right))
                store(folded, (2 * i + row, 0), a + b)
                store(folded, (size + 2 * i + row, 0), a - b)
        for j in range(0, size, 4):
            for odd in range(2):
                place = k * size + j + odd
                a, b, c, d = _products(folded, size, transform, j + odd, odd * size)
                store(out, (place, 0), a)
                store(out, (place + 2, 0), b)
                store(out, (place + size, 0), c)
                store(out, (place + size + 2, 0), d)


@kernel
def _hard(block: Floats3, size: int, shrinkage: Shrinkage) -> Lanes:
    """Set the coefficients below the threshold to 0, except the mean. Returns the weight."""
    variance, threshold = _variance(load(block, (0, 0, 0)), size, shrinkage), shrinkage.threshold
    limit = variance * (threshold * threshold)
    kept = limit * _ZERO + _ONE
    for place in range(1, size * size):
        value = load(block, (0, place, 0))
        stays = where_less(value * value, limit, _ZERO, _ONE)
        kept += stays
        store(block, (0, place, 0), value * stays)  # the compiler makes a choice of this a masked store, which takes 20 cycles
    return _weight(kept, variance, size)


@kernel
def _wiener(block: Floats3, size: int, shrinkage: Shrinkage) -> Lanes:
    """Scale coefficients by expected energy / (expected energy + noise), except the mean. Returns the weight, as `_hard` does."""
    variance = _variance(load(block, (2, 0, 0)), size, shrinkage)
    kept = variance * _ZERO + _ONE
    for place in range(1, size * size):
        value = load(block, (2, place, 0))
        energy = value * value
        share = quotient(energy, energy + variance)
        kept += share * share
        store(block, (0, place, 0), load(block, (0, place, 0)) * share)
    return _weight(kept, variance, size)


@kernel
def _weight(kept: Lanes, variance: Lanes, size: int) -> Lanes:
    """Weight of a block. Its mean has variance / fewer left, and more weight than the inverse of that pays (measured)."""
    fewer = quotient(np.float32(size * size), kept)
    return quotient(fewer * square_root(fewer), variance)


@kernel
def _variance(mean: Lanes, size: int, shrinkage: Shrinkage) -> Lanes:
    """Noise variance of the samples of a block, given its DC coefficient `mean`."""
    return greater(greater(mean, _ZERO) * (shrinkage.shot / np.float32(size)) + shrinkage.read * shrinkage.read, _LEAST)


@kernel
def _back(block: Floats2, column: int, size: int, transform: Floats2, weight: Lanes, out: Floats2) -> None:
    """Add sixteen weighted blocks, transformed back horizontally, to the half-transformed row.

    The loop goes pixel by pixel, with all frequencies of each: a store that overlaps the previous one would wait for it.
    """
    half, apart = size // 2, out.shape[1] // _STEP
    for i in range(half):
        left, right = _place(column + i, apart), _place(column + size - 1 - i, apart)
        for k in range(0, size, 2):
            a = b = c = d = weight * _ZERO
            for j in range(0, size, 2):
                even, odd, place = transform[j, i], transform[j + 1, i], k * size + j
                a, b = a + even * load(block, (place, 0)), b + odd * load(block, (place + 1, 0))
                c, d = c + even * load(block, (place + size, 0)), d + odd * load(block, (place + size + 1, 0))
            store(out, (k, left), load(out, (k, left)) + weight * (a + b))
            store(out, (k, right), load(out, (k, right)) + weight * (a - b))
            store(out, (k + 1, left), load(out, (k + 1, left)) + weight * (c + d))
            store(out, (k + 1, right), load(out, (k + 1, right)) + weight * (c - d))


@kernel
def _up(half: Floats2, light: Floats1, row: int, size: int, transform: Floats2, planes: Floats3) -> None:
    """Add a row of blocks, transformed back vertically, to the picture: to the planes `sums` and `weights`."""
    sums, weights = planes[2], planes[3]
    for column in range(0, light.shape[0], WIDTH):
        weight = load(light, column)
        for i in range(size // 2):
            even, odd = weight * _ZERO, weight * _ZERO
            for k in range(0, size, 2):
                even += transform[k, i] * load(half, (k, column))
                odd += transform[k + 1, i] * load(half, (k + 1, column))
            a, b = row + i, row + size - 1 - i
            store(sums, (a, column), load(sums, (a, column)) + (even + odd))
            store(sums, (b, column), load(sums, (b, column)) + (even - odd))
            store(weights, (a, column), load(weights, (a, column)) + weight)
            store(weights, (b, column), load(weights, (b, column)) + weight)
