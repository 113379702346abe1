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

from shared.arrays import BoolArray, DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.site_errors import nearness

from .blocks import Sites, curvature
from .cleaned import Cleaned, unclipped_blocks
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
class BlockSamples:
    """What the B = (rows, columns) whole blocks of a frame measured with their S sites, and how sure that is.

    sites: where they are.
    samples: float32 (*B, S), scene units, defects mended and highlights restored.
    noise: of the samples; None = there is none, or it is unknown.
    unclipped: bool B, blocks without a sample at the sensor's limit in them or next to them.
    fill_error: standard deviation of the error of filled luminance, float32 B, scene units.
    kept: share of what the samples miss that `correct_sites` corrects, float32 B, 0 to 1; None = all of it. A burst corrects the
        rest itself, with the samples of all frames.
    """

    sites: Sites
    samples: FloatArray
    noise: NoiseModel | None
    unclipped: BoolArray
    fill_error: FloatArray
    kept: FloatArray | None = None

    @property
    def reach(self) -> int:
        """How many rows above and below a site its correction depends on."""
        return site_reach(self.sites.grid.period)

    def within(self, part: Part) -> slice:
        """The rows of blocks that lie wholly inside a part of the picture."""
        grid = self.sites.grid
        first = grid.whole_rows - part.first
        inside = np.flatnonzero((first >= 0) & (first + grid.block_shape[0] <= len(part.luminance)))
        return slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)

    def inside(self, part: Part, rows: slice) -> list[tuple[int, slice, slice]]:
        """Channel of each site, and where it is in these rows of blocks, in a part of the picture."""
        period, count = self.sites.grid.period, rows.stop - rows.start
        first = [place.start + rows.start * period - part.first for place, _ in self.sites.places]
        return [
            (int(channel), slice(start, start + (count - 1) * period + 1, period), columns)
            for channel, start, (_, columns) in zip(self.sites.channels, first, self.sites.places, strict=True)
        ]

    def error(self, part: Part, gamma: FloatArray, rows: slice) -> FloatArray:
        """Sample minus picture at each site, times gamma (so that all channels have the unit of luminance); 0 beside clipping."""
        found = np.empty((rows.stop - rows.start, *self.samples.shape[1:]), np.float32)
        for site, (channel, *place) in enumerate(self.inside(part, rows)):
            seen = part.chromaticity[*place][..., channel] * part.luminance[*place]
            found[..., site] = (self.samples[rows, :, site] - seen) * gamma[channel]
        return found * self.unclipped[rows, :, None]

    def scaled_variance(self, gamma: FloatArray, rows: slice) -> FloatArray | None:
        """Variance of the noise in `error`, float32 (rows, columns, S); None = no noise."""
        if self.noise is None or not self.noise.of_colours:
            return None
        return self.noise.variance(self.samples[rows], self.sites.channels) * gamma[self.sites.channels] ** 2


def site_reach(period: int) -> int:
    """How many rows above and below a site its correction depends on. period: K, pixels."""
    return (len(gaussian(_WIDTH)) // 2 + 1) * period


def block_samples(frame: Cleaned, luminance: FloatArray, alone: FloatArray | None = None) -> BlockSamples:
    """The samples of all whole blocks.

    luminance: (H, W), filled in, scene units.
    alone: how far no other frame of a burst measures luminance at the sites, 0 to 1, (rows, columns); None = there is no other.
    """
    error = fill_error(luminance, frame.sites)
    if alone is not None:
        error = error * alone
    return BlockSamples(frame.sites, frame.sites.of(frame.signal), frame.noise, unclipped_blocks(frame), error, alone)


def fill_error(luminance: FloatArray, sites: Sites) -> FloatArray:
    """Standard deviation of the error of filled luminance in each whole block, scene units, float32 (rows, columns)."""
    bends = [curvature(luminance, place, sites.grid) for place in sites.places]
    error: FloatArray = np.sqrt(np.mean(np.square(bends), axis=0)) * np.float32(_DOUBT)
    return error


def solve_jointly(frame: Cleaned, luminance: FloatArray, chromaticity: DoubleArray, sigma: float, mismatch: float) -> DoubleArray:
    """Chromaticities of the whole blocks, float64 (rows, columns, C), by generalised least squares; sum_i gamma_i c_i = 1.

    luminance: (H, W), scene units.
    chromaticity: the solution of Eqs. 8-9, where the first round takes its covariance from.
    sigma: sigma_z of these equations, > 0.
    mismatch: variance that differs from site to site, relative to that of luminance's error.
    """
    sites = frame.sites
    light, error = sites.of(luminance), fill_error(luminance, sites)
    variance = np.full_like(light, sigma**2)
    near, solved = nearness(sites.pattern, _FILLED), chromaticity.copy()
    samples = sites.of(frame.signal)
    kernels.solve_jointly(light, samples, error, variance, sites.channels, near, mismatch, frame.gamma, _ROUNDS, solved)
    return solved


def settle_luminance(
    luminance: FloatArray, blocks: FloatArray, measured: BlockSamples, gamma: tuple[float, ...], settings: SiteSettings
) -> FloatArray:
    """l[n], float32 (H, W), with the most probable error of luminance at the colour sites taken off.

    blocks: chromaticity of every block of the grid, (block rows, block columns, C).
    """
    if not settings.corrected:
        return luminance
    weights, sites = np.array(gamma, np.float32), measured.sites
    colour = np.take(sites.whole(blocks) * weights, sites.channels, axis=2)
    missed = (measured.samples * weights[sites.channels] - colour * sites.of(luminance)) * measured.unclipped[..., None]
    delta, _ = most_probable(missed.astype(np.float32, copy=False), colour, measured, slice(None), weights, settings)
    settled = luminance.copy()
    for site, place in enumerate(sites.places):
        settled[place] += delta[..., site]
    return settled


def most_probable(
    error: FloatArray, colour: FloatArray, measured: BlockSamples, rows: slice, gamma: FloatArray, settings: SiteSettings
) -> tuple[FloatArray, FloatArray]:
    """The most probable errors at the sites of these rows of blocks: of luminance, (rows, columns, S), and of colour, (…, S, C).

    error: sample minus picture, times gamma, (rows, columns, S).
    colour: share of luminance in the channel of each site, (rows, columns, S).
    """
    sites, variance = measured.sites, measured.scaled_variance(gamma, rows)
    power = signal_power(error, None if variance is None else variance.mean(axis=2), settings.deviations)
    share = np.square(colour).mean(axis=2)
    # Luminance is wrong by its doubt, but not by more than the errors show; the rest of these, or a part at least, is colour.
    doubt = np.minimum(np.square(measured.fill_error[rows]), power / np.maximum(share, _LEAST_SHARE))
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


def correct_sites(part: Part, measured: BlockSamples, gamma: tuple[float, ...], settings: SiteSettings) -> Part:
    """The part of a picture with the errors at its colour sites shared out; only rows `measured.reach` inside the part are final.

    gamma: (C,), the weights of Eq. 7.
    """
    rows = measured.within(part)
    if not settings.corrected or rows.start >= rows.stop:
        return part
    weights, places = np.array(gamma, np.float32), measured.inside(part, rows)
    shares = np.stack([part.chromaticity[*place] * weights for _, *place in places], axis=2)  # (rows, columns, S, C)
    colour = np.stack([shares[:, :, site, channel] for site, (channel, *_) in enumerate(places)], axis=2)
    light, tints = most_probable(measured.error(part, weights, rows), colour, measured, rows, weights, settings)
    if measured.kept is not None:
        light *= measured.kept[rows, :, None]
        tints *= measured.kept[rows, :, None, None]
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
