"""Chromaticity from the pooled statistics of many similar blocks, where a single block is too noisy.

The sums of Eqs. 8-9, A_i and sum l m, hold everything that a block knows about its chromaticity, each sample weighted by its
precision. So the sums are added up, not the chromaticities: a dark block adds little to its neighbours and gains much from them,
and so does a block on an edge, whose luminance is filled in and uncertain.

Eqs. 8-9 pull a block's chromaticity towards grey. Pooled sums are surer, and need less of that; and what a camera takes for grey is
seldom the colour of a dark place. So they are pulled towards the chromaticity of all blocks around.

Weighted averages of the statistics of blocks over similar blocks nearby: all offsets of a window, sixteen blocks in lanes.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.progress import SILENT, Progress

from ..blocks import BlockSums, curvature
from ..cleaned import Cleaned
from ..numerics.arrays import Floats1, Floats2, Floats3, Scalar, Single
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import exponential, zeros
from ..numerics.gaussian import smoothed
from ..numerics.lanes import WIDTH, Lanes, load, quotient, store
from ..numerics.pieces import BLOCK_ROWS, in_strips
from ..stage import NotNegative, Positive, Range, StageSettings

WIDEST_WINDOW = 64  # blocks: radius of pooling accepted at most, for time and memory


class PoolingPass(NamedTuple):
    """One pass of pooling.

    blur: standard deviation of the Gaussian that smooths the chromaticities compared, blocks, 0 or more.
    tolerance: squared difference that chromaticities may have, as a multiple of the variance that noise has left in them, > 0.
    radius: radius of the window, blocks.
    """

    blur: float
    tolerance: float
    radius: int


_PASSES = Range(
    lambda passes: all(len(each) == 3 and each[0] >= 0 and each[1] > 0 and 1 <= each[2] <= WIDEST_WINDOW for each in passes),
    f"for each pass a blur, 0 or more, a tolerance, more than 0, and a radius, 1 to {WIDEST_WINDOW}",
)


@dataclass(frozen=True)
class PoolingSettings(StageSettings):
    """Averaging of the sums of Eqs. 8-9 over blocks of similar chromaticity; the paper has none.

    passes: one `PoolingPass` each; empty = no pooling.
    light: how much the luminance of blocks may differ: standard deviation of the Gaussian weight of its logarithm, less in the
        dark, > 0.
    curvature_error: error of filled luminance, as a multiple of its curvature there, 0 or more.
    """

    kernels = "pool", "smooth"
    asked_by = ("passes",)
    passes: Annotated[tuple[PoolingPass, ...], _PASSES] = ()
    light: Positive = 0.25
    curvature_error: NotNegative = 0.2


# These keep quotients and logarithms finite in the dark; no photograph changes.
_LEAST_VARIANCE = 1e-12  # of a sample, share of the squared mean panchromatic one
_LEAST_PRECISION = 1e-6  # of a chromaticity
_LEAST_LIGHT = 2e-3  # share of the mean panchromatic sample: below it everything counts as equally dark
_FAINTEST, _STRONGEST = 0.06, 3.0  # grey = 1: range of the chromaticity through which errors are seen; the latter a pure colour
# Chosen; in brackets, by how many decibels half or twice changes the case that it changes most (README).
_AROUND = 0.7  # blocks: standard deviation of the Gaussian that smooths the chromaticity through which errors are seen (0.3)
_NEAR = 1.5  # the window's radius, in standard deviations of the weight by distance (0.4)
_UNSURE = 3.0  # standard deviations of noise added to luminance that is compared: without, shadows have a tenth more wrong hues
_FOLLOWED = 0.02  # share of its own noise that a pooled block keeps, which chose its neighbours; without, even places lose 0.1 dB
_EXPECTED = 2.5  # blocks: standard deviation of the Gaussian over the blocks whose chromaticity is expected (0.1)
# Keeps products of the least weights from becoming subnormal numbers, which take processors twenty times as long; a power of two
# changes no digit of a sum.
_LIFT = np.float32(2**24)
# Power of a channel's number of sites by which its differences count. Noise asks for 0.5: a photograph's median then loses 0.12 dB.
_SURER = 0.25
# Units of grey: how far from the expected one a chromaticity may well be. With 0.3, dark colours fade; with 0.6, noise grows.
_APART = 0.42


def pool_blocks(
    blocks: FloatArray,
    frame: Cleaned,
    luminance: FloatArray,
    settings: PoolingSettings,
    progress: Progress = SILENT,
    others: BlockSums | None = None,
) -> FloatArray:
    """c_j of every block, float32 (block rows, block columns, C), sum_i gamma_i c_i = 1; `blocks` itself where there is no noise.

    blocks: what `estimate_chromaticities` returns; the first pass compares these.
    luminance: (H, W), denoised, scene units.
    others: what other frames add to the sums of each whole block.
    """
    noise = frame.noise
    if not settings.used or noise is None or not noise.of_colours:
        return blocks
    progress.stage("pooling", len(settings.passes))
    sites, gamma = frame.sites, frame.gamma
    channels, (rows, columns) = len(gamma), sites.shape
    chromaticity = sites.whole(blocks).transpose(2, 0, 1)
    sums, light = precise_sums(frame, luminance, chromaticity, settings.curvature_error)
    if others is not None:
        shot, read = (np.array(part[:channels])[:, None, None] for part in (noise.shot, noise.read))
        variances = np.maximum(shot * frame.mosaic.calibration.grey * light.clip(0) + read**2, _LEAST_VARIANCE * frame.level**2)
        sums[:channels] += others.weight.transpose(2, 0, 1) / variances
        sums[channels:] += others.product.transpose(2, 0, 1) / variances
    expected, level = _solved(smoothed(sums, _EXPECTED), gamma), frame.level
    surer = np.bincount(sites.channels).astype(np.float32)[:, None, None]
    surer = (surer / surer.mean()) ** np.float32(_SURER)
    brightness = light  # in its place, for memory

    def lit(rows: slice) -> None:
        unsure = np.float32(_UNSURE) * np.sqrt(noise.variance(light[rows]))
        brightness[rows] = np.log(light[rows].clip(_LEAST_LIGHT * level) + unsure)

    in_strips(lit, len(light), BLOCK_ROWS)
    own = 1 / sums[:channels].mean(axis=0).clip(_LEAST_PRECISION)
    variance = own.copy()
    for blur, tolerance, radius in settings.passes:
        distance = np.arange(radius + 1) * (_NEAR / radius)
        near = np.pad(_LIFT * np.exp(-(distance[:, None] ** 2 + distance**2) / 2).astype(np.float32), ((0, 1), (0, 0)))
        spare = [np.zeros_like(variance)] * (-channels % CHANNELS)
        features = np.stack([*smoothed(surer * chromaticity, blur), *spare, (2 * tolerance) * variance, brightness])
        pooled = np.empty((len(sums), rows, columns + SLACK), np.float32)
        falloff = np.float32(-0.5 / settings.light**2)
        pool(_framed(sums, radius, 0), _framed(features, radius, 1), radius, near, falloff, pooled)
        pooled = pooled[:, :, :columns]
        in_strips(lambda rows: np.divide(pooled[:, rows], _LIFT, out=pooled[:, rows]), len(light), BLOCK_ROWS)  # noqa: B023
        variance = np.float32(_FOLLOWED) * own + 1 / pooled[:channels].mean(axis=0).clip(_LEAST_PRECISION)
        chromaticity = _solved(pooled, gamma, 1 / (_APART * frame.mosaic.calibration.grey), expected)
        progress.advance()
    return sites.grid.extend(chromaticity.transpose(1, 2, 0))


def precise_sums(frame: Cleaned, luminance: FloatArray, chromaticity: FloatArray, error: float) -> tuple[FloatArray, FloatArray]:
    """The sums of Eqs. 8-9 of each whole block, float32 (2 C, rows, columns), and its luminance, float32 (rows, columns).

    The planes are sum l^2 of each channel, then sum l m of each channel. Each term is divided by the variance of its error. That is
    the noise of the sample, taking the block for grey, and an error of luminance of `error` times its curvature, as the channel
    sees it: `chromaticity`, (C, rows, columns), is averaged over the block and its neighbours for this.
    """
    channels, noise = len(frame.gamma), frame.noise or NoiseModel.gaussian(0.0, len(frame.gamma))
    sums, light = np.zeros((2 * channels, *frame.sites.shape), np.float32), np.zeros(frame.sites.shape, np.float32)
    signal = frame.signal
    grey = np.float32(frame.mosaic.calibration.grey)
    smooth, least = smoothed(chromaticity, _AROUND), _LEAST_VARIANCE * frame.level**2

    def work(rows: slice) -> None:
        seen = smooth[:, rows].clip(_FAINTEST * grey, _STRONGEST * grey)
        for channel, place in zip(frame.sites.channels, frame.sites.at(rows), strict=True):
            value = luminance[place]
            variance = noise.shot[channel] * grey * value.clip(0) + noise.read[channel] ** 2
            variance += (np.float32(error) * seen[channel] * curvature(luminance, place, frame.sites.grid)) ** 2
            precision = 1 / np.maximum(variance, least)
            sums[channel, rows] += value**2 * precision
            sums[channels + channel, rows] += value * signal[place] * precision
            light[rows] += value / len(frame.sites.places)

    in_strips(work, len(light), BLOCK_ROWS)
    return sums, light


def _solved(sums: FloatArray, gamma: DoubleArray, sigma: float = 1.0, expected: FloatArray | None = None) -> FloatArray:
    """Chromaticities, float32 (C, rows, columns), from sums of blocks, float32 (2 C, rows, columns); see `BlockSums.solved`.

    expected: as the result. A chromaticity is 1 / sigma from it, or from grey, as likely as a sum is wrong by its noise.
    """
    channels = len(gamma)
    found = np.empty((channels, *sums.shape[1:]), np.float32)

    def work(rows: slice) -> None:
        weight, product = np.moveaxis(sums[:, rows].astype(np.float64).reshape(2, channels, -1, sums.shape[2]), 1, 3)
        centre = None if expected is None else expected[:, rows].transpose(1, 2, 0).astype(np.float64)
        found[:, rows] = BlockSums(weight, product).solved(sigma, gamma, centre).transpose(2, 0, 1)

    in_strips(work, sums.shape[1], BLOCK_ROWS)
    return found


def _framed(planes: FloatArray, radius: int, value: float) -> FloatArray:
    """`planes` with a frame of one value around them, as wide as a window reaches."""
    return np.pad(planes, ((0, 0), (radius, radius + 1), (radius, radius + SLACK)), constant_values=np.float32(value))


SLACK = WIDTH
"""Columns after the border, so that the last vector stays inside the array."""
_TOGETHER = 2  # statistics that are summed together: the sums of more, for a pair of rows, do not fit in the registers of AVX2
CHANNELS = 3
"""Chromaticities that are compared together; their number is a multiple of this."""
_PAIR = 2  # rows that are computed together: what is read for one serves the other
_ZERO = np.float32(0)


@parallel_kernel(pieces=lambda *given: -(-given[-1].shape[1] // _PAIR))
def pool(pieces: Pieces, sums: Floats3, features: Floats3, radius: int, near: Floats2, light: Single, out: Floats3) -> None:
    """Sum the statistics of the blocks in a window around each block, weighted by similarity.

    The weight of two blocks is near[rows between them, columns between them] times exp(-(squared distance of chromaticities) /
    (sum of both variance planes) + light * (difference of log luminance)**2).

    sums: (S, radius + rows + radius + 1, radius + columns + radius + SLACK), the statistics; 0 outside the frame. S is even.
    features: (C + 2, as `sums`): C chromaticities, their scaled variance (any positive one outside the frame), log luminance. C is
        a multiple of `CHANNELS`.
    radius: radius of the window, blocks.
    near: (radius + 2, radius + 1), weights by distance, to any scale; the last row is 0.
    light: < 0, see above.
    out: (S, rows, columns + SLACK), written.
    """
    rows = out.shape[1]
    for pair in range(pieces[0], pieces[1]):
        total, weights = zeros(_PAIR * len(sums), WIDTH), zeros(_PAIR, 2 * radius + 1, WIDTH)
        centre = zeros(_PAIR, len(features), WIDTH)
        for column in range(0, out.shape[2] - SLACK, WIDTH):
            total[:] = _ZERO
            for row in range(_PAIR):
                for plane in range(len(features)):
                    store(centre, (row, plane, 0), load(features, (plane, _PAIR * pair + row + radius, column + radius)))
            for down in range(2 * radius + _PAIR):
                y = _PAIR * pair + down
                _weigh(
                    features, centre, y, column, near[abs(down - radius)], near[abs(down - radius - 1)], np.float32(light), weights
                )
                _sum(sums, weights, y, column, total)
            for row in range(_PAIR * pair, min(_PAIR * pair + _PAIR, rows)):
                for plane in range(len(sums)):
                    store(out, (plane, row, column), load(total, (_PAIR * plane + row % _PAIR, 0)))


@kernel
def _weigh(
    features: Floats3, centre: Floats3, y: int, column: int, near: Floats1, near_lower: Floats1, light: Scalar, weights: Floats3
) -> None:
    """The weights of all blocks in row `y` for a pair of rows of blocks: their features are `centre`, their distances `near`."""
    channels, radius = len(features) - 2, weights.shape[1] // 2
    for across in range(weights.shape[1]):
        x, away = column + across, abs(across - radius)
        upper = load(features, (channels, y, x)) * _ZERO
        lower = upper
        for channel in range(0, channels, CHANNELS):
            a, b, c = load(features, (channel, y, x)), load(features, (channel + 1, y, x)), load(features, (channel + 2, y, x))
            upper = _farther(upper, a, b, c, centre, 0, channel)
            lower = _farther(lower, a, b, c, centre, 1, channel)
        variance, brightness = load(features, (channels, y, x)), load(features, (channels + 1, y, x))
        upper = _weight(upper, variance, brightness, centre, 0, channels, light) * near[away]
        lower = _weight(lower, variance, brightness, centre, 1, channels, light) * near_lower[away]
        store(weights, (0, across, 0), upper)
        store(weights, (1, across, 0), lower)


@kernel
def _farther(distance: Lanes, a: Lanes, b: Lanes, c: Lanes, centre: Floats3, row: int, channel: int) -> Lanes:
    """A squared distance, to which that of three features from those of a row of the pair is added."""
    a -= load(centre, (row, channel, 0))
    b -= load(centre, (row, channel + 1, 0))
    c -= load(centre, (row, channel + 2, 0))
    return distance + a * a + b * b + c * c


@kernel
def _weight(distance: Lanes, variance: Lanes, brightness: Lanes, centre: Floats3, row: int, channels: int, light: Scalar) -> Lanes:
    """How similar blocks are, from the squared distance of their chromaticities, their variance and their brightness."""
    brighter = brightness - load(centre, (row, channels + 1, 0))
    dissimilar = quotient(distance, load(centre, (row, channels, 0)) + variance)
    return exponential(light * (brighter * brighter) - dissimilar)


@kernel
def _sum(sums: Floats3, weights: Floats3, y: int, column: int, total: Floats2) -> None:
    """Add the weighted statistics of a row of the window to the totals of a pair of rows."""
    for plane in range(0, len(sums), _TOGETHER):
        t = _PAIR * plane
        a, b, c, d = load(total, (t, 0)), load(total, (t + 1, 0)), load(total, (t + 2, 0)), load(total, (t + 3, 0))
        for across in range(weights.shape[1]):
            first, second = load(sums, (plane, y, column + across)), load(sums, (plane + 1, y, column + across))
            upper, lower = load(weights, (0, across, 0)), load(weights, (1, across, 0))
            a, b, c, d = a + upper * first, b + lower * first, c + upper * second, d + lower * second
        for place, value in enumerate((a, b, c, d)):
            store(total, (t + place, 0), value)
