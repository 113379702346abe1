"""What foretells the errors of a picture, pixel by pixel, and their variances as sums of it (see `offline.rows.uncertainty`)."""

from collections.abc import Callable

import numpy as np

from .arrays import Doubles1, Doubles2, Floats1, Floats2, Floats3, Frozen2, Frozen3, Ints1
from .compile import Pieces, kernel, parallel_kernel
from .functions import unset

WIDE, NARROW = 3, 1
"""Radii of the windows, pixels, in which chromaticity and luminance are looked at."""
_NONE = np.float32(0)
_LEAST = np.float32(1e-30)  # keeps quotients finite


Buffers = tuple[Doubles2, Doubles1, Doubles1]


def _spread(reach: int, step: int) -> Callable[[Floats2, int, Buffers, Floats1], None]:
    """The kernel for the variance of a plane around each pixel of a row, in windows as far as there are pixels.

    reach: rows and columns to each side; of the rows every `step`-th counts. Constants: only then loops become vectors.
    """

    @kernel
    def spread(plane: Floats2, here: int, buffers: Buffers, out: Floats1) -> None:
        """Variance of a plane, (rows, W), around the row `here`. buffers: (2, W + 2 reach or more), and twice (W,)."""
        (height, width), (sums, total, squares) = plane.shape, buffers
        sums[:] = 0.0
        rows = 0
        for row in range(here - reach, here + reach + 1, step):
            if 0 <= row < height:
                rows += 1
                for x in range(width):
                    value = np.float64(plane[row, x])
                    sums[0, x + reach] += value
                    sums[1, x + reach] += value * value
        total[:] = 0.0
        squares[:] = 0.0
        for column in range(2 * reach + 1):
            for x in range(width):
                total[x] += sums[0, x + column]
                squares[x] += sums[1, x + column]
        for x in range(width):
            share = 1.0 / (rows * (min(x + reach, width - 1) - max(x - reach, 0) + 1))
            mean = total[x] * share
            out[x] = max(squares[x] * share - mean * mean, 0.0)

    return spread


_narrow, _wide = _spread(NARROW, 1), _spread(WIDE, 2)


@parallel_kernel(pieces=lambda *given: len(given[-1]))
def uncertainty(
    pieces: Pieces,
    light: Frozen2,
    known: Frozen3,
    shares: Frozen3,
    blocks: Frozen3,
    columns: tuple[Ints1, Floats1],
    down: float,
    first: int,
    gamma: Floats1,
    weights: Floats2,
    out: Floats3,
) -> None:
    """Standard deviations of the errors of some rows of a picture, in units of luminance.

    light: luminance of a part of a picture, (rows, W).
    known: (3, rows, W), variance of the noise and of the grain (see `Uncertainty`), and how far luminance was corrected at colour
        sites; -1 elsewhere.
    shares: gamma_i times chromaticity i, (C, rows, W).
    blocks: the same of all blocks, (C, block rows, block columns).
    columns: column of blocks to the left of each pixel, and how far it is from there to the next, 0 to 1.
    down: row of blocks, with a fraction, at the part's row `first`, which belongs to out[0].
    gamma: (C,), the weights of Eq. 7.
    weights: (2, 6), of the variances for luminance and for colour; then the rows of blocks per row of pixels.
    out: (rows, W, 1 + C), written.
    """
    count, width, across = len(shares), light.shape[1], blocks.shape[2]
    left, near = columns
    sums, total, squares, line = np.empty((2, width + 2 * WIDE)), np.empty(width), np.empty(width), unset(across + 1)
    # Loops over lines without gaps and without gathering are those that the compiler turns into vectors.
    level, wide, apart, found = unset(width), unset(width), unset(width), unset(width)
    for row in range(pieces[0], pieces[1]):
        here = row + first
        _narrow(light, here, (sums, total, squares), level)
        for x in range(width):
            noise, grain, moved, contrast = known[0, here, x], known[1, here, x], known[2, here, x], np.sqrt(level[x])
            own, share = noise * grain / max(noise + grain, _LEAST), contrast / max(np.sqrt(noise) + contrast, _LEAST)
            v = weights[0, 0] * noise + weights[0, 1] * noise * share + weights[0, 2] * own
            filled = weights[0, 3] * level[x] + weights[0, 4] * grain + weights[0, 5] * contrast * moved
            found[x] = np.sqrt(v + (filled if moved >= _NONE else _NONE))
        for x in range(width):
            out[row, x, 0] = found[x]
        place = min(max(down + row * weights[2, 0], 0.0), blocks.shape[1] - 1.0)
        above = min(int(place), max(blocks.shape[1] - 2, 0))
        below, part = min(above + 1, blocks.shape[1] - 1), np.float32(place - above)
        for i in range(count):
            for x in range(across):
                line[x] = blocks[i, above, x] + part * (blocks[i, below, x] - blocks[i, above, x])
            line[across] = line[across - 1]
            _wide(shares[i], here, (sums, total, squares), wide)
            for x in range(width):
                apart[x] = shares[i, here, x] - line[left[x]] - near[x] * (line[left[x] + 1] - line[left[x]])
            for x in range(width):
                bright = light[here, x]
                noise, spread, far = known[0, here, x], wide[x] * bright * bright, apart[x] * bright
                v = weights[1, 0] * noise + weights[1, 1] * known[1, here, x] + weights[1, 2] * spread
                v += weights[1, 3] * far * far + weights[1, 4] * level[x] + weights[1, 5] * np.sqrt(noise * spread)
                found[x] = np.sqrt(v) / gamma[i]
            for x in range(width):
                out[row, x, 1 + i] = found[x]
