"""What the samples of a block say about errors at its sites: luminance and chromaticity together, then what is left.

Luminance under the colour sites is filled in, and wrong by some delta. A sample is c (l + delta) + noise, with c the chromaticity
of its channel. So one error of luminance shows in all samples of the block, in proportion to c. Eqs. 8-9 take these errors for
independent and equal. Here they have a covariance D R D, with D the diagonal matrix of c, and R falls with the distance between
sites, because a stroke or an edge that passes through one of them passes near the others. To it are added the noise, and what
differs from site to site, because one chromaticity does not describe a whole block.

- `solve_jointly`: chromaticity is the generalised least squares solution with this covariance, under the constraint of Eq. 7. A
  bright stroke through a red site then reads as a bright stroke rather than as a red one.
- `settle_luminance`: given the final chromaticity, delta is what this covariance makes most probable.
- `correct_sites`: what the finished picture still misses (sample minus picture) is shared out to all channels of all sites of the
  block, by the covariance of a picture's errors (`shared.site_errors`).

All three are conditional means of a Gaussian model, for any pattern. None is in the paper. The constants were chosen on
photographs; twice or half of each changes the result by a few hundredths of a decibel.
"""

from dataclasses import dataclass

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.pattern import BlockGrid, CfaPattern
from shared.site_errors import error_correlation, nearness

from .blocks import block_sites, curvature
from .gaussian import gaussian, smoothed
from .kernels import sites as kernels
from .settings import SiteSettings
from .tiling import Part

_FILLED = 0.5  # correlation of the errors of filled luminance one pixel apart
_DOUBT = 0.3  # error of filled luminance as a multiple of its curvature
_ROUNDS = 3  # in which the covariance takes its c from the round before
_DARK = 1e-6  # scene units: luminance below it has no chromaticity
_WIDTH = 0.7  # blocks: standard deviation of the neighbourhood over which the power of errors is averaged


@dataclass(frozen=True, eq=False)
class SiteSamples:
    """What the whole blocks of a frame measured: float32 (rows, columns, S) for S sites per block.

    grid: the blocks of the frame.
    places: for each site its channel, and slices of the frame's rows and columns.
    samples: scene units, defects mended and highlights restored; 0 in every block that is not trusted.
    variance: variance of their noise, scene units squared; None = there is no noise, or it is unknown.
    trusted: bool (rows, columns), blocks without a sample at the sensor's limit.
    """

    grid: BlockGrid
    places: list[tuple[int, slice, slice]]
    samples: FloatArray
    variance: FloatArray | None
    trusted: BoolArray

    @property
    def reach(self) -> int:
        """How many rows above and below a site its correction depends on."""
        return (len(gaussian(_WIDTH)) // 2 + 1) * self.grid.period

    def within(self, part: Part) -> slice:
        """The rows of blocks that lie wholly inside a part of the picture."""
        first = self.grid.whole_rows - part.first
        inside = np.flatnonzero((first >= 0) & (first + self.grid.block_shape[0] <= len(part.luminance)))
        return slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)

    def inside(self, part: Part, rows: slice) -> list[tuple[int, slice, slice]]:
        """`places` of these rows of blocks, in a part of the picture."""
        period, count = self.grid.period, rows.stop - rows.start
        first = [place.start + rows.start * period - part.first for _, place, _ in self.places]
        return [
            (channel, slice(start, start + (count - 1) * period + 1, period), columns)
            for start, (channel, _, columns) in zip(first, self.places, strict=True)
        ]

    def error(self, part: Part, gamma: FloatArray, rows: slice) -> FloatArray:
        """Sample minus picture at each site, times gamma (so that all channels have the unit of luminance); 0 without trust."""
        found = np.empty((rows.stop - rows.start, *self.samples.shape[1:]), np.float32)
        for site, (channel, *place) in enumerate(self.inside(part, rows)):
            seen = part.chromaticity[*place][..., channel] * part.luminance[*place]
            found[..., site] = (self.samples[rows, :, site] - seen) * gamma[channel]
        return found * self.trusted[rows, :, None]

    def scaled_variance(self, gamma: FloatArray, rows: slice) -> FloatArray | None:
        """Variance of the noise in `error`, mean over the sites, float32 (rows, columns); None = no noise."""
        if self.variance is None:
            return None
        weights = gamma[[channel for channel, *_ in self.places]]
        scaled: FloatArray = (self.variance[rows] * weights**2).mean(axis=2)
        return scaled


def site_samples(mosaic: Mosaic, samples: Mosaic, noise: NoiseModel | None, clipping: float) -> SiteSamples:
    """The samples of all whole blocks.

    mosaic: as measured. samples: the same, in scene units, mended and restored.
    noise: noise of the mosaic; None = unknown, treated as none.
    clipping: scene units from which on a sample is at the sensor's limit.
    """
    grid, signal = mosaic.pattern.grid(mosaic.shape), samples.signal
    places = block_sites(mosaic.pattern, grid)
    values = gathered(signal, places)
    trusted = np.ones(values.shape[:2], np.bool_)
    if np.isfinite(clipping):
        trusted[:] = (gathered(mosaic.signal, places) < clipping).all(axis=2)
    variance = None
    if noise is not None and any(noise.shot[:-1] + noise.read[:-1]):
        channels = [channel for channel, *_ in places]
        shot, read = (np.array(part, np.float32)[channels] for part in (noise.shot, noise.read))
        variance = shot * values.clip(0) + read**2
    return SiteSamples(grid, places, values, variance, trusted)


def gathered(plane: FloatArray, places: list[tuple[int, slice, slice]]) -> FloatArray:
    """The values of (H, W) at each site of the whole blocks, (rows, columns, S)."""
    return np.stack([plane[rows, columns] for _, rows, columns in places], axis=2)


def solve_jointly(
    mosaic: Mosaic, luminance: FloatArray, grid: BlockGrid, chromaticity: DoubleArray, sigma: float, mismatch: float
) -> DoubleArray:
    """Chromaticities of the whole blocks, float64 (rows, columns, C), by generalised least squares; sum_i gamma_i c_i = 1.

    luminance: (H, W), scene units.
    chromaticity: the solution of Eqs. 8-9, where the first round takes its covariance from.
    sigma: sigma_z of these equations, > 0.
    mismatch: variance that differs from site to site, relative to that of luminance's error.
    """
    places, signal = block_sites(mosaic.pattern, grid), mosaic.signal
    light = gathered(luminance, places)
    bends = [curvature(luminance, [*site], grid.block_shape) for _, *site in places]
    doubt = np.sqrt(np.mean(np.square(bends), axis=0)) * np.float32(_DOUBT)
    channels: IndexArray = np.array([channel for channel, *_ in places], np.intp)
    variance = np.full_like(light, sigma**2)
    near, gamma = nearness(mosaic.pattern, _FILLED), np.array(mosaic.calibration.gamma)
    solved = chromaticity.copy()
    kernels.solve_jointly(light, gathered(signal, places), doubt, variance, channels, near, mismatch, gamma, _ROUNDS, solved)
    return solved


def settle_luminance(
    luminance: FloatArray, blocks: FloatArray, sites: SiteSamples, pattern: CfaPattern, mismatch: float, settings: SiteSettings
) -> FloatArray:
    """l[n], float32 (H, W), with the most probable error of luminance at the colour sites taken off.

    blocks: chromaticity of every block of the grid, (block rows, block columns, C).
    mismatch: as in `solve_jointly`.
    """
    if not settings.corrected:
        return luminance
    whole = blocks[sites.grid.inside].reshape(*sites.trusted.shape, -1)
    colour = np.stack([whole[..., channel] for channel, *_ in sites.places], axis=2)
    error = (sites.samples - colour * gathered(luminance, sites.places)) * sites.trusted[..., None]
    variance = np.zeros_like(error) if sites.variance is None else sites.variance
    power = signal_power(error, None if sites.variance is None else variance.mean(axis=2), settings.deviations)
    delta = np.empty_like(error)
    kernels.settle(error, colour, power, variance, nearness(pattern, _FILLED), mismatch, delta)
    settled = luminance.copy()
    for site, (_, rows, columns) in enumerate(sites.places):
        settled[rows, columns] += delta[..., site]
    return settled


def signal_power(error: FloatArray, variance: FloatArray | None, deviations: float) -> FloatArray:
    """Mean square of `error`, (rows, columns, S), around each block, without what noise accounts for: float32 (rows, columns).

    variance: of the noise, (rows, columns); None = no noise. deviations: multiple of it that is taken off.
    """
    power = smoothed(np.square(error).mean(axis=2), _WIDTH)
    if variance is not None:
        power = np.maximum(power - np.float32(deviations) * variance, 0)
    result: FloatArray = power.astype(np.float32, copy=False)
    return result


def correct_sites(part: Part, sites: SiteSamples, pattern: CfaPattern, gamma: tuple[float, ...], settings: SiteSettings) -> Part:
    """The part of a render with the errors at its colour sites shared out; only rows `sites.reach` inside the part are final.

    gamma: (C,), the weights of Eq. 7.
    """
    rows = sites.within(part)
    if not settings.corrected or rows.start >= rows.stop:
        return part
    weights = np.array(gamma, np.float32)
    error = sites.error(part, weights, rows)
    variance = sites.scaled_variance(weights, rows)
    share = _Residual(pattern)(error, signal_power(error, variance, settings.deviations), variance)
    luminance, chromaticity = part.luminance.copy(), part.chromaticity.copy()
    for site, (_, *place) in enumerate(sites.inside(part, rows)):
        before = luminance[*place]
        after = before + share[:, :, site].sum(axis=2)
        lit = (after > _DARK) & (before > _DARK)
        colour = (chromaticity[*place] * before[..., None] + share[:, :, site] / weights) / np.where(lit, after, 1)[..., None]
        luminance[*place] = np.where(lit, after, before)
        chromaticity[*place] = np.where(lit[..., None], colour, chromaticity[*place])
    return Part(part.first, luminance, chromaticity)


class _Residual:
    """The linear map from what a picture misses at the sites of a block to the errors of all channels there."""

    def __init__(self, pattern: CfaPattern) -> None:
        every, measured = error_correlation(pattern)
        self._strengths, vectors = np.linalg.eigh(every[np.ix_(measured, measured)])
        self._inward = np.ascontiguousarray(vectors.T)
        self._outward = np.ascontiguousarray(every[:, measured] @ vectors)
        self._shape = len(pattern.sites), len(pattern.channels)

    def __call__(self, error: FloatArray, power: FloatArray, variance: FloatArray | None) -> FloatArray:
        """Corrections, float32 (rows, columns, S, C), from errors (rows, columns, S) and what `signal_power` makes of them."""
        noise = np.zeros_like(power) if variance is None else variance
        out = np.empty((*power.shape, len(self._outward)), np.float32)
        kernels.correct(error, power, noise, self._strengths, self._inward, self._outward, out)
        return out.reshape(*power.shape, *self._shape)
