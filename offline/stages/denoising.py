"""Denoise luminance by the amount of the sensor's noise: shrinkage in overlapping DCT blocks. The
paper has no such stage.

Blocks of n x n pixels are transformed, for each size n: first coefficients below a threshold go,
then, in a second pass, Wiener gains from the first result take their place. With noise of variance
v the gains of a block's coefficients x are

    1 where x^2 >= (threshold)^2 v, 0 elsewhere          (first pass)
    e^2 / (e^2 + v), e the coefficient of the first result   (second pass)

and the result is the mean of the blocks that cover a pixel, each with the weight (n^2 / sum of its
squared gains)^1.5 / v: those that need few coefficients are more certain.

Shrinkage of overlapping DCT blocks goes back to Yaroslavsky's sliding window (1996); weights and a
second pass with Wiener gains are standard since. Small blocks suit edges, large ones gradients.
Neighbouring blocks give nearly the same estimate: a quarter of them is used, one in every second
column of every second row of the frame, alternate rows shifted by one. The power 1.5 is chosen on
photographs; the variance of a block asks for 1.

The kernel works in windows that stay in the cache. The transform is separable. Its vertical half is
computed for a row of blocks, once per column; what the blocks of a row add to the picture is summed
in this half-transformed state and transformed back once per column, too. Sixteen blocks lie side by
side in lanes, each two pixels to the right of the one before; a row of memory has its even columns
first, so that these are neighbours. The rows of a DCT are even or odd, so sums and differences of
opposite pixels halve the number of products. Sums of products are kept in registers, four at a
time: one by one they take twice as long.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ...shared.arrays import DoubleArray, FloatArray, IndexArray, Pair
from ...shared.mosaic import Mosaic
from ...shared.progress import SILENT, Progress
from ..numerics.arrays import Area, Bools2, Floats1, Floats2, Floats3, Ints1, Single
from ..numerics.compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from ..numerics.functions import chunk_at, chunk_count, mirrored, zeros
from ..numerics.lanes import WIDTH, Lanes, greater, load, quotient, square_root, store, where_less
from ..stage import NotNegative, Positive, Range, StageSettings

LARGEST = 32  # pixels: side of a DCT block accepted at most, for time and memory
_SIZES = Range(
    lambda value: bool(value) and {*value} <= {*range(4, LARGEST + 1, 4)},
    f"one or more multiples of 4 up to {LARGEST}",
)


@dataclass(frozen=True)
class DenoisingSettings(StageSettings):
    """Denoising of luminance; the paper has none.

    Attributes
    ----------
    strength : NotNegative
        How much noise to remove, as a multiple of the noise there is; 0 = none.
    sizes : tuple[int, ...]
        Sides of the DCT blocks, pixels, multiples of 4.
    threshold : Positive
        Threshold of the first pass, in standard deviations of the noise.
    """

    strength: NotNegative = 0.0
    sizes: Annotated[tuple[int, ...], _SIZES] = (4, 12)
    threshold: Positive = 2.4


def denoise_luminance(
    luminance: FloatArray, mosaic: Mosaic, settings: DenoisingSettings, progress: Progress = SILENT
) -> FloatArray:
    """l[n] without noise, float32 (H, W), scene units; `luminance` itself where there is no noise
    to remove.

    Parameters
    ----------
    luminance : FloatArray
        (H, W), what `recover_luminance` returns. Its filled samples count as uncertain: the second
        pass replaces them by the result of the first.
    mosaic : Mosaic
        Its noise model and its pattern are used.
    """
    noise = mosaic.calibration.noise
    if noise is None:
        return luminance
    shot, read = settings.strength**2 * noise.shot[-1], settings.strength * noise.read[-1]
    if shot == 0 and read == 0:
        return luminance
    sizes: IndexArray = np.array(settings.sizes, np.intp)
    transforms = np.zeros((len(sizes), sizes.max(), sizes.max()), np.float32)
    for transform, size in zip(transforms, settings.sizes, strict=True):
        transform[:size, :size] = cosines(size)
    filled = ~mosaic.pattern.panchromatic_mask((mosaic.pattern.period, luminance.shape[1]))
    result = np.empty_like(luminance)
    progress.stage("denoising luminance", 1)
    noise_model = np.float32(shot), np.float32(read)
    shrinkage = Shrinkage(sizes, transforms, *noise_model, np.float32(settings.threshold))
    denoise(luminance, filled, shrinkage, result)
    progress.advance()
    return result


def cosines(size: int) -> FloatArray:
    """The matrix of the orthonormal DCT-II of `size` samples, float32 (size, size): [frequency,
    sample].
    """
    frequency, place = np.arange(size)[:, None], np.arange(size) + 0.5
    matrix: DoubleArray = np.sqrt(2 / size) * np.cos(np.pi * frequency * place / size)
    matrix[0] = np.sqrt(1 / size)
    return matrix.astype(np.float32)


_WINDOW = 256, 512  # rows and columns; chosen for speed
# Pixels from one block to the next, down and across; chosen: one takes four times as long.
_STEP = 2
# Least variance: sums of weights, which are up to 2000 times its inverse, stay finite.
_LEAST_VARIANCE = np.float32(1e-20)


class Shrinkage(NamedTuple):
    """Blocks and noise.

    Attributes
    ----------
    sizes : Ints1
        n of each kind of block, multiples of 4.
    transforms : Floats3
        (sizes, largest n, largest n), in the first n rows and columns of each the DCT-II matrix
        [frequency, pixel].
    shot, read : Single
        Variance of the noise = shot * signal + read**2.
    threshold : Single
        Threshold of the first pass, in standard deviations of the noise.
    """

    sizes: Ints1
    transforms: Floats3
    shot: Single
    read: Single
    threshold: Single


class Memory(NamedTuple):
    """Memory that a worker computes with.

    Attributes
    ----------
    samples, pilot : Floats2
        Planes of a window: what is transformed, and the result of the first pass.
    sums, weights : Floats2
        Weighted sums of the blocks at each pixel of the window, and of their weights.
    halves : Floats3
        (4, n, columns), rows of blocks that are half transformed: of the samples, of the pilot, and
        back; and their weights.
    block : Floats3
        (3, n * n, 16), of sixteen blocks the coefficients, sums and differences of opposite pixels,
        the pilot's coefficients.
    """

    samples: Floats2
    pilot: Floats2
    sums: Floats2
    weights: Floats2
    halves: Floats3
    block: Floats3


@parallel_kernel(chunks=lambda *arguments: chunk_count(arguments[-1].shape, _WINDOW))
def denoise(
    chunks: Chunks, noisy: Floats2, filled: Bools2, shrinkage: Shrinkage, out: Floats2
) -> None:
    """Denoise a frame.

    Parameters
    ----------
    noisy : Floats2
        (H, W), scene units.
    filled : Bools2
        bool (any rows, W), repeated down the frame: samples that the second pass replaces by the
        first pass's result.
    out : Floats2
        (H, W), written.
    """
    (height, width), most = noisy.shape, shrinkage.transforms.shape[1]
    inner, halo = most - 1, 2 * (most - 1)
    tall = _WINDOW[0] + 2 * halo
    half = (_WINDOW[1] + 2 * halo + 3 * _STEP * WIDTH) // (_STEP * WIDTH) * WIDTH
    wide = _STEP * half
    samples, pilot = zeros(tall, wide), zeros(tall, wide)
    sums, weights = zeros(tall, wide), zeros(tall, wide)
    halves, block = zeros(4, most, wide), zeros(3, most * most, WIDTH)
    memory = Memory(samples, pilot, sums, weights, halves, block)
    for window in range(chunks[0], chunks[1]):
        above, below, left, right = chunk_at(window, out.shape, _WINDOW)
        top = above - halo
        down = below - above + 2 * halo
        across = right - left + 2 * halo
        # Where each row and column of the window lies in the frame, and each column in memory.
        sources = np.array([mirrored(top + row, height) for row in range(down)])
        columns = np.array([mirrored(left - halo + column, width) for column in range(across)])
        places = np.array([_place(column, half) for column in range(across)])
        for row in range(down):
            for column in range(across):
                samples[row, places[column]] = noisy[sources[row], columns[column]]
        _aggregate(memory, False, (0, down, 0, across), top, shrinkage)
        for row in range(inner, down - inner):
            line = filled[sources[row] % len(filled)]
            for column in range(inner, across - inner):
                place = places[column]
                pilot[row, place] = sums[row, place] / weights[row, place]
                if line[columns[column]]:
                    samples[row, place] = pilot[row, place]
        _aggregate(memory, True, (inner, down - inner, inner, across - inner), top, shrinkage)
        for row in range(halo, down - halo):
            for column in range(halo, across - halo):
                place = places[column]
                value = sums[row, place] / weights[row, place]
                out[above - halo + row, left - halo + column] = value


@kernel
def _place(column: int, half: int) -> int:
    """Return the place of a column of a window in a row of memory, of which the first half has the
    even columns.
    """
    return column % _STEP * half + column // _STEP


@kernel
def _aggregate(memory: Memory, guided: bool, area: Area, first: int, shrinkage: Shrinkage) -> None:
    """Sum the shrunk blocks inside `area` with their weights, and the weights. area: first and end
    row, first and end column.

    first: the frame's row at row 0 of the window; the frame's column at column 0 is even.
    """
    block, half = memory.block, memory.sums.shape[1] // _STEP
    forward, expected, backward = memory.halves[0], memory.halves[1], memory.halves[2]
    total = memory.halves[3, 0]
    memory.sums[:] = ZERO
    memory.weights[:] = ZERO
    for kind in range(len(shrinkage.sizes)):
        size, transform = shrinkage.sizes[kind], shrinkage.transforms[kind]
        for row in range(area[0] + (first + area[0]) % _STEP, area[1] - size + 1, _STEP):
            shift = ((first + row) // _STEP + area[2]) % _STEP
            _down(memory.samples, row, size, transform, block[1], forward)
            if guided:
                _down(memory.pilot, row, size, transform, block[1], expected)
            backward[:size] = ZERO
            total[:] = ZERO
            # Lanes beyond the last block reach only columns that nobody takes: fewer than `size` at
            # the end of the area.
            for column in range(area[2] + shift, area[3] - size + 1, _STEP * WIDTH):
                _across(forward, column, size, transform, block[1], block[0])
                if guided:
                    _across(expected, column, size, transform, block[1], block[2])
                weight = _shrink(block, size, guided, shrinkage)
                _back(block[0], column, size, transform, weight, backward)
                for i in range(size):
                    place = _place(column + i, half)
                    store(total, place, load(total, place) + weight)
            _up(backward, total, row, size, transform, memory)


@kernel
def _down(plane: Floats2, row: int, size: int, dct: Floats2, folded: Floats2, out: Floats2) -> None:
    """Compute the vertical DCT of rows row .. row + size - 1 at every column."""
    for column in range(0, plane.shape[1], 2 * WIDTH):
        for i in range(size // 2):
            for side in range(2):
                x = column + side * WIDTH
                a, b = load(plane, (row + i, x)), load(plane, (row + size - 1 - i, x))
                _fold(a, b, 2 * i + side, size, folded)
        _transform(folded, size, dct, (0, column), (0, column + WIDTH), out)


@kernel
def _across(
    halves: Floats2, column: int, size: int, transform: Floats2, folded: Floats2, out: Floats2
) -> None:
    """Compute the horizontal DCT of sixteen blocks, to out[vertical frequency * size + horizontal
    frequency].
    """
    apart = halves.shape[1] // _STEP
    for k in range(0, size, 2):
        for i in range(size // 2):
            left, right = _place(column + i, apart), _place(column + size - 1 - i, apart)
            for side in range(2):
                a, b = load(halves, (k + side, left)), load(halves, (k + side, right))
                _fold(a, b, 2 * i + side, size, folded)
        _transform(folded, size, transform, (k * size, 0), (k * size + size, 0), out)


@kernel
def _fold(a: Lanes, b: Lanes, place: int, size: int, folded: Floats2) -> None:
    """Keep the sum and the difference of opposite pixels."""
    store(folded, (place, 0), a + b)
    store(folded, (size + place, 0), a - b)


@kernel
def _transform(
    folded: Floats2, size: int, transform: Floats2, one: Pair, other: Pair, out: Floats2
) -> None:
    """Write the frequencies of two vectors that are side by side in `folded` to the rows of `out`
    that begin at `one` and `other`.

    Two at a time: the sums of more do not fit in the registers of AVX2.
    """
    for even in range(0, size, 4):
        for odd in range(2):
            k = even + odd
            a = b = c = d = load(folded, (0, 0)) * ZERO
            for i in range(size // 2):
                place = odd * size + 2 * i
                x, y = load(folded, (place, 0)), load(folded, (place + 1, 0))
                a, b = a + transform[k, i] * x, b + transform[k + 2, i] * x
                c, d = c + transform[k, i] * y, d + transform[k + 2, i] * y
            store(out, (one[0] + k, one[1]), a)
            store(out, (one[0] + k + 2, one[1]), b)
            store(out, (other[0] + k, other[1]), c)
            store(out, (other[0] + k + 2, other[1]), d)


@kernel
def _shrink(block: Floats3, size: int, guided: bool, shrinkage: Shrinkage) -> Lanes:
    """Multiply the coefficients of sixteen blocks by their gains, except the mean, whose gain is 1.
    Returns the weights.
    """
    guide, squared = 2 if guided else 0, shrinkage.threshold * shrinkage.threshold
    mean = greater(load(block, (guide, 0, 0)), ZERO)  # n times the mean of the block
    variance = mean * (shrinkage.shot / np.float32(size)) + shrinkage.read * shrinkage.read
    variance = greater(variance, _LEAST_VARIANCE)
    kept = variance * ZERO + ONE
    for place in range(1, size * size):
        energy = load(block, (guide, place, 0))
        energy *= energy
        if guided:
            gain = quotient(energy, energy + variance)
        else:
            gain = where_less(energy, variance * squared, ZERO, ONE)
        kept += gain * gain
        store(block, (0, place, 0), load(block, (0, place, 0)) * gain)
    fewer = quotient(np.float32(size * size), kept)
    return quotient(fewer * square_root(fewer), variance)


@kernel
def _back(
    block: Floats2, column: int, size: int, transform: Floats2, weight: Lanes, out: Floats2
) -> None:
    """Add sixteen weighted blocks, transformed back horizontally, to the half-transformed row.

    The loop goes pixel by pixel, with all frequencies of each: a store that overlaps the previous
    one would wait for it.
    """
    half, apart = size // 2, out.shape[1] // _STEP
    for i in range(half):
        left, right = _place(column + i, apart), _place(column + size - 1 - i, apart)
        for k in range(0, size, 2):
            a = b = c = d = weight * ZERO
            for j in range(0, size, 2):
                even, odd, place = transform[j, i], transform[j + 1, i], k * size + j
                a, b = a + even * load(block, (place, 0)), b + odd * load(block, (place + 1, 0))
                c = c + even * load(block, (place + size, 0))
                d = d + odd * load(block, (place + size + 1, 0))
            store(out, (k, left), load(out, (k, left)) + weight * (a + b))
            store(out, (k, right), load(out, (k, right)) + weight * (a - b))
            store(out, (k + 1, left), load(out, (k + 1, left)) + weight * (c + d))
            store(out, (k + 1, right), load(out, (k + 1, right)) + weight * (c - d))


@kernel
def _up(half: Floats2, total: Floats1, row: int, size: int, dct: Floats2, memory: Memory) -> None:
    """Add a row of blocks, transformed back vertically, to the picture."""
    sums, weights = memory.sums, memory.weights
    for column in range(0, total.shape[0], WIDTH):
        weight = load(total, column)
        for i in range(size // 2):
            even, odd = weight * ZERO, weight * ZERO
            for k in range(0, size, 2):
                even += dct[k, i] * load(half, (k, column))
                odd += dct[k + 1, i] * load(half, (k + 1, column))
            a, b = row + i, row + size - 1 - i
            store(sums, (a, column), load(sums, (a, column)) + (even + odd))
            store(sums, (b, column), load(sums, (b, column)) + (even - odd))
            store(weights, (a, column), load(weights, (a, column)) + weight)
            store(weights, (b, column), load(weights, (b, column)) + weight)
