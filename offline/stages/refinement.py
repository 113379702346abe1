"""Non-local averaging of chromaticity among pixels whose luminance looks alike (section 3.3, Eqs.
15-16).

    c+[n] = sum_n' kappa_n[n'] c[n'] / sum_n' kappa_n[n'],   n' in a window around n     (15)
    kappa_n[n'] = l[n'] exp(-(G * (l - l shifted by n' - n)^2)[n] / (2 h^2)),            (16)
    h = lambda sigma_z

G is a Gaussian, and negative luminance counts as none. tests/reference/refinement.py transcribes
this literally.

The kernel works in chunks that stay in the cache. Weights without l[n'] are computed once for all
repetitions, and for half the offsets: the distance from n' to n equals that from n to n'. The
offset (down, across) has the number down * side + across; the opposite one has its negative.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from ...shared.arrays import Pair, mirrored
from ..bands import Band, Halo, RowStage
from ..frame import Frame
from ..numerics.arrays import Floats1, Floats2, Floats3
from ..numerics.compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from ..numerics.functions import LEAST_EXPONENT, chunk_at, chunk_count, exponential, unset, zeros
from ..numerics.gaussian import gaussian
from ..numerics.lanes import WIDTH, Lanes, greater, load, quotient, store
from ..stage import NotNegative, Positive, Range, StageSettings


@dataclass(frozen=True)
class RefinementSettings(StageSettings):
    """Non-local averaging of chromaticity, Eqs. 15-16.

    Attributes
    ----------
    strength : NotNegative
        Lambda in h = lambda sigma_z, 40 in the paper.
    floor : Positive
        The least h, scene units, > 0; it makes sigma_z = 0 defined and the average harmless there.
    blur : float
        Standard deviation of G in periods (K/8 in the paper), more than 0, 8 at most.
    repetitions : int
        0 to 64 ("multiple times" in the paper).
    """

    strength: NotNegative = 40.0
    floor: Positive = 1e-3
    blur: Annotated[float, Range(lambda value: 0 < value <= 8, "more than 0, 8 at most")] = 1 / 8
    repetitions: Annotated[int, Range(lambda value: 0 <= value <= 64, "0 to 64")] = 2


@dataclass(eq=False)
class Refinement(RowStage):
    """c+[n] of Eq. 15 over a window of about one period, applied `settings.repetitions` times, 1 or
    more.
    """

    frame: Frame
    settings: RefinementSettings

    name = "refinement"

    @property
    def halo(self) -> Halo:
        """Half a window for each repetition."""
        return Halo(self.settings.repetitions * (self.frame.pattern.period // 2))

    @cached_property
    def sigma(self) -> float:
        """sigma_z of Eq. 16, scene units: panchromatic noise at the mean luminance; 0 if it is not
        known.
        """
        noise = self.frame.noise
        return noise.sigma(float(self.frame.luminance.mean(dtype=np.float64))) if noise else 0.0

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows with their chromaticity refined, c+[n]."""
        luminance, period, settings = self.frame.luminance, self.frame.pattern.period, self.settings
        result = np.empty((rows[1] - rows[0], *band.chromaticity.shape[1:]), np.float32)
        width = max(settings.strength * self.sigma, settings.floor)  # h
        # A window of (K + 1) x (K + 1) for even K.
        blur, radius = gaussian(settings.blur * period), period // 2
        margin = (settings.repetitions + 1) * radius + len(blur) // 2
        height, columns = luminance.shape
        down = mirrored(np.arange(rows[0] - margin, rows[1] + margin), height)
        across = mirrored(np.arange(-margin, columns + margin), columns)
        # Beyond the rows of the band, weights alone are needed.
        at = (down - band.first).clip(0, len(band.chromaticity) - 1)
        lit, start = luminance[np.ix_(down, across)], band.chromaticity[np.ix_(at, across)]
        average(lit, start, Window(radius, blur, -0.5 / width**2, settings.repetitions), result)
        return Band(rows[0], band.rows(*rows).luminance, result)


_ROWS, _COLUMNS = 64, 240  # of a chunk; chosen for speed: no bit depends on it
_TOGETHER = 4  # planes summed at a time
_SMALLEST_FLOAT = np.finfo(np.float32).tiny


class Window(NamedTuple):
    """Pixels that are averaged.

    Attributes
    ----------
    radius : int
        Of the square window around n, pixels.
    blur : Floats1
        Taps of the Gaussian G, an odd number.
    falloff : float
        -1 / (2 h^2).
    repetitions : int
        1 or more.
    """

    radius: int
    blur: Floats1
    falloff: float
    repetitions: int


@parallel_kernel(chunks=lambda *arguments: chunk_count(arguments[-1].shape[:2], (_ROWS, _COLUMNS)))
def average(
    chunks: Chunks, luminance: Floats2, start: Floats3, window: Window, out: Floats3
) -> None:
    """Average the chromaticities of Eq. 10 over some rows of the frame.

    Parameters
    ----------
    luminance : Floats2
        Scene units; radius * (repetitions + 1) + half the taps of the blur more than `out` on all
        sides.
    start : Floats3
        Chromaticities, (rows, columns, C) of the same pixels.
    out : Floats3
        (rows of the result, W, C), written.
    """
    (height, width, channels), radius, reach = out.shape, window.radius, len(window.blur) // 2
    margin = (window.repetitions + 1) * radius + reach
    # Spare columns in front, so that the first one with weights begins where a vector does.
    begin = (radius + reach + WIDTH - 1) // WIDTH * WIDTH
    lead = begin - radius - reach
    tall = min(_ROWS, height) + 2 * margin
    wide = (min(_COLUMNS, width) + 2 * margin + lead) // WIDTH * WIDTH + 2 * WIDTH
    planes = (channels + _TOGETHER) // _TOGETHER * _TOGETHER
    weights = unset(radius * (2 * radius + 2) + 1, tall, wide)
    colour, mean, own = zeros(planes, tall, wide), zeros(planes, tall, wide), zeros(tall, wide)
    for chunk in range(chunks[0], chunks[1]):
        top, bottom, left, right = chunk_at(chunk, (height, width), (_ROWS, _COLUMNS))
        below, after = bottom - top + margin, right - left + margin
        for row in range(below + margin):
            source = luminance[top + row, left : left + after + margin]
            _gather(source, start[top + row, left:], own[row, lead:], colour[:, row, lead:])
        columns = begin, lead + after + margin - radius - reach
        _weigh(own, (2 * radius, below + margin - 2 * radius), columns, window, weights)
        for following in range(window.repetitions - 1, -1, -1):
            rows = margin - following * radius, below + following * radius
            _average(weights, colour, rows, columns, radius, mean)
            if following:
                _lit(mean, rows, columns, colour)
        for row in range(margin, below):
            before = start[top + row, left + margin :]
            refined = out[top + row - margin, left : left + after - margin]
            _finish(mean[:, row, lead + margin :], before, refined)


@kernel
def _gather(source: Floats1, tints: Floats2, lit: Floats1, colour: Floats2) -> None:
    """Copy a row of the frame, with luminance, and luminance times chromaticity: Eq. 16 multiplies
    weights by the other pixel's luminance.
    """
    for column in range(len(source)):
        lit[column] = source[column]
        colour[0, column] = max(lit[column], ZERO)
        for channel in range(tints.shape[1]):
            colour[channel + 1, column] = colour[0, column] * tints[column, channel]


@kernel
def _finish(mean: Floats2, initial: Floats2, out: Floats2) -> None:
    """Write a row of the result; a pixel in the dark keeps its chromaticity."""
    for channel in range(out.shape[1]):
        for column in range(len(out)):
            lit = mean[0, column] > _SMALLEST_FLOAT
            out[column, channel] = mean[channel + 1, column] if lit else initial[column, channel]


@kernel
def _weigh(plane: Floats2, rows: Pair, columns: Pair, window: Window, weights: Floats3) -> None:
    """Compute the weights of Eq. 16, without the luminance; 0 below an exponent of -87.

    rows: the first and the end of those that the first repetition looks at, `reach` more on both
    sides. columns: with weights.
    """
    radius, blur, falloff = window.radius, window.blur, np.float32(window.falloff)
    reach, side = len(blur) // 2, 2 * radius + 1
    squares, lines = zeros(plane.shape[1]), zeros(len(plane), plane.shape[1])
    for offset in range(len(weights)):
        down, across = (offset + radius) // side, (offset + radius) % side - radius
        for row in range(rows[0] - down, rows[1]):  # those above are paired with the first ones
            for column in range(columns[0] - reach, columns[1] + reach, WIDTH):
                difference = load(plane, (row + down, column + across)) - load(plane, (row, column))
                store(squares, column, difference * difference)
            for column in range(columns[0], columns[1], WIDTH):
                total = blur[0] * load(squares, column - reach)
                for tap in range(1, len(blur)):
                    total += blur[tap] * load(squares, column - reach + tap)
                store(lines, (row, column), total)
        for row in range(rows[0] - down + reach, rows[1] - reach):
            for column in range(columns[0], columns[1], WIDTH):
                total = blur[0] * load(lines, (row - reach, column))
                for tap in range(1, len(blur)):
                    total += blur[tap] * load(lines, (row - reach + tap, column))
                store(weights, (offset, row, column), total * falloff)
            line = weights[offset, row, columns[0] : columns[1]]
            for column in range(len(line)):
                weight = exponential(line[column])
                line[column] = weight if line[column] >= LEAST_EXPONENT else ZERO


@kernel
def _average(
    weights: Floats3, colour: Floats3, rows: Pair, columns: Pair, radius: int, mean: Floats3
) -> None:
    """Eq. 15 in some rows and columns: the weighted sum of the first plane, the luminance, and
    those of the others divided by it.

    Beside the edges nothing is right, and nothing is used.
    """
    nothing = ZERO * load(colour, (0, 0, 0))
    for row in range(rows[0], rows[1]):
        for column in range(columns[0], columns[1], WIDTH):
            for plane in range(0, len(colour), _TOGETHER):
                a = b = c = d = nothing
                for y in range(row - radius, row + radius + 1):
                    for x in range(column - radius, column + radius + 1):
                        weight = _between(weights, row, column, y, x, radius)
                        a += weight * load(colour, (plane, y, x))
                        b += weight * load(colour, (plane + 1, y, x))
                        c += weight * load(colour, (plane + 2, y, x))
                        d += weight * load(colour, (plane + 3, y, x))
                for step, value in enumerate((a, b, c, d)):
                    store(mean, (plane + step, row, column), value)
            share = quotient(ONE, greater(load(mean, (0, row, column)), _SMALLEST_FLOAT))
            for plane in range(1, len(colour)):
                store(mean, (plane, row, column), load(mean, (plane, row, column)) * share)


@kernel
def _between(weights: Floats3, row: int, column: int, y: int, x: int, radius: int) -> Lanes:
    """The weights of the pixels at (y, x) for those at (row, column)."""
    offset = (y - row) * (2 * radius + 1) + x - column
    return load(weights, (offset, row, column)) if offset >= 0 else load(weights, (-offset, y, x))


@kernel
def _lit(mean: Floats3, rows: Pair, columns: Pair, colour: Floats3) -> None:
    """Multiply what Eq. 15 gave by the luminance, for the next repetition."""
    for plane in range(1, len(colour)):
        for row in range(rows[0], rows[1]):
            for column in range(columns[0], columns[1], WIDTH):
                luminance = load(colour, (0, row, column))
                store(colour, (plane, row, column), luminance * load(mean, (plane, row, column)))
