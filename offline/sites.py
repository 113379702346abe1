"""What the samples of a block say about errors at its sites: luminance and chromaticity together, then what is left.

Luminance under the colour sites is filled in, and wrong by some delta. A sample is c (l + delta) + noise, with c the chromaticity
of its channel. So one error of luminance shows in all samples of the block, in proportion to c. Eqs. 8-9 take these errors for
independent and equal. Here they have a covariance D R D, with D the diagonal matrix of c, and R falls with the distance between
sites, because a stroke or an edge that passes through one of them passes near the others. To it are added the noise, and what
differs from site to site, because one chromaticity does not describe a whole block.

- `solve_jointly`: chromaticity is the generalised least squares solution with this covariance, under the constraint of Eq. 7. A
  bright stroke through a red site then reads as a bright stroke rather than as a red one.
- `settle_luminance`: given the final chromaticity, delta is what the samples make most probable.
- `correct_sites`: what the finished picture still misses (sample minus picture) is shared out to all channels of all sites of the
  block. Some of it is an error of luminance, as far as luminance is in doubt, and the rest an error of colour, which leaves
  luminance as it is. Where luminance is flat, as at an edge between two colours of one brightness, all of it is colour.

All three are conditional means of a Gaussian model, for any pattern. None is in the paper. The constants were chosen on
photographs; twice or half of each changes the result by a few hundredths of a decibel.
"""

from dataclasses import dataclass

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.pattern import BlockGrid, CfaPattern
from shared.site_errors import nearness

from .blocks import block_sites, curvature
from .gaussian import gaussian, smoothed
from .kernels import sites as kernels
from .settings import SiteSettings
from .tiling import DARK, Part

_FILLED = 0.5  # correlation of the errors of filled luminance one pixel apart
_DOUBT = 0.7  # error of filled luminance as a multiple of its curvature
_TINT, _LEAST_SHARE = 0.5, 1e-6  # share of the power of errors that is colour at least; of luminance in the sites' channels
_ROUNDS = 3  # in which the covariance takes its c from the round before
_WIDTH = 0.7  # blocks: standard deviation of the neighbourhood over which the power of errors is averaged


@dataclass(frozen=True, eq=False)
class SiteSamples:
    """What the whole blocks of a frame measured: float32 (rows, columns, S) for S sites per block.

    pattern: the filter pattern. grid: its blocks in the frame.
    places: for each site its channel, and slices of the frame's rows and columns.
    samples: scene units, defects mended and highlights restored.
    variance: variance of their noise, scene units squared; None = there is no noise, or it is unknown.
    trusted: bool (rows, columns), blocks without a sample at the sensor's limit in them or next to them.
    doubt: standard deviation of the error of filled luminance, float32 (rows, columns), scene units.
    kept: share of what the samples miss that `correct_sites` corrects, float32 (rows, columns), 0 to 1; None = all of it. A burst
        corrects the rest itself, with the samples of all frames.
    """

    pattern: CfaPattern
    grid: BlockGrid
    places: list[tuple[int, slice, slice]]
    samples: FloatArray
    variance: FloatArray | None
    trusted: BoolArray
    doubt: FloatArray
    kept: FloatArray | None = None

    @property
    def channels(self) -> IndexArray:
        """The channel of each site, (S,)."""
        return np.array([channel for channel, *_ in self.places], np.intp)

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
        """Variance of the noise in `error`, float32 (rows, columns, S); None = no noise."""
        if self.variance is None:
            return None
        return self.variance[rows] * gamma[self.channels] ** 2


def site_samples(mosaic: Mosaic, trusted: BoolArray, luminance: FloatArray, noise: NoiseModel | None) -> SiteSamples:
    """The samples of all whole blocks.

    mosaic: in scene units, defects mended and highlights restored.
    trusted: what `unclipped_blocks` returned before highlights were restored.
    luminance: (H, W), filled in, scene units.
    noise: noise of the mosaic; None = unknown, treated as none.
    """
    grid = mosaic.pattern.grid(mosaic.shape)
    places = block_sites(mosaic.pattern, grid)
    values = gathered(mosaic.signal, places)
    variance = None
    if noise is not None and any(noise.shot[:-1] + noise.read[:-1]):
        channels = [channel for channel, *_ in places]
        shot, read = (np.array(part, np.float32)[channels] for part in (noise.shot, noise.read))
        variance = shot * values.clip(0) + read**2
    return SiteSamples(mosaic.pattern, grid, places, values, variance, trusted, doubt_of(luminance, places, grid))


def unclipped_blocks(mosaic: Mosaic, clipping: float) -> BoolArray:
    """The whole blocks that have no sample of `clipping` (scene units) or more in or next to them, bool (rows, columns)."""
    signal, grid = mosaic.signal, mosaic.pattern.grid(mosaic.shape)
    trusted = np.ones((len(grid.whole_rows), len(grid.whole_columns)), np.bool_)
    if not signal.max() >= clipping:
        return trusted
    limits = [size - 1 for size in signal.shape]
    for down in range(-1, grid.block_shape[0] + 1):
        rows = (grid.whole_rows + down).clip(0, limits[0])
        for right in range(-1, grid.block_shape[1] + 1):
            trusted &= signal[np.ix_(rows, (grid.whole_columns + right).clip(0, limits[1]))] < clipping
    return trusted


def gathered(plane: FloatArray, places: list[tuple[int, slice, slice]]) -> FloatArray:
    """The values of (H, W) at each site of the whole blocks, (rows, columns, S)."""
    return np.stack([plane[rows, columns] for _, rows, columns in places], axis=2)


def doubt_of(luminance: FloatArray, places: list[tuple[int, slice, slice]], grid: BlockGrid) -> FloatArray:
    """Standard deviation of the error of filled luminance in each whole block, scene units, float32 (rows, columns)."""
    bends = [curvature(luminance, [*site], grid) for _, *site in places]
    doubt: FloatArray = np.sqrt(np.mean(np.square(bends), axis=0)) * np.float32(_DOUBT)
    return doubt


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
    doubt = doubt_of(luminance, places, grid)
    channels: IndexArray = np.array([channel for channel, *_ in places], np.intp)
    variance = np.full_like(light, sigma**2)
    near, gamma = nearness(mosaic.pattern, _FILLED), np.array(mosaic.calibration.gamma)
    solved = chromaticity.copy()
    kernels.solve_jointly(light, gathered(signal, places), doubt, variance, channels, near, mismatch, gamma, _ROUNDS, solved)
    return solved


def settle_luminance(
    luminance: FloatArray, blocks: FloatArray, sites: SiteSamples, gamma: tuple[float, ...], settings: SiteSettings
) -> FloatArray:
    """l[n], float32 (H, W), with the most probable error of luminance at the colour sites taken off.

    blocks: chromaticity of every block of the grid, (block rows, block columns, C).
    """
    if not settings.corrected:
        return luminance
    weights = np.array(gamma, np.float32)
    whole = blocks[sites.grid.inside].reshape(*sites.trusted.shape, -1) * weights
    colour = np.stack([whole[..., channel] for channel, *_ in sites.places], axis=2)
    missed = (sites.samples * weights[sites.channels] - colour * gathered(luminance, sites.places)) * sites.trusted[..., None]
    error = missed.astype(np.float32, copy=False)
    delta, _ = most_probable(error, colour, sites, slice(None), weights, settings)
    settled = luminance.copy()
    for site, (_, rows, columns) in enumerate(sites.places):
        settled[rows, columns] += delta[..., site]
    return settled


def most_probable(
    error: FloatArray, colour: FloatArray, sites: SiteSamples, rows: slice, gamma: FloatArray, settings: SiteSettings
) -> tuple[FloatArray, FloatArray]:
    """The most probable errors at the sites of these rows of blocks: of luminance, (rows, columns, S), and of colour, (…, S, C).

    error: sample minus picture, times gamma, (rows, columns, S).
    colour: share of luminance in the channel of each site, (rows, columns, S).
    """
    variance = sites.scaled_variance(gamma, rows)
    power = signal_power(error, None if variance is None else variance.mean(axis=2), settings.deviations)
    share = np.square(colour).mean(axis=2)
    # Luminance is wrong by its doubt, but not by more than the errors show; the rest of these, or a part at least, is colour.
    doubt = np.minimum(np.square(sites.doubt[rows]), power / np.maximum(share, _LEAST_SHARE))
    tint = np.maximum(power - doubt * share, np.float32(_TINT) * power) / np.float32(1 - 1 / len(gamma))
    noise = np.zeros_like(error) if variance is None else variance
    light, tints = np.empty_like(error), np.empty((*error.shape, len(gamma)), np.float32)
    kernels.share_out(error, colour, doubt, tint, noise, sites.channels, nearness(sites.pattern), light, tints)
    return light, tints


def signal_power(error: FloatArray, variance: FloatArray | None, deviations: float) -> FloatArray:
    """Mean square of `error`, (rows, columns, S), around each block, without what noise accounts for: float32 (rows, columns).

    variance: of the noise, (rows, columns); None = no noise. deviations: multiple of it that is taken off.
    """
    power = smoothed(np.square(error).mean(axis=2), _WIDTH)
    if variance is not None:
        power = np.maximum(power - np.float32(deviations) * variance, 0)
    result: FloatArray = power.astype(np.float32, copy=False)
    return result


def correct_sites(part: Part, sites: SiteSamples, gamma: tuple[float, ...], settings: SiteSettings) -> Part:
    """The part of a picture with the errors at its colour sites shared out; only rows `sites.reach` inside the part are final.

    gamma: (C,), the weights of Eq. 7.
    """
    rows = sites.within(part)
    if not settings.corrected or rows.start >= rows.stop:
        return part
    weights, places = np.array(gamma, np.float32), sites.inside(part, rows)
    shares = np.stack([part.chromaticity[*place] * weights for _, *place in places], axis=2)  # (rows, columns, S, C)
    colour = np.stack([shares[:, :, site, channel] for site, channel in enumerate(sites.channels)], axis=2)
    light, tints = most_probable(sites.error(part, weights, rows), colour, sites, rows, weights, settings)
    if sites.kept is not None:
        light *= sites.kept[rows, :, None]
        tints *= sites.kept[rows, :, None, None]
    luminance, chromaticity = part.luminance.copy(), part.chromaticity.copy()
    for site, (_, *place) in enumerate(places):
        before = luminance[*place]
        after = before + light[..., site]
        lit = ((after > DARK) & (before > DARK))[..., None]
        # Colour that luminance gains has the chromaticity that was there; tints leave luminance as it is.
        tinted = chromaticity[*place] + tints[:, :, site] / (weights * np.where(lit, after[..., None], 1))
        luminance[*place] = np.where(lit[..., 0], after, before)
        chromaticity[*place] = np.where(lit, tinted, chromaticity[*place])
    return Part(part.first, luminance, chromaticity)
