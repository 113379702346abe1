"""Chromaticity from the pooled statistics of many similar blocks, where a single block is too
noisy; not in the paper.

The sums of Eqs. 8-9 hold everything that a block b knows about its chromaticity, for each channel
i, with l its luminance, m its samples and v the variance of their errors:

    A_i(b) = sum l^2 / v,  B_i(b) = sum l m / v,
    v = shot grey l + read^2 + (error c_i curvature(l))^2

So the sums are added up, not the chromaticities: a dark block adds little to its neighbours and
gains much from them, and so does a block on an edge, whose luminance is filled in and uncertain. In
each pass, over a window of blocks b' around b,

    A'_i(b) = sum w(b, b') A_i(b'),  B' likewise,  w = near(b - b') exp(-d),
    d = |n (c(b) - c(b'))|^2 / (2 tolerance (s^2(b) + s^2(b')))
        + (log l(b) - log l(b'))^2 / (2 light^2),

where c is the chromaticity so far, smoothed, s^2 its variance, and n grows with the number of sites
of a channel, whose differences are surer. Then c minimises

    sum_i A'_i c_i^2 - 2 B'_i c_i + (c_i - e_i)^2 / (0.42 grey)^2  under  sum_i gamma_i c_i = 1.

Eqs. 8-9 pull a block towards grey. Pooled sums are surer, and need less of that; and what a camera
takes for grey is seldom the colour of a dark place. So e is the chromaticity of all blocks around.

Where it is dark such a prior knows more than the samples, and s^2 is that of the posterior: with
<A> the mean over the channels and p the inverse variance of the prior, 1 / (<A> + p). A block's own
noise has chosen its neighbours too, and a fraction of its variance stays:

    s^2 = 1 / (<A'> + (0.42 grey)^-2) + 0.024 / (<A> + grey^-2)
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ...shared.arrays import FloatArray
from ...shared.progress import SILENT, Progress
from ..frame import BlockSums, Frame, curvature
from ..numerics.arrays import Floats1, Floats2, Floats3
from ..numerics.chunks import BLOCK_ROWS, in_strips
from ..numerics.compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from ..numerics.gaussian import smoothed
from ..numerics.lanes import WIDTH, Lanes, greater, load, quotient, store
from ..stage import NotNegative, Positive, Range, StageSettings

WIDEST_WINDOW = 64  # blocks: radius of pooling accepted at most, for time and memory


class PoolingPass(NamedTuple):
    """One pass of pooling.

    Attributes
    ----------
    blur : float
        Standard deviation of the Gaussian that smooths the chromaticities compared, blocks, 0 to
        64.
    tolerance : float
        Squared difference that chromaticities may have, as a multiple of the variance that noise
        has left in them, > 0.
    radius : int
        Radius of the window, blocks.
    """

    blur: float
    tolerance: float
    radius: int


_PASSES = Range(
    lambda passes: all(
        0 <= step[0] <= WIDEST_WINDOW and step[1] > 0 and 1 <= step[2] <= WIDEST_WINDOW
        for step in passes
    ),
    f"for each pass a blur, 0 to {WIDEST_WINDOW}, a tolerance, more than 0, and a radius, 1 to "
    f"{WIDEST_WINDOW}",
)


@dataclass(frozen=True)
class PoolingSettings(StageSettings):
    """Averaging of the sums of Eqs. 8-9 over blocks of similar chromaticity; the paper has none.

    Attributes
    ----------
    passes : tuple[PoolingPass, ...]
        One `PoolingPass` each; empty = no pooling.
    light : Positive
        How much the luminance of blocks may differ: standard deviation of the Gaussian weight of
        its logarithm, less in the dark, > 0.
    curvature_error : NotNegative
        Error of filled luminance, as a multiple of its curvature there and of the square of the
        number of channels, 0 or more: the more there are, the less of luminance each one shows, and
        the fewer sites it has.
    """

    passes: Annotated[tuple[PoolingPass, ...], _PASSES] = ()
    light: Positive = 0.25
    curvature_error: NotNegative = 0.05


# These keep quotients and logarithms finite in the dark; no photograph changes.
_LEAST_VARIANCE = 1e-12  # of a sample, share of the squared mean panchromatic one
# share of the mean panchromatic sample: below it everything counts as equally dark
_LEAST_LUMINANCE = 2e-3
# grey = 1: range of the chromaticity through which errors are seen; the latter a pure colour
_FAINTEST, _STRONGEST = 0.06, 3.0
# Chosen on photographs.
_WINDOW_WIDTH = 1.5  # the window's radius, in standard deviations of the weight by distance
# standard deviations of noise added to luminance that is compared: without, shadows have a tenth
# more wrong hues
_UNSURE = 3.0
# share of its own noise that a pooled block keeps, which chose its neighbours: without, flat places
# are uneven
_FOLLOWED = 0.024
# blocks: standard deviation of the Gaussian over the blocks whose chromaticity is expected
_EXPECTED = 2.5
# Power of a channel's number of sites by which its differences count. Noise asks for 0.5, which
# blurs colours in fine detail.
_SURER = 0.25
# Units of grey: how far from the expected one a chromaticity may well be. With 0.3, dark colours
# fade; with 0.6, noise grows.
_APART = 0.42


def pool_blocks(
    blocks: FloatArray, frame: Frame, settings: PoolingSettings, progress: Progress = SILENT
) -> FloatArray:
    """c_j of every block, float32 (block rows, block columns, C), sum_i gamma_i c_i = 1; `blocks`
    itself where there is no noise.

    Parameters
    ----------
    blocks : FloatArray
        What `estimate_chromaticities` returns; the first pass compares these.
    """
    error = settings.curvature_error * len(frame.gamma) ** 2
    return frame.sites.grid.extend(pooled_in_passes(blocks, frame, settings, error, progress)[-1])


def pooled_in_passes(
    blocks: FloatArray, frame: Frame, settings: PoolingSettings, error: float, progress: Progress
) -> list[FloatArray]:
    """c_j of the whole blocks after each pass, float32 (rows, columns, C); those of `blocks` where
    there is no noise. Parameters as for `pool_blocks`; `error` of filled luminance as for
    `precise_sums`.
    """
    noise = frame.noise
    if not settings.passes or noise is None or not noise.of_colours:
        return [blocks[frame.grid.whole]] * max(len(settings.passes), 1)
    progress.stage("pooling colour of blocks", len(settings.passes))
    sites, gamma, grey = frame.sites, frame.gamma, frame.mosaic.calibration.grey
    chromaticity = np.moveaxis(blocks[frame.grid.whole], 2, 0)
    sums, filled = precise_sums(frame, chromaticity, error)
    if (others := frame.others) is not None:
        shown = np.float32(grey) * filled[..., None]
        variances = frame.variance(shown, slice(0, len(filled)), np.arange(len(gamma)))
        precision = 1 / np.maximum(variances, _LEAST_VARIANCE * frame.level**2)
        added = np.concatenate([others.weight * precision, others.product * precision], axis=2)
        sums += np.moveaxis(added, 2, 0)
    expected = _solved(smoothed(sums, _EXPECTED), frame)
    unsure = np.float32(_UNSURE) * np.sqrt(noise.variance(filled))
    brightness = np.log(filled.clip(_LEAST_LUMINANCE * frame.level) + unsure)
    brightness /= np.float32(2**0.5 * settings.light)
    surer = sites.pattern.site_counts.astype(np.float32)[:, None, None]
    surer = (surer / surer.mean()) ** np.float32(_SURER)
    variance, apart = chromaticity_variance(sums), 1 / (_APART * grey)
    own = np.float32(_FOLLOWED) * chromaticity_variance(sums, 1 / grey)
    results = list[FloatArray]()
    for blur, tolerance, radius in settings.passes:
        compared = smoothed(surer * chromaticity, blur)
        features = np.stack([*compared, brightness, (2 * tolerance) * variance])
        distance = np.arange(radius + 1) * (_WINDOW_WIDTH / radius)
        pooled = _pooled(sums, features, np.exp(-np.square(distance) / 2).astype(np.float32))
        variance = own + chromaticity_variance(pooled, apart)
        results.append(_solved(pooled, frame, apart, expected))
        chromaticity = np.moveaxis(results[-1], 2, 0)
        progress.advance()
    return results


def _pooled(sums: FloatArray, features: FloatArray, near: FloatArray) -> FloatArray:
    """The result of the kernel `pool` for sums and features of the frame alone, float32 (2 C, rows,
    columns).
    """
    (count, rows, columns), radius = sums.shape, len(near) - 1
    more, wider = -count % _TOGETHER, -columns % WIDTH
    sides = (radius, radius), (radius, radius + wider)
    pooled = np.zeros((count + more, rows, columns + wider), np.float32)
    features = np.pad(features, ((0, 0), *sides), constant_values=1)
    pool(np.pad(sums, ((0, more), *sides)), features, near, pooled)
    return pooled[:count, :, :columns]


def precise_sums(frame: Frame, colours: FloatArray, error: float) -> tuple[FloatArray, FloatArray]:
    """A and B of each whole block, float32 (2 C, rows, columns), and its luminance, float32 (rows,
    columns).

    The noise of a sample takes the block for grey.

    Parameters
    ----------
    colours : FloatArray
        (C, rows, columns), chromaticities, through which channels see the error of luminance, which
        is `error` times its curvature.
    """
    channels, grey = len(frame.gamma), np.float32(frame.mosaic.calibration.grey)
    sums = np.zeros((2 * channels, *frame.sites.shape), np.float32)
    filled = np.zeros(frame.sites.shape, np.float32)
    sensitivity, signal = colours.clip(_FAINTEST * grey, _STRONGEST * grey), frame.signal

    def work(rows: slice) -> None:
        for channel, place in zip(frame.sites.channels, frame.sites.at(rows), strict=True):
            value = frame.luminance[place]
            bend = curvature(frame.luminance, place, frame.grid)
            variance = np.square(np.float32(error) * sensitivity[channel, rows] * bend)
            variance += frame.variance((grey * value)[..., None], rows, np.array([channel]))[..., 0]
            precision = 1 / np.maximum(variance, _LEAST_VARIANCE * frame.level**2)
            sums[channel, rows] += value**2 * precision
            sums[channels + channel, rows] += value * signal[place] * precision
            filled[rows] += value / len(frame.sites.places)

    in_strips(work, len(filled), BLOCK_ROWS)
    return sums, filled


def chromaticity_variance(sums: FloatArray, sigma: float = 1.0) -> FloatArray:
    """Posterior variance of chromaticities, the mean of the channels, float32 (rows, columns).

    Parameters
    ----------
    sums : FloatArray
        (2 C, rows, columns), A and B of each block, see above.
    sigma : float, optional
        1 / standard deviation of the prior; by default that of Eqs. 8-9.
    """
    precision = sums[: len(sums) // 2].mean(axis=0, dtype=np.float32) + np.float32(sigma**2)
    return np.float32(1) / precision


def _solved(
    sums: FloatArray, frame: Frame, sigma: float = 1.0, expected: FloatArray | None = None
) -> FloatArray:
    """Chromaticities, float32 (rows, columns, C), from sums of blocks, float32 (2 C, rows,
    columns); see `BlockSums.solved`.

    expected: as the result. A chromaticity is 1 / sigma from it, or from grey, as likely as a sum
    is wrong by its noise.
    """
    weight, product = np.moveaxis(sums.reshape(2, -1, *sums.shape[1:]), 1, 3)
    return BlockSums(weight, product).solved(sigma, frame.gamma, expected).astype(np.float32)


# exp(-d) is (1 - d / 16)^16, and 0 beyond: processors compute it on many blocks at once.
_SHARE = np.float32(1 / 16)
# statistics summed at a time, as many as three channels have: more do not fit in the registers of
# AVX2
_TOGETHER = 6


@parallel_kernel(chunks=lambda *given: given[-1].shape[1])
def pool(chunks: Chunks, sums: Floats3, features: Floats3, near: Floats1, pooled: Floats3) -> None:
    """Sum the statistics of the blocks in a window around each block, weighted by w, see above.

    Parameters
    ----------
    sums : Floats3
        (S, radius + rows + radius, radius + columns + radius), S a multiple of `_TOGETHER`, the
        statistics; 0 outside the frame.
    features : Floats3
        (C + 2, as `sums`): C chromaticities, the logarithm of luminance, and the variance, which is
        more than 0; each scaled, so that d is (squared differences of the first) / (sum of the
        last) + (squared difference of the second).
    near : Floats1
        (radius + 1,), weights by rows, and by columns, between blocks.
    pooled : Floats3
        (S, rows, columns), columns a multiple of `WIDTH`; 0, and then written.
    """
    radius, brightness = len(near) - 1, len(features) - 2
    for row in range(chunks[0], chunks[1]):
        for first in range(0, len(sums), _TOGETHER):
            for column in range(0, pooled.shape[2], WIDTH):
                down, across = row + radius, column + radius
                a = b = c = d = e = f = load(pooled, (first, row, column))
                for y in range(row, row + 2 * radius + 1):
                    for x in range(column, column + 2 * radius + 1):
                        distance = _squared_difference(features[0], y, x, down, across)
                        for plane in range(1, brightness):
                            distance += _squared_difference(features[plane], y, x, down, across)
                        noise = load(features, (brightness + 1, y, x))
                        noise += load(features, (brightness + 1, down, across))
                        distance = quotient(distance, noise)
                        distance += _squared_difference(features[brightness], y, x, down, across)
                        weight = greater(ONE - _SHARE * distance, ZERO)
                        weight *= weight
                        weight *= weight
                        weight *= weight
                        weight *= weight * (near[abs(y - down)] * near[abs(x - across)])
                        a += weight * load(sums, (first, y, x))
                        b += weight * load(sums, (first + 1, y, x))
                        c += weight * load(sums, (first + 2, y, x))
                        d += weight * load(sums, (first + 3, y, x))
                        e += weight * load(sums, (first + 4, y, x))
                        f += weight * load(sums, (first + 5, y, x))
                for step, value in enumerate((a, b, c, d, e, f)):
                    store(pooled, (first + step, row, column), value)


@kernel
def _squared_difference(feature: Floats2, y: int, x: int, row: int, column: int) -> Lanes:
    """The squared difference of a feature between blocks at (y, x) and the one at (row, column),
    and those to their right.
    """
    difference = load(feature, (y, x)) - load(feature, (row, column))
    return difference * difference
