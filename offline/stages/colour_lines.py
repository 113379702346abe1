"""Colour as a function of luminance around each block: print, and every other place where two
surfaces meet.

Where ink lies on paper, a pixel is a mixture of both, and every channel is a linear function of
luminance: a colour line. That of many blocks is known far better than the chromaticity of one,
whose luminance is filled in and wrong under strokes, and it holds for strokes that meet no block.
It is wrong where one luminance has several colours. The paper has none of this.

Observation. In a block, channel i (of C, times gamma_i) has mean luminance x_i at its sites and
reads y_i; x is the mean of x_i.

    y_i = o_i + s_i x_i + error of variance v,   sum o = 0,   sum s = 1,
    v = 2 (a^2 + e^2) + u,   u = n + (PAPER x)^2,   e = (sum y_i - x) / C

a is the error of luminance under a block, STROKES times the range of the panchromatic samples
around it, over C; e is what the block itself tells of that error, whatever its colour (Eq. 7). n is
the variance of the noise in y_i. One paper differs by PAPER from place to place.

Line. <.> is the mean over blocks, weighted by w, 1 / v times a Gaussian of WIDTH. The prior is one
chromaticity k_i ~ <y_i> / <x_i>.

    s = (cov(x_i, y_i) + <u> k_i) / (var(x_i) + <u>),   d = s / sum s - k,
    s' = k + d max(1 - SHRINK^2 E / |d|^2, 0)

The slope by least squares is shrunk by what errors may cause (James and Stein); E is the variance
of d, from the residuals of the blocks (White), sum w^2 (x_i - <x_i>)^2 r^2 over the square of
sum w (x_i - <x_i>)^2. The line goes through <x>. Beyond the luminances of the sites of the blocks
around, it keeps the colour of its end.

Confidence. The estimated chromaticity z of a block lies t = z x - line(x) from the line, and its
samples r = y_i - line(x_i), both less their mean over channels. Strokes explain a chi-square of
about 1 per block, so that more than LIMIT speaks against the line. Neighbours were pooled:
estimates beside strokes are wrong too, and only the fraction f of t counts that samples confirm,
give or take ERRORS standard errors. What pooling leaves of the noise is expected where there is
print, p = <a^2> / (<a^2> + PRINT n).

    X = mean of min(|t|^2 / (2 a^2 + (EVEN x)^2 + p^2 n), WORST),   f = <t . r> / <t . t>
    confidence = 1 / (1 + (f X / LIMIT)^STEEPNESS)

Ink. A red word may stand between black ones, and one line for all would be black. So the line has a
rival, which turns about the bright end b of the nearest blocks (INK) by h, their own least squares
with a prior of deviation SLOPES: s' = s + h, o' = o - h b. By the logarithm of its likelihood ratio
per block, L, it counts as 1 - 1 / (1 + (L / GAIN)^STEEPNESS). In L each block is judged by the h of
the others: its own errors are an ink that explains them. y has Student's t distribution of FREEDOM
degrees about a line, with covariance s_i s_j R_ij (C a)^2 + u: luminance is wrong alike at near
sites (R of `site_errors.nearness`), and now and then by a whole stroke. Under black ink red samples
are as uncertain as luminance, under red ink they are bright in any case.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from ...shared.arrays import FloatArray, strips
from ...shared.site_errors import nearness
from ..bands import DARK, Band, RowStage
from ..frame import EVEN, ColourLines, Frame, Sites
from ..numerics.arrays import Floats1, Floats2, Floats3, Scalar
from ..numerics.compile import Chunks, kernel, parallel_kernel
from ..numerics.functions import unset
from ..numerics.gaussian import TRUNCATE, gaussian, smoothed
from ..stage import Switch


@dataclass(frozen=True)
class LinesSettings(Switch):
    """Colour as a linear function of luminance, where that explains the samples; not in the
    paper.
    """


# Chosen on photographs and on pages of print.
# blocks: standard deviation of the neighbourhood of a line; with 3, print has more tint
_WIDTH = 4.0
# error of luminance under a block, a fraction of the range of the samples around it; 0.07 and 0.14
# double the tint
_STROKES = 0.1
# standard errors that count as none: of a range, of a channel brighter than luminance, of what
# samples confirm
_ERRORS = 3.0
_SHRINK = 1.7  # standard errors by which slopes must differ from those of one chromaticity
_LIMIT = 0.8  # chi-square per block at which a line is half believed
_WORST = 3.0  # chi-square of a single block at most: outliers; with 4, white print is tinted
_STEEPNESS = 4  # power at which confidence falls; with 6, photographs lose
# mean a^2 in units of n at which the noise of estimates is half expected; with 160, white print is
# tinted
_PRINT = 80.0
# of the light; with 0.03, coloured print loses 4 dB, with 0.003, black print is tinted by a marker
# beside it
_PAPER = 0.01
_SLOPES = 0.15  # standard deviation of the slopes of inks on one paper
_FREEDOM = 3.0  # degrees of freedom of the errors
# log likelihood ratio per block at which an ink counts by half; half of it tints black print, twice
# of it takes the colour of single words
_GAIN = 0.08

# blocks: standard deviation of those that share an ink; with more, the lines of print beside it are
# mixed in
_INK = _WIDTH / 3
# blocks: standard deviation of the neighbourhood in which inks have to explain the samples, and
# distance of blocks whose luminances a line serves
_PAGE = 1.5 * _WIDTH
# of the mean panchromatic sample; of the sum of slopes, 1 without errors
_LEAST_LUMINANCE, _LEAST_SLOPES = 1e-3, 0.3
_CLIPPED = 1e-6  # weight of a block beside a clipped sample
_LEAST_DIVISOR = 1e-20  # keeps quotients finite
_STRIP = 512  # rows of blocks whose lines are computed together, for memory
# rows of blocks: of a line, an ink, its gain
_REACH = sum(int(TRUNCATE * width + 0.5) for width in (_WIDTH, _INK, _PAGE))


class _Blocks(NamedTuple):
    """Whole blocks of some rows, float32; C planes (C, rows, columns), others (rows, columns).

    filled, samples: x_i and y_i. estimate: z x. mean: x. strokes, short, noise: a^2, e^2 and n.
    weight: 1, or little beside a clipped sample. span: of `ColourLines`, (2, rows, columns).
    """

    filled: FloatArray
    samples: FloatArray
    estimate: FloatArray
    mean: FloatArray
    strokes: FloatArray
    short: FloatArray
    noise: FloatArray
    weight: FloatArray
    span: FloatArray

    @property
    def surface(self) -> FloatArray:
        """(EVEN x)^2."""
        return np.square(np.float32(EVEN) * self.mean)

    @property
    def own(self) -> FloatArray:
        """Return u."""
        return self.noise + np.square(np.float32(_PAPER) * self.mean)


def fit_colour_lines(
    frame: Frame, luminance: FloatArray, blocks: FloatArray, settings: Switch
) -> ColourLines | None:
    """Return the lines around all whole blocks, and their confidence; None where the settings do
    not use them, or a channel has no sites.

    Parameters
    ----------
    luminance : FloatArray
        (H, W), filled in and denoised, scene units.
    blocks : FloatArray
        Chromaticity of every block, (block rows, block columns, C).
    """
    if not settings.used or frame.pattern.derived is not None:
        return None
    sites = frame.sites
    gamma = frame.gamma.astype(np.float32)[:, None, None]
    dark = np.float32(_LEAST_LUMINANCE * frame.level)
    filled, samples = (_means(sites, plane) for plane in (luminance, frame.signal))
    samples *= gamma
    mean = np.maximum(filled.mean(axis=0), dark)
    strokes, short, noise = _errors(frame, filled, samples, mean)
    unclipped, estimated = frame.unclipped, np.moveaxis(sites.whole(blocks), 2, 0)
    weight = np.maximum(unclipped.astype(np.float32), np.float32(_CLIPPED))
    at_sites, size = sites.of(luminance), 2 * int(_PAGE) + 1
    ends = minimum_filter(at_sites.min(axis=2), size), maximum_filter(at_sites.max(axis=2), size)
    colour, span = estimated * gamma * mean, np.stack(ends)
    whole = _Blocks(filled, samples, colour, mean, strokes, short, noise, weight, span)
    result = ColourLines(*(np.empty_like(plane) for plane in (samples, samples, mean, span)))
    most = _precision(whole).max(initial=_LEAST_DIVISOR)
    means = sites.means(np.eye(len(sites.channels))[None])[0]
    alike = means.T @ nearness(sites.pattern) @ means
    alike = (alike / alike.max()).astype(np.float32)  # a is that of the fewest sites
    for rows in strips(len(mean), _STRIP):  # for memory
        top = max(rows.start - _REACH, 0)
        near = _Blocks(*(plane[..., top : rows.stop + _REACH, :] for plane in whole))
        lines = _fitted(near, dark, most)
        lines = _inked(replace(lines, share=_confidence(lines, near, dark)), near, alike)
        for name, plane in vars(result).items():
            plane[..., rows, :] = getattr(lines, name)[..., rows.start - top : rows.stop - top, :]
    result.share[~unclipped] = 0
    return result


def _means(sites: Sites, plane: FloatArray) -> FloatArray:
    """Return means of a plane over the sites of each channel, float32 (C, rows, columns)."""
    return np.ascontiguousarray(np.moveaxis(sites.means(sites.of(plane)), 2, 0), np.float32)


def _errors(
    frame: Frame, filled: FloatArray, samples: FloatArray, mean: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a^2, e^2 and n, float32 (rows, columns). filled, samples, mean: see `_Blocks`."""
    sites, noise, gamma, channels = frame.sites, frame.noise, frame.gamma, frame.sites.channels
    around = sites.surroundings(frame.signal)  # not `frame.around`, which would stay in memory
    span = (around.highest - around.lowest).astype(np.float32)
    variance = np.zeros_like(span)
    if noise is not None:
        span = np.maximum(span - np.float32(_ERRORS) * np.sqrt(noise.variance(mean)), 0)
        of_sites = (
            noise.variance(sites.of(frame.signal), channels)
            * (gamma / sites.pattern.site_counts)[channels] ** 2
        )
        variance = of_sites.sum(axis=2).astype(np.float32) / np.float32(len(gamma))
    # A stroke hides two sites of a channel, errors of more average out: 2.4 dB with the six of
    # Kaizu's tile.
    deviation = np.float32(_STROKES / max(sites.pattern.site_counts.min() / 2, 1)) * span
    # A channel that is brighter than luminance there shows by how much that is wrong, at least: a
    # star that meets no other pixel.
    beyond = (samples - filled).max(axis=0) - np.float32(_ERRORS) * np.sqrt(deviation**2 + variance)
    number = np.float32(len(gamma))
    strokes = (deviation / number) ** 2 + np.maximum(beyond, 0) ** 2
    short = np.abs(samples.sum(axis=0) - filled.mean(axis=0)) / number
    short = np.maximum(short - np.float32(_ERRORS) * np.sqrt(variance / number), 0)
    return strokes, short**2, variance


def _precision(near: _Blocks) -> FloatArray:
    """Return 1 / v, (rows, columns)."""
    return near.weight / (2 * (near.strokes + near.short) + near.own)


def _fitted(near: _Blocks, dark: np.float32, most: np.float32) -> ColourLines:
    """Return lines by weighted least squares, believed for now.

    dark: luminance without a colour. most: the largest precision of the frame, the unit of weights,
    whose squares are floats then.
    """
    count, weight = len(near.filled), _precision(near) / most
    total, noise = smoothed(np.stack([weight, weight * near.own]), _WIDTH)
    noise /= total
    levels, means = (
        np.stack([smoothed(weight * plane, _WIDTH) / total for plane in planes])
        for planes in near[:2]
    )
    # The sites of a channel have their own luminance: on a ramp of one colour only the ratios are
    # the same.
    ratios, level = means / np.maximum(levels, dark), levels.mean(axis=0)
    sums = ratios.sum(axis=0)
    mixture = ratios / np.maximum(sums, np.float32(_LEAST_SLOPES))
    mixture = np.where(sums > _LEAST_SLOPES, mixture, np.float32(1 / count))
    slope, error = np.empty_like(means), np.zeros_like(total)
    for channel, (x, y, level_x, level_y, single) in enumerate(
        zip(*near[:2], levels, means, mixture, strict=True)
    ):
        square, product = (smoothed(weight * x * plane, _WIDTH) / total for plane in (x, y))
        spread, together = np.maximum(square - level_x**2, 0) + noise, product - level_x * level_y
        slope[channel] = (together + noise * single) / spread
        # Squared, a Gaussian is 1 / (4 pi width^2) times one of less width.
        rest = weight**2 * ((y - level_y - slope[channel] * (x - level_x)) ** 2 + near.surface)
        zeroth, first, second = (smoothed(rest * x**power, _WIDTH / 2**0.5) for power in range(3))
        rest = np.maximum(second - level_x * (2 * first - level_x * zeroth), 0)
        error += rest / (np.float32(4 * np.pi * _WIDTH**2) * (spread * total) ** 2)
    sums = np.maximum(slope.sum(axis=0), np.float32(_LEAST_SLOPES))
    odd = slope / sums - mixture
    odd -= odd.mean(axis=0)
    error /= sums**2
    power = np.maximum((odd**2).sum(axis=0), np.float32(_LEAST_DIVISOR))
    odd *= np.maximum(1 - np.float32(_SHRINK**2) * error / power, 0)
    return ColourLines(-odd * level, mixture + odd, np.ones_like(total), near.span)


def _confidence(lines: ColourLines, near: _Blocks, dark: np.float32) -> FloatArray:
    """Return the confidence in lines, 0 to 1, (rows, columns)."""
    rest, apart = _residuals(lines, near), near.estimate - lines.at(near.mean)
    apart -= apart.mean(axis=0)
    power = np.einsum("iyx,iyx->yx", apart, apart)
    printed = smoothed(near.strokes, _WIDTH)
    # Pooling leaves a rest of noise in estimates. In print that is no evidence; in shadows without
    # strokes it may be colour.
    printed /= printed + np.float32(_PRINT) * near.noise + np.float32(_LEAST_DIVISOR)
    expected = 2 * near.strokes + near.surface + near.noise * printed**2
    # black blocks, exact as they seem, would decide alone
    sure = near.weight / (expected + near.noise + dark**2)
    chi = near.weight * np.minimum(power / expected, np.float32(_WORST))
    planes = chi, sure * power, sure * np.einsum("iyx,iyx->yx", apart, rest), near.weight
    chi, power, common, total = smoothed(np.stack(planes), _WIDTH)
    # The sum of squared weights: a Gaussian squared has the sum 1 / (4 pi width^2).
    unsure = np.float32(_ERRORS / (2 * np.pi**0.5 * _WIDTH)) * np.sqrt(power * total)
    confirmed = np.clip((common + unsure) / (power + np.float32(_LEAST_DIVISOR)), 0, 1)
    return _believed(confirmed * chi / total, _LIMIT)


def _inked(lines: ColourLines, near: _Blocks, alike: FloatArray) -> ColourLines:
    """Return lines with the ink of the nearest blocks, as far as it explains the samples better
    than they do.

    alike: R, (C, C).
    """
    rest = _residuals(lines, near)
    weight = near.weight / (2 * near.strokes + near.surface + near.noise)
    middle, square = (smoothed(weight * near.mean**power, _INK) for power in (1, 2))
    bright = square / (middle + np.float32(_LEAST_DIVISOR))
    darker = near.mean - bright
    sure = weight / (1 + weight * (np.float32(_SLOPES) * darker) ** 2)
    prior = np.float32(1 / (4 * np.pi * (_INK * _SLOPES) ** 2))
    product, square = sure * darker * rest, sure * darker**2
    products, squares = smoothed(product, _INK), smoothed(square, _INK) + prior
    itself = np.float32(gaussian(_INK).max() ** 2)
    turn = (products - itself * product) / (squares - itself * square)
    rival = replace(lines, offset=lines.offset - turn * bright, slope=lines.slope + turn)
    gain = _likelihood(rival, near, alike) - _likelihood(lines, near, alike)
    gain = np.minimum(smoothed(gain, _PAGE), smoothed(gain, _INK))
    turn = products / squares * (1 - _believed(gain, _GAIN))
    return replace(lines, offset=lines.offset - turn * bright, slope=lines.slope + turn)


def _likelihood(lines: ColourLines, near: _Blocks, alike: FloatArray) -> FloatArray:
    """Return the logarithm of the likelihood of the samples of blocks, (rows, columns), but for a
    constant.
    """
    count = len(alike)
    of_filled = lines.slope * np.sqrt(near.strokes) * np.float32(count)
    covariance = np.einsum("iyx,jyx,ij->ijyx", of_filled, of_filled, alike).astype(np.float64)
    covariance[range(count), range(count)] += (near.noise + near.surface) / near.weight
    rest = (near.samples - lines.at(near.filled)).astype(np.float64)
    size, squares = np.zeros((2, *near.mean.shape))
    for first in range(count):  # Gaussian elimination of all blocks together
        pivot, left = covariance[first, first], slice(first + 1, None)
        size += np.log(pivot) / 2
        squares += rest[first] ** 2 / pivot
        factor = covariance[left, first] / pivot
        rest[left] -= factor * rest[first]
        covariance[left, left] -= factor[:, None] * covariance[first, left]
    return -(size + (_FREEDOM + count) / 2 * np.log1p(squares / _FREEDOM)).astype(np.float32)


def _residuals(lines: ColourLines, near: _Blocks) -> FloatArray:
    """Return r, (C, rows, columns)."""
    rest = near.samples - lines.at(near.filled)
    rest -= rest.mean(axis=0)
    return rest


def _believed(value: FloatArray, limit: float) -> FloatArray:
    """Return 1 where there is no deviation, one half at the limit."""
    return 1 / (1 + np.maximum(value / np.float32(limit), 0) ** _STEEPNESS)


@dataclass(eq=False)
class LineProjection(RowStage):
    """Lead chromaticity to the lines, as far as they are believed.

    Attributes
    ----------
    sites, lines : Sites, ColourLines
        Of the frame.
    gamma : FloatArray
        (C,), of Eq. 7.
    """

    sites: Sites
    lines: ColourLines
    gamma: FloatArray

    name = "lines"

    @cached_property
    def _planes(self) -> FloatArray:
        lines, share = self.lines, self.lines.share
        return np.concatenate(
            [share[None], share * lines.offset, share * lines.slope, share * lines.span]
        )

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows."""
        picture, (down, across) = band.rows(*rows), self.sites.middle
        lines = LinePlanes(self._planes, (down - picture.first, across), self.sites.grid.period)
        result = np.empty(picture.chromaticity.shape, np.float32)
        lead_to_lines(
            picture.luminance, np.ascontiguousarray(picture.chromaticity), lines, self.gamma, result
        )
        return replace(picture, chromaticity=result)


class LinePlanes(NamedTuple):
    """Lines on the grid of blocks.

    Attributes
    ----------
    values : Floats3
        Confidence of each line, then that times its offsets, its slopes and its span, (3 + 2 C,
        block rows, block columns).
    first : tuple[float, float]
        Row and column of the first block in a band of the picture, pixels; it may lie outside.
    period : int
        Pixels between blocks.
    """

    values: Floats3
    first: tuple[float, float]
    period: int


_LEAST_SHARE = np.float32(1e-3)  # confidence below which a pixel stays as it is; chosen, for speed
_DARK, _SQUARE = np.float32(DARK), np.float32(EVEN**2)
ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)


@parallel_kernel()
def lead_to_lines(
    chunks: Chunks, level: Floats2, colour: Floats3, lines: LinePlanes, gamma: Floats1, out: Floats3
) -> None:
    """Take chromaticities to those of lines that are interpolated between blocks.

    Parameters
    ----------
    level, colour : Floats2, Floats3
        Luminance (rows, W) and chromaticity (rows, W, C) of a band of the picture.
    gamma : Floats1
        (C,).
    out : Floats3
        (rows, W, C), written.
    """
    (planes, down, across), width, count = lines.values.shape, level.shape[1], len(gamma)
    row_of_lines, target = unset(planes, across), unset(count)
    at = np.clip((np.arange(width) - lines.first[1]) / lines.period, 0.0, across - 1.0)
    before = np.minimum(at.astype(np.intp), max(across - 2, 0))
    for row in range(chunks[0], chunks[1]):
        place = min(max((row - lines.first[0]) / lines.period, 0.0), down - 1.0)
        above = min(int(place), max(down - 2, 0))
        below, near = min(above + 1, down - 1), np.float32(place - above)
        for plane in range(planes):
            for column in range(across):
                start = lines.values[plane, above, column]
                row_of_lines[plane, column] = start + near * (
                    lines.values[plane, below, column] - start
                )
        for column in range(width):
            left = before[column]
            right, near = min(left + 1, across - 1), np.float32(at[column] - left)
            share, bright = _between(row_of_lines[0], left, right, near), level[row, column]
            total = ZERO
            if share > _LEAST_SHARE and bright > _DARK:
                # its ends have been seen, what lies beyond them has not
                bright = max(bright, _between(row_of_lines[planes - 2], left, right, near) / share)
                bright = min(bright, _between(row_of_lines[planes - 1], left, right, near) / share)
                for channel in range(count):
                    value = _between(row_of_lines[1 + channel], left, right, near)
                    slope = _between(row_of_lines[1 + count + channel], left, right, near)
                    value += bright * slope
                    # A line has positive colours: beyond the darkest one it is that of the channels
                    # that are left.
                    target[channel] = max(value, ZERO)
                    total += target[channel]
            on_line, apart = total > ZERO and total > HALF * share * bright, ZERO
            if on_line:
                for channel in range(count):
                    target[channel] = (
                        target[channel] / (gamma[channel] * total) - colour[row, column, channel]
                    )
                    apart += (gamma[channel] * target[channel]) ** 2
                # less than an even surface has is not taken off
                share *= ONE - _SQUARE / max(apart, _SQUARE)
            for channel in range(count):
                out[row, column, channel] = colour[row, column, channel] + (
                    share * target[channel] if on_line else ZERO
                )


@kernel
def _between(line: Floats1, left: int, right: int, near: Scalar) -> Scalar:
    """Return the value between two places of a line."""
    return line[left] + near * (line[right] - line[left])
