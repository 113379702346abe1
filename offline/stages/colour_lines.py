"""Colour as a function of luminance, around each block: print, and every other place where two surfaces meet.

Where an ink lies on paper, every pixel is a mixture of both, and each channel is a linear function of luminance: a colour line.
Black print has one chromaticity at any luminance; a red word runs from paper to ink. The line of many blocks is known far better
than the chromaticity of any one of them, whose luminance is filled in and wrong where strokes pass. And it tells the colour of
strokes that meet no block. It is wrong where there are several colours of one luminance. Errors of single blocks have any sign, so
what blocks close by agree on is no error: it leads the line.

A red word may stand between black ones, and one line for all of them would be black. So a line has a rival, which turns about its
bright end to the ink of the nearest blocks. The rival gains where it makes their samples likelier. Under black ink a red sample is
as uncertain as luminance under a stroke, but under red ink it is bright whatever the stroke does: that the samples of one channel
never are dark is the surest sign of its ink.

So the line is the null hypothesis, and a chi-square decides how far the picture is taken from it: how far the estimated blocks are
from the line, in units of the errors that strokes under them cause. These are estimated from the range of the panchromatic samples
around each block. Beside strokes estimates are wrong too, because neighbours were pooled: white letters on red are reddish. So only
the share of their distance counts that the samples themselves confirm. The paper has none of this. All is in units of luminance:
channel i counts gamma_i times.

Colour of every pixel by the colour lines around it, as far as these explain the blocks (`stages.colour_lines`).

Chromaticity taken to the colour lines around each pixel.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from shared.arrays import BoolArray, FloatArray, strips
from shared.site_errors import nearness

from ..blocks import Sites
from ..cleaned import Cleaned, unclipped_blocks
from ..measured import EVEN, ColourLines
from ..numerics.arrays import Floats1, Floats2, Floats3
from ..numerics.compile import Pieces, parallel_kernel
from ..numerics.functions import unset
from ..numerics.gaussian import TRUNCATE, smoothed
from ..parts import DARK, Part, RowStage
from ..stage import Switch


@dataclass(frozen=True)
class LineSettings(Switch):
    """Colour as a linear function of luminance, where that explains the samples (see `stages.colour_lines`); not in the paper."""

    kernels = "surroundings", "smooth"


# Chosen; in brackets, by how many decibels half or twice changes the case that it changes most (README).
_WIDTH = 4.0  # blocks: standard deviation of the neighbourhood of a line; black print has half of its tint with 3
_CLOSE = 2.0  # blocks: that of the blocks whose colour leads a line; with 3, or if led by less, bright places fade in noise
_BRIGHT = 2.5  # times the light around, at which a line is half believed; with 5, a photograph with a lamp loses 3 dB
_INK = 1.3  # blocks: that of the blocks which share an ink; with 1.8, the lines of print beside it are mixed in
_INKS = 0.1  # by which slopes of inks on one paper differ, and of one ink from place to place; with 0.15, black print gains more
_ROUNDS = 2  # in which blocks are weighted by their distance from the ink of the round before
_FREEDOM = 3.0  # of Student's distribution, which knows outliers; with 8, black print gains as much as red print between black
_GAIN = 0.3  # of log likelihood per block, with which an ink counts by half: black print has up to 0.27, words in red or blue 0.4
_SURE = 12  # its power: lets black print go, and keeps red print
_STROKES = 0.1  # error of luminance under a block, as a share of the range of the samples around it (1.6)
_NEIGHBOURS = 2  # sites of a channel that one stroke hides; errors of more sites average out
_LINEAR = 0.1  # share of the light by which colours may depart from a line where it is fitted (0.1)
_CONTRAST = 0.007  # of luminance, a share of it: a line with less is one of a single chromaticity (0.0)
_DEVIATIONS = 3.0  # standard errors by which slopes must differ from those of a single chromaticity (0.4)
_ESTIMATED, _STEEPNESS = 0.8, 6  # chi-square of estimated blocks that counts by half, and its power (1.4, 0.6)
_UNTOLD = 0.2  # more of it where samples tell nothing, but noise; without, a photograph loses 0.25 dB at sigma 0.01
_UNSURE = 3.0  # standard errors by which samples may confirm more of it; with 2, a photograph loses 0.3 dB
_CONFIRMED = 3  # power of the share that they confirm; with 2, white print on red has 1.5 dB more error
_LEFT = 0.2  # share of the noise that estimated blocks still have; with 0.1, white print on black has a fifth more tint
_PRINT = 20.0  # mean square of stroke errors around, in variances of noise, that is half print; with 5, a photograph loses 0.3 dB
_WORST = 3.0  # at which the chi-square of a block is cut off: with 5, black print has twice the tint
_BEYOND = 3.0  # standard deviations by which a channel may be brighter than luminance; a photograph of stars gains 0.6 dB
_RANGE = 3.3  # standard deviations of the noise in the range of a dozen samples: 3.26 are expected (0.2)
_DARK, _FAINT = 1e-3, 0.01  # share of the mean panchromatic sample: least luminance, and error of a line (0.0)
FILLED = 0.5
_TINY = 1e-20  # keeps quotients finite
_STRIP = 512  # rows of blocks whose lines are computed together, for memory
# Rows above and below that decide: those of a line, of what leads it, of the rounds for its ink, and of the ink's gain.
_REACH = sum(int(TRUNCATE * width + 0.5) for width in (_WIDTH, _CLOSE, *[_INK] * _ROUNDS, _WIDTH))
_UNKNOWN = 1e-6  # weight of a block beside a clipped sample (0.0)
_LEAST_SLOPE = 0.3  # of the sum of a line's slopes, which is 1 without errors of luminance (0.0)


def colour_lines(frame: Cleaned, luminance: FloatArray, blocks: FloatArray, settings: Switch) -> ColourLines | None:
    """The lines around all whole blocks, and how far each is believed; None where nobody asks.

    luminance: (H, W), filled in and denoised, scene units. blocks: chromaticity of every block, (block rows, block columns, C).
    """
    if not settings.used:
        return None
    sites, gamma = frame.sites, frame.gamma.astype(np.float32)[:, None, None]
    light, seen = (_means(sites, plane) for plane in (luminance, frame.signal))
    seen *= gamma
    mean = np.maximum(light.mean(axis=0), np.float32(_DARK * frame.level))
    strokes, noise = _errors(frame, light, seen, mean)
    unclipped, estimated = unclipped_blocks(frame), np.moveaxis(sites.whole(blocks), 2, 0)
    found = ColourLines(np.empty_like(seen), np.empty_like(seen), np.empty_like(mean))
    for rows in strips(len(mean), _STRIP):  # for memory
        top = max(rows.start - _REACH, 0)
        around, kept = slice(top, rows.stop + _REACH), slice(rows.start - top, rows.stop - top)
        shown = light[:, around], seen[:, around], estimated[:, around] * gamma * mean[around], mean[around]
        lines = _around(frame, shown, strokes[around], noise[around], unclipped[around])
        found.offset[:, rows], found.slope[:, rows], found.share[rows] = (
            each[..., kept, :] for each in (lines.offset, lines.slope, lines.share)
        )
    return found


def _around(
    frame: Cleaned, shown: tuple[FloatArray, ...], strokes: FloatArray, noise: FloatArray, unclipped: BoolArray
) -> ColourLines:
    """The lines around some rows of blocks.

    shown: luminance at the sites, share of each channel in it, as samples show it and as it was estimated, (C, rows, columns);
    mean of luminance, (rows, columns). strokes, noise: as of `_errors`.
    unclipped: blocks whose samples tell the light, (rows, columns).
    """
    (light, seen, expected, mean), dark = shown, _DARK * frame.level
    even: FloatArray = strokes + (np.float32(EVEN) * mean) ** 2
    known = np.maximum(unclipped.astype(np.float32), np.float32(_UNKNOWN))
    departure = np.square(np.float32(_LINEAR / len(seen)) * mean) + np.float32((_FAINT * frame.level) ** 2)
    lines = _fitted(light, seen, known / (even + noise), known / (strokes + noise + departure), noise, dark)
    variance = even + strokes  # of luminance, and of the sample
    weight = known / (variance + noise)
    lines = _led(lines, light, seen, mean, weight)
    rest, apart = _rest(lines, light, seen), expected - lines.at(mean)
    # A line follows the noise of the blocks that lead it, and leaves less of it in their samples.
    followed = noise * np.float32((len(seen) - 1) / (4 * np.pi * _CLOSE**2))
    power, common = _apart(apart), np.einsum("iyx,iyx->yx", apart, rest) + followed
    dim = _believed(_shining(rest, mean, weight), _BRIGHT)
    del rest, apart  # for memory
    # Of estimated blocks pooling has taken the noise off, but for a rest. That does not speak against a line where there is print;
    # in shadows without strokes it may as well be colour.
    printed = smoothed(strokes, _WIDTH)
    printed /= printed + np.float32(_PRINT) * noise + np.float32(_TINY)
    sure = known / (variance + noise + np.float32(dark**2))  # black blocks, exact as they seem, would decide alone
    chi = np.minimum(power / (variance + np.float32(_LEFT) * noise * printed**2), np.float32(_WORST))
    informed = known * (variance / (variance + (len(seen) - 1) * noise)) ** 2
    chi, power, common, told, total = smoothed(np.stack([known * chi, sure * power, sure * common, informed, known]), _WIDTH)
    # Regression of samples on estimates: how much of the distance from the line is confirmed, at most. In print it is little.
    unsure = np.float32(_UNSURE / (2 * np.pi**0.5 * _WIDTH)) * np.sqrt(power * total)
    confirmed = np.clip((common + unsure) / (power + np.float32(_TINY)), 0, 1)
    limit = _ESTIMATED * (1 + np.float32(_UNTOLD) * (1 - (told / total) ** 2))
    share = _believed(chi / total * confirmed**_CONFIRMED, limit) * dim
    # The fewer the blocks, the better a line suits them: how far it is believed is asked before.
    uncertain = strokes * np.float32(len(seen) ** 2), (noise + departure) / known
    lines = _inked(lines, light, seen, weight, uncertain, _independent(frame.sites))
    return replace(lines, share=share * unclipped)


def _means(sites: Sites, plane: FloatArray) -> FloatArray:
    """Means of a plane over the sites of each channel, float32 (C, rows, columns)."""
    return np.ascontiguousarray(np.moveaxis(sites.means(sites.of(plane)), 2, 0), np.float32)


def _errors(frame: Cleaned, light: FloatArray, seen: FloatArray, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances of what a block shows of a channel, float32 (rows, columns): what strokes under it cause, and noise.

    light, seen: as in `_fitted`. mean: luminance, (rows, columns).
    """
    sites, noise, gamma, channels = frame.sites, frame.noise, frame.gamma, frame.sites.channels
    around = sites.surroundings(frame.signal)  # not `frame.around`, which would stay in memory
    span = (around.highest - around.lowest).astype(np.float32)
    del around
    variance = np.zeros_like(span)
    if noise is not None:
        span = np.maximum(span - np.float32(_RANGE) * np.sqrt(noise.variance(mean)), 0)
        each = noise.variance(sites.of(frame.signal), channels) * gamma[channels] ** 2
        variance = (each / np.bincount(channels)[channels] ** 2).sum(axis=2).astype(np.float32) / np.float32(len(gamma))
    # With six sites of each channel, as in Kaizu's tile, 2.4 dB are lost without noise if their errors count as those of two.
    share = _STROKES / max(np.bincount(channels).min() / _NEIGHBOURS, 1)
    strokes = (np.float32(share) * span) ** 2  # of luminance
    # A channel that is brighter than all light there shows by how much that is wrong, at least: a star that meets no other pixel.
    beyond = np.maximum((seen - light).max(axis=0) - np.float32(_BEYOND) * np.sqrt(strokes + variance), 0)
    return strokes / np.float32(len(gamma) ** 2) + beyond**2, variance


def _fitted(
    light: FloatArray, seen: FloatArray, exact: FloatArray, weight: FloatArray, noise: FloatArray, dark: float
) -> ColourLines:
    """Lines by weighted least squares, through the mean of the blocks that no stroke touches.

    light, seen: luminance and share of each channel in it, (C, rows, columns).
    exact, weight: precision of the blocks for that mean, and for the slopes, (rows, columns). noise: variance of `seen`.
    dark: light without a colour.
    """
    total = smoothed(exact, _WIDTH)
    levels, means = (np.stack([smoothed(exact * plane, _WIDTH) / total for plane in planes]) for planes in (light, seen))
    # The sites of a channel have their own luminance: on a ramp of one colour only the ratios are the same.
    lit = levels > dark
    ratios = np.where(lit, means / np.where(lit, levels, 1), np.float32(1 / len(seen)))
    level, whole = levels.mean(axis=0), ratios.sum(axis=0)
    lit = whole > np.float32(_LEAST_SLOPE)
    mixture = np.where(lit, ratios / np.where(lit, whole, 1), np.float32(1 / len(seen)))
    total, noisy = smoothed(np.stack([weight, weight * noise]), _WIDTH)
    least = (np.float32(_CONTRAST) * np.maximum(level, np.float32(dark))) ** 2 + noisy / total
    slope, error = np.empty_like(means), np.zeros_like(total)
    for channel, (x, y, middle, mean, single) in enumerate(zip(light, seen, levels, means, mixture, strict=True)):
        planes = (weight * plane for plane in (x, y, x**2, x * y, y**2))  # one at a time, for memory
        one, two, square, product, power = (smoothed(plane, _WIDTH) / total for plane in planes)
        spread = np.maximum(square - 2 * one * middle + middle**2, 0) + least
        together = product - two * middle - one * mean + middle * mean
        slope[channel] = (together + least * single) / spread
        rest = np.maximum(power - 2 * two * mean + mean**2 - slope[channel] * together, 0)
        error += (rest + (np.float32(EVEN) * level) ** 2) / spread
    # How many blocks a line rests on: the square of the weights' sum over the sum of their squares.
    narrow = smoothed(weight**2, _WIDTH / 2**0.5)
    number = (4 * np.pi * _WIDTH**2) * total**2 / narrow
    whole = np.maximum(slope.sum(axis=0), np.float32(_LEAST_SLOPE))
    odd = slope / whole - mixture
    odd -= odd.mean(axis=0)
    error /= number * whole**2
    # James and Stein: what errors may cause is taken off the differences of slopes.
    odd *= np.maximum(1 - np.float32(_DEVIATIONS**2) * error / np.maximum((odd**2).sum(axis=0), np.float32(_TINY)), 0)
    return ColourLines(-odd * level, mixture + odd, np.ones_like(total))


def _led(lines: ColourLines, light: FloatArray, seen: FloatArray, mean: FloatArray, weight: FloatArray) -> ColourLines:
    """Lines with the chromaticity that the blocks close by agree on, beyond the error of its mean: it is no error of single blocks.

    light, seen: as in `_fitted`. mean: luminance, (rows, columns). weight: inverse of the variance of `seen`, (rows, columns).
    """
    rest = _rest(lines, light, seen)
    power = smoothed(weight * mean**2, _CLOSE) + np.float32(_TINY)
    tint = smoothed(weight * mean * rest, _CLOSE) / power
    # The sum of squared weights, where a Gaussian squared is a narrower Gaussian.
    error = smoothed(weight * mean**2, _CLOSE / 2**0.5) / power * np.float32((len(seen) - 1) / (4 * np.pi * _CLOSE**2)) / power
    tint *= np.maximum(1 - error / np.maximum((tint**2).sum(axis=0), np.float32(_TINY)), 0)  # James and Stein
    return replace(lines, slope=lines.slope + tint)


def _rest(lines: ColourLines, light: FloatArray, seen: FloatArray) -> FloatArray:
    """What is seen of the channels beside their lines, but for luminance; light, seen: as in `_fitted`."""
    rest = seen - lines.at(light)
    rest -= rest.mean(axis=0)
    return rest


def _shining(rest: FloatArray, mean: FloatArray, weight: FloatArray) -> FloatArray:
    """How many times as bright as those around a block is that is not on its line, (rows, columns); 0 on it.

    The line of a lamp was told by darker places. If the lamp is small, few blocks among many see that it has another colour.
    rest: see `_rest`. mean, weight: as in `_led`.
    """
    power = _apart(rest)
    return mean / smoothed(mean, _WIDTH) * (power / (power + (len(rest) - 1) * np.reciprocal(weight) + np.float32(_TINY)))


def _inked(
    lines: ColourLines,
    light: FloatArray,
    seen: FloatArray,
    weight: FloatArray,
    uncertain: tuple[FloatArray, FloatArray],
    independent: FloatArray,
) -> ColourLines:
    """Lines with the ink of the nearest blocks, as far as it explains their samples, and those around, better.

    light, seen, weight: as in `_led`. uncertain, independent: as in `_likelihood`.
    """
    mean, rest = light.mean(axis=0), _rest(lines, light, seen)
    middle, square = (smoothed(weight * mean**power, _INK) for power in (1, 2))
    bright = square / (middle + np.float32(_TINY))
    darker, tint = mean - bright, np.zeros_like(rest)
    prior = np.float32(1 / (4 * np.pi * (_INK * _INKS) ** 2))
    for _ in range(_ROUNDS):
        sure = weight / (1 + weight * (_apart(rest - tint * darker) / np.float32(_FREEDOM) + (np.float32(_INKS) * darker) ** 2))
        tint = smoothed(sure * darker * rest, _INK) / (smoothed(sure * darker**2, _INK) + prior)
    own = replace(lines, offset=lines.offset - tint * bright, slope=lines.slope + tint)
    gain = _likelihood(own, light, seen, uncertain, independent) - _likelihood(lines, light, seen, uncertain, independent)
    tint *= 1 - _believed(np.minimum(smoothed(gain, _WIDTH), smoothed(gain, _INK)), _GAIN, _SURE)
    return replace(lines, offset=lines.offset - tint * bright, slope=lines.slope + tint)


def _likelihood(
    lines: ColourLines, light: FloatArray, seen: FloatArray, uncertain: tuple[FloatArray, FloatArray], independent: FloatArray
) -> FloatArray:
    """Logarithm of the likelihood of what the blocks show, (rows, columns), but for a constant: Student's distribution.

    light, seen: as in `_fitted`. independent: see `_independent`.
    uncertain: variances of the errors of luminance, and of what is seen of a channel, (rows, columns).
    """
    variance = lines.slope**2 * uncertain[0] + uncertain[1]
    rest = (seen - lines.at(light)) / np.sqrt(variance)
    chi = np.einsum("iyx,ij,jyx->yx", rest, independent, rest) / np.float32(_FREEDOM)
    return -np.log(variance).sum(axis=0) / 2 - np.float32((_FREEDOM + len(seen)) / 2) * np.log1p(chi)


def _independent(sites: Sites) -> FloatArray:
    """Inverse of the correlation of errors of luminance at the sites of two channels, float32 (C, C)."""
    members = (np.arange(sites.channels.max() + 1)[:, None] == sites.channels).astype(np.float64)
    shared = members @ nearness(sites.pattern, FILLED) @ members.T
    each = np.sqrt(np.diag(shared))
    return np.linalg.inv(shared / (each[:, None] * each)).astype(np.float32)


def _apart(colours: FloatArray) -> FloatArray:
    """Squared distance from grey, without the luminance of (C, rows, columns)."""
    return np.square(colours - colours.mean(axis=0)).sum(axis=0)


def _believed(chi: FloatArray, limit: FloatArray | float, power: int = _STEEPNESS) -> FloatArray:
    """1 where there is no deviation, one half at the limit."""
    return 1 / (1 + np.maximum(chi / limit, 0) ** power)


@dataclass(eq=False)
class OnLines(RowStage):
    """Lead chromaticity to the lines, as far as they are believed. sites, lines: of the frame. gamma: (C,), of Eq. 7."""

    sites: Sites
    lines: ColourLines
    gamma: FloatArray

    name = "lines"
    kernels = ("lead_to_lines",)

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * channels * pixels

    @cached_property
    def _planes(self) -> FloatArray:
        share, offset, slope = self.lines.share, self.lines.offset, self.lines.slope
        return np.concatenate([share[None], share * offset, share * slope])

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows."""
        shown, (down, across) = part.rows(*rows), self.sites.middle
        found, period = np.empty(shown.chromaticity.shape, np.float32), self.sites.grid.period
        place, before = (down - shown.first, across), np.ascontiguousarray(shown.chromaticity)
        lead_to_lines(shown.luminance, before, self._planes, place, period, self.gamma, DARK, EVEN, found)
        return replace(shown, chromaticity=found)


_LEAST_SHARE = np.float32(1e-3)  # of a line, below which a pixel stays as it is; chosen, for speed
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)


@parallel_kernel()
def lead_to_lines(
    pieces: Pieces,
    light: Floats2,
    colour: Floats3,
    lines: Floats3,
    first: tuple[float, float],
    period: int,
    gamma: Floats1,
    dark: float,
    even: float,
    out: Floats3,
) -> None:
    """Take chromaticities to those of lines that are interpolated between blocks.

    light, colour: luminance (rows, W) and chromaticity (rows, W, C) of a part of the picture.
    lines: (1 + 2 C, block rows, block columns): the share of each line, then its share times offsets and times slopes.
    first: where the first block lies in the part, in pixels, which may be outside.
    period: pixels between blocks. gamma: (C,). dark: luminance up to which a pixel stays as it is.
    even: distance of a colour from its line, a share of the light, up to which it stays too.
    out: (rows, W, C), written.
    """
    (parts, down, across), width, count = lines.shape, light.shape[1], len(gamma)
    line, found, least = unset(parts, across), unset(count), np.float32(even**2)
    for row in range(pieces[0], pieces[1]):
        place = min(max((row - first[0]) / period, 0.0), down - 1.0)
        above = min(int(place), max(down - 2, 0))
        below, near = min(above + 1, down - 1), np.float32(place - above)
        for part in range(parts):
            for column in range(across):
                line[part, column] = lines[part, above, column] + near * (lines[part, below, column] - lines[part, above, column])
        for column in range(width):
            at = min(max((column - first[1]) / period, 0.0), across - 1.0)
            left = min(int(at), max(across - 2, 0))
            right, near = min(left + 1, across - 1), np.float32(at - left)
            share = line[0, left] + near * (line[0, right] - line[0, left])
            total, bright = _ZERO, light[row, column]
            if share > _LEAST_SHARE and bright > dark:
                for channel in range(count):
                    offset, slope = line[1 + channel], line[1 + count + channel]
                    value = offset[left] + near * (offset[right] - offset[left])
                    value += bright * (slope[left] + near * (slope[right] - slope[left]))
                    # A line has positive colours: beyond the darkest one it is that of the channels that are left.
                    found[channel] = max(value, _ZERO)
                    total += found[channel]
            known, apart = total > _ZERO and total > _HALF * share * bright, _ZERO
            if known:
                for channel in range(count):
                    found[channel] = found[channel] / (gamma[channel] * total) - colour[row, column, channel]
                    apart += (gamma[channel] * found[channel]) ** 2
                share *= _ONE - least / max(apart, least)
            for channel in range(count):
                out[row, column, channel] = colour[row, column, channel] + (share * found[channel] if known else _ZERO)
