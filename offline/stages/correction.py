"""Errors at the colour sites, from the samples of each block: MAP updates of luminance, and of the finished picture.

Luminance under the colour sites is filled in. Let d_s be its error at site s, and w_s = gamma_c c_c the share of luminance in the
channel c of that site, by the picture. The residual of the picture there, gamma_c (sample - picture), is

    e_s = w_s d_s + t_s,c + noise of variance v_s,      t: error of colour in every channel, which leaves luminance as it is

In Eqs. 8-9 errors are independent and equal. Here they are Gaussian and correlated, because a stroke or an edge that passes through
one site passes near the others: R_st = 0.35 to the power of the distance in pixels. With C channels and P_st = [c_s = c_t] - 1 / C,

    cov d = D R,  cov e = R o (D w w^T + T P) + diag v,  x = (cov e)^-1 e,
    E[d | e] = D R (w o x),  E[t_s,i | e] = T sum_t R_st ([c_t = i] - 1 / C) x_t.

The variances follow from the mean power of the residuals around a block, M = max(<mean e^2> - 2 mean v, 0), and the error of
filling f, a multiple of luminance's curvature: D = min(f^2, M / q) with q = mean w^2, and T = max(M - D q, M / 2) C / (C - 1).
Where luminance is flat, as at an edge between two colours of one brightness, all of M is colour. With a colour line of confidence
p, which says what colour is, D moves to M / q and T to 0 by p.

- `settle_luminance`: E[d | e] for the chromaticities of the blocks, before colour is spread.
- `Correction`: E[d | e] and E[t | e] for the finished picture, added to all channels of all sites.

Neither is in the paper. Any pattern will do.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...shared.arrays import DoubleArray, FloatArray
from ...shared.site_errors import nearness
from ..frame import Cleaned, Sites, curvature, unclipped_blocks
from ..measured import EVEN, BlockSamples
from ..numerics.gaussian import gaussian, smoothed
from ..numerics.pieces import BLOCK_ROWS, copied, in_strips
from ..parts import DARK, Look, Part, RowStage
from ..stage import Switch


@dataclass(frozen=True)
class SettlingSettings(Switch):
    """Update of luminance at the colour sites once the colour of blocks is known; not in the paper."""

    kernels = ("smooth",)


# Chosen on photographs; in brackets, by how many decibels half or twice changes the case that it changes most (README).
_CURVED = 0.7  # error of filled luminance as a multiple of its curvature (0.4); pooling has a setting of its own
_TINT = 0.5  # fraction of the power of residuals that is colour at least (0.3)
_DOUBT = 0.1  # least fraction of it on a line: dark channels do not show luminance; 0.01 makes speckles 5 times white
_DEVIATIONS = 2.0  # multiple of the noise variance that is taken off the power of residuals (0.4)
_WIDTH = 0.7  # blocks: standard deviation of the neighbourhood over which their power is averaged (0.3)
_LEAST_SHARE, _LEAST_POWER = 1e-6, 1e-30  # keep quotients finite
_LEAST = 1e-6  # of D + T, added to v: equations can be solved where one error explains all sites


def site_reach(period: int) -> int:
    """Return the number of rows above and below a site that its correction depends on. period: K, pixels."""
    return (len(gaussian(_WIDTH)) // 2 + 1) * period


def block_samples(frame: Cleaned, luminance: FloatArray, alone: FloatArray | None = None) -> BlockSamples:
    """Return the samples of all whole blocks.

    luminance: (H, W), filled in, scene units.
    alone: how far no other frame of a burst measures luminance at the sites, 0 to 1, (rows, columns); None = there is no other.
    """
    error = fill_error(luminance, frame.sites)
    if alone is not None:
        error = error * alone
    return BlockSamples(frame.sites, frame.sites.of(frame.signal), frame.noise, unclipped_blocks(frame), error, alone)


def fill_error(luminance: FloatArray, sites: Sites) -> FloatArray:
    """Return f, the error of filled luminance in each whole block, scene units, float32 (rows, columns)."""
    error = np.empty(sites.shape, np.float32)

    def work(rows: slice) -> None:
        bends = [curvature(luminance, place, sites.grid) for place in sites.at(rows)]
        error[rows] = np.sqrt(np.mean(np.square(bends), axis=0)) * np.float32(_CURVED)

    in_strips(work, len(error), BLOCK_ROWS)
    return error


def settle_luminance(
    luminance: FloatArray, blocks: FloatArray, measured: BlockSamples, gamma: FloatArray, settings: Switch
) -> FloatArray:
    """Return luminance, float32 (H, W), with its expected error at the colour sites added.

    blocks: chromaticity of every block of the grid, (block rows, block columns, C).
    gamma: (C,), the weights of Eq. 7.
    """
    if not settings.used:
        return luminance
    settled, height = copied(luminance), measured.sites.shape[0]
    reach = len(gaussian(_WIDTH)) // 2

    def work(inner: slice) -> None:
        rows = slice(max(inner.start - reach, 0), min(inner.stop + reach, height))
        error, weight = _block_residuals(luminance, blocks, measured, rows, gamma)
        delta = expected_errors(error, weight, measured, rows, gamma)[0][inner.start - rows.start :]
        for site, place in enumerate(measured.sites.at(inner)):
            at_site = settled[place]
            at_site += delta[: len(at_site), :, site]

    in_strips(work, height, 2 * BLOCK_ROWS)  # some rows are computed twice
    return settled


def _block_residuals(
    luminance: FloatArray, blocks: FloatArray, measured: BlockSamples, rows: slice, gamma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return e and w, float32 (rows, columns, S), by the chromaticities of blocks, and by colour lines as far as these count."""
    sites = measured.sites
    light = np.stack([luminance[place] for place in sites.at(rows)], axis=2)
    weight = np.take(sites.whole(blocks)[rows] * gamma, sites.channels, axis=2)
    picture = weight * light
    if (lines := measured.lines) is not None:
        offset, slope = (np.moveaxis(plane[:, rows][sites.channels], 0, 2) for plane in (lines.offset, lines.slope))
        apart, least = offset + slope * light - picture, np.square(np.float32(EVEN) * light).mean(axis=2)
        far = np.maximum(np.square(apart).mean(axis=2), np.maximum(least, np.float32(_LEAST_POWER)))
        share = (lines.share[rows] * (1 - least / far))[..., None]
        picture += share * apart
        weight += share * (slope - weight)
    error = (measured.samples[rows] * gamma[sites.channels] - picture) * measured.unclipped[rows, :, None]
    return error.astype(np.float32, copy=False), weight


def signal_power(error: FloatArray, variance: FloatArray | None) -> FloatArray:
    """Return M, the mean square of residuals, (rows, columns, S), around each block beyond the noise: float32 (rows, columns).

    variance: of the noise, (rows, columns); None = no noise.
    """
    power = smoothed(np.square(error).mean(axis=2), _WIDTH)
    if variance is not None:
        power = np.maximum(power - np.float32(_DEVIATIONS) * variance, 0)
    return power.astype(np.float32, copy=False)


def expected_errors(
    error: FloatArray, weight: FloatArray, measured: BlockSamples, rows: slice, gamma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return E[d | e], float32 (rows, columns, S), and E[t | e], (rows, columns, S, C), at the sites of these rows of blocks.

    error, weight: e and w, (rows, columns, S).
    """
    sites, variance = measured.sites, measured.scaled_variance(gamma, rows)
    power = signal_power(error, None if variance is None else variance.mean(axis=2))
    near, aside = nearness(sites.pattern), (sites.channels[:, None] == np.arange(len(gamma))) - 1 / len(gamma)
    light, tints = np.empty_like(error), np.empty((*error.shape, len(gamma)), np.float32)

    def work(part: slice) -> None:
        share, mean = np.square(weight[part]).mean(axis=2), power[part]
        most = mean / np.maximum(share, _LEAST_SHARE)
        of_light = np.minimum(np.square(measured.fill_error[rows][part]), most)
        of_colour = np.maximum(mean - of_light * share, np.float32(_TINT) * mean) / np.float32(1 - 1 / len(gamma))
        if measured.lines is not None:
            confidence = measured.lines.share[rows][part]
            of_colour *= np.maximum(1 - confidence, np.float32(_DOUBT))
            of_light += confidence * (most - of_light)
        noise = None if variance is None else _sites_first(variance[part])
        prior = _Prior(of_light.ravel().astype(np.float64), of_colour.ravel().astype(np.float64), near, aside)
        expected = prior.posterior(_sites_first(error[part]), np.maximum(_sites_first(weight[part]), 0), noise)
        for plane, values in zip((light, tints), expected, strict=True):
            plane[part] = np.moveaxis(values, -1, 0).reshape(plane[part].shape)

    in_strips(work, len(error), BLOCK_ROWS)
    return light, tints


def _sites_first(values: FloatArray) -> DoubleArray:
    """Return (rows, columns, S) as (S, blocks)."""
    return np.ascontiguousarray(np.moveaxis(values.reshape(-1, values.shape[2]), 1, 0), np.float64)


@dataclass(frozen=True, eq=False)
class _Prior:
    """Covariances of n blocks. light, colour: D and T, (n,). near: R, (S, S). aside: [c_s = i] - 1 / C, (S, C)."""

    light: DoubleArray
    colour: DoubleArray
    near: DoubleArray
    aside: DoubleArray

    def posterior(self, error: DoubleArray, weight: DoubleArray, noise: DoubleArray | None) -> tuple[DoubleArray, DoubleArray]:
        """Return E[d | e], (S, n), and E[t | e], (S, C, n). error, weight, noise: e, w and v, (S, n)."""
        size, uncertain = len(error), self.light + self.colour
        covariance = self.light * weight[:, None] * weight + self.colour * (self.aside @ self.aside.T)[..., None]
        covariance *= self.near[..., None]
        covariance[range(size), range(size)] += np.where(uncertain > 0, _LEAST * uncertain, 1) + (0 if noise is None else noise)
        solution = _solved(covariance, error)
        light, colour = np.zeros_like(error), np.zeros((*self.aside.shape, error.shape[1]))
        for site, value in enumerate(solution):  # not a product of matrices: its sums may depend on a block's place
            light += self.near[:, site, None] * (weight[site] * value)
            colour += self.near[:, site, None, None] * (self.aside[site, :, None] * value)
        return light * self.light, colour * self.colour


def _solved(matrix: DoubleArray, right: DoubleArray) -> DoubleArray:
    """Return x, (S, n), of n systems matrix x = right, positive definite, (S, S, n) and (S, n), which are overwritten."""
    size = len(right)
    for row in range(size):
        for below in range(row + 1, size):
            factor = matrix[row, below] / matrix[row, row]
            matrix[below, below:] -= factor * matrix[row, below:]
            right[below] -= factor * right[row]
    for row in reversed(range(size)):
        for other in range(row + 1, size):
            right[row] -= matrix[row, other] * right[other]
        right[row] /= matrix[row, row]
    return right


@dataclass(eq=False)
class Missed(RowStage):
    """Measure the residuals of the picture at the colour sites (`Part.missed`). gamma: (C,), the weights of Eq. 7."""

    samples: BlockSamples
    gamma: FloatArray

    name = "missed"

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, with what they miss."""
        picture, sites = part.rows(*rows), self.samples.sites
        missed = np.zeros(picture.luminance.shape, np.float32)
        for site, (channel, (down, across)) in enumerate(zip(sites.channels, sites.places, strict=True)):
            first, end = (min(max(-(-(row - down.start) // down.step), 0), sites.shape[0]) for row in rows)  # rows of blocks
            place = slice(down.start + first * down.step - rows[0], None, down.step), across
            colour = picture.chromaticity[place][: end - first, :, channel] * picture.luminance[place][: end - first]
            error = (self.samples.samples[first:end, :, site] - colour) * self.gamma[channel]
            missed[place][: end - first] = error * self.samples.unclipped[first:end]
        return replace(picture, missed=missed)


@dataclass(eq=False)
class Correction(RowStage):
    """Add the expected errors of luminance and colour at the sites of all whole blocks. gamma: (C,), the weights of Eq. 7."""

    samples: BlockSamples
    gamma: FloatArray

    name = "correction"
    kernels = ("smooth",)

    @property
    def look(self) -> Look:
        """The blocks around a site."""
        return Look(site_reach(self.samples.sites.grid.period))

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, corrected."""
        blocks, gamma = self.samples.within(part), self.gamma
        if blocks.start >= blocks.stop:
            return part.rows(*rows)
        places, channels = self.samples.inside(part, blocks), self.samples.sites.channels
        colours = [part.chromaticity[place][..., channel] * gamma[channel] for place, channel in zip(places, channels, strict=True)]
        error = self.samples.missed(part, blocks)
        light, tints = expected_errors(error, np.stack(colours, axis=2), self.samples, blocks, gamma)
        if self.samples.kept is not None:
            tints *= self.samples.kept[blocks, :, None, None]
        luminance, chromaticity = copied(part.luminance), copied(part.chromaticity)
        for site, place in enumerate(places):
            before, after = luminance[place], luminance[place] + light[..., site]
            lit = ~((after <= DARK) | (before <= DARK))  # what is not a number is to be seen, and refused
            # Colour that luminance gains has the chromaticity that was there; tints leave luminance as it is.
            tint = tints[:, :, site] / (gamma * np.where(lit, after, 1)[..., None])
            chromaticity[place] += np.where(lit[..., None], tint, 0)
            luminance[place] = np.where(lit, after, before)
        return replace(part, luminance=luminance, chromaticity=chromaticity).rows(*rows)
