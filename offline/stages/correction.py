"""Errors at the colour sites, from the samples of each block: MAP updates of luminance, and of the
finished picture.

Luminance under the colour sites is filled in. Let d_s be its error at site s, and w_s = gamma_c c_c
the share of luminance in the channel c of that site, by the picture. The residual of the picture
there, gamma_c (sample - picture), is

    e_s = w_s d_s + t_s,c + noise of variance v_s,

where t is the error of colour in every channel, which leaves luminance as it is.

In Eqs. 8-9 errors are independent and equal. Here they are Gaussian and correlated, because a
stroke or an edge that passes through one site passes near the others: R_st = 0.35 to the power of
the distance in pixels. With C channels and P_st = [c_s = c_t] - 1 / C,

    cov d = D R,  cov e = R o (D w w^T + T P) + diag v,  x = (cov e)^-1 e,
    E[d | e] = D R (w o x),  E[t_s,i | e] = T sum_t R_st ([c_t = i] - 1 / C) x_t.

The variances follow from the mean power of the residuals around a block, M = max(<mean e^2> - 2
mean v, 0), and the error of filling f, a multiple of luminance's curvature at the block, or of that
around it where that is larger: D = min(f^2, M / q) with q = mean w^2, and T = max(M - D q, M / 2)
C / (C - 1). Where luminance is flat, as at an edge between two colours of one brightness, all of M
is colour. Where there is noise, M is no more than what a block's own residuals show beyond it,
max(mean e^2 - 1.5 mean v, 0). Where luminance is flat as well, one sample that is off by four
deviations would pass for colour: with F = v / (v + 1000 f^2 q), 3 F v more are taken off the power
around a block, and 4 F v off its own. Where the lines of blocks are known, w is what a unit of
luminance adds on them.

- `update_luminance`: E[d | e] for the chromaticities of the blocks, before colour is spread.
- `Correction`: E[d | e] and E[t | e] for the finished picture, added to all channels of all sites.

Neither is in the paper. Any pattern will do.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...shared.arrays import FloatArray
from ...shared.site_errors import nearness
from ..bands import DARK, Band, Halo, RowStage
from ..frame import Frame, curvature, mean_of_sites
from ..numerics.arrays import Doubles1, Doubles2, Floats2, Floats3, Floats4
from ..numerics.chunks import BLOCK_ROWS, in_strips
from ..numerics.compile import ZERO, Chunks, kernel, parallel_kernel
from ..numerics.gaussian import gaussian, smoothed

# Chosen on photographs. Error of filled luminance as a multiple of its curvature; pooling has a
# setting of its own
_CURVED = 0.7
_TINT = 0.5  # fraction of the power of residuals that is colour at least
# multiples of the noise variance that are taken off the power of residuals, around a block and its
# own: a dark, even place beside strokes would take its noise for their errors
_DEVIATIONS, _OWN_DEVIATIONS = 2.0, 1.5
# as many more where luminance is flat; and of the power of its curvature, relative to the noise
_FLAT, _OWN_FLAT, _CURVATURE = np.float32(3), np.float32(4), np.float32(1000)
# blocks: standard deviation of the neighbourhood over which their power is averaged
_WIDTH = 0.7
_LEAST_SHARE, _LEAST_POWER = 1e-6, np.float32(1e-30)  # keep quotients finite
_RIDGE = 1e-6  # of D + T, added to v: equations can be solved where one error explains all sites


def fill_error(frame: Frame) -> FloatArray:
    """Return f, the error of filled luminance in each whole block, scene units, float32 (rows,
    columns).
    """
    error = np.empty(frame.sites.shape, np.float32)

    def work(rows: slice) -> None:
        bends = [curvature(frame.luminance, place, frame.grid) for place in frame.sites.at(rows)]
        error[rows] = np.sqrt(np.mean(np.square(bends), axis=0)) * np.float32(_CURVED)

    in_strips(work, len(error), BLOCK_ROWS)
    return error


def update_luminance(frame: Frame) -> FloatArray:
    """Return the luminance of a frame, float32 (H, W), with its expected error at the colour sites
    added.
    """
    updated, unclipped = frame.luminance.copy(), frame.unclipped
    height, reach = len(unclipped), len(gaussian(_WIDTH)) // 2

    def work(inner: slice) -> None:
        rows = slice(max(inner.start - reach, 0), min(inner.stop + reach, height))
        error, weight = _block_residuals(frame, rows)
        error *= unclipped[rows, :, None]
        delta = estimate_errors(error, weight, frame, rows)[0][inner.start - rows.start :]
        for site, place in enumerate(frame.sites.at(inner)):
            updated[place] += delta[: inner.stop - inner.start, :, site]

    in_strips(work, height, 2 * BLOCK_ROWS)  # some rows are computed twice
    return updated


def _block_residuals(frame: Frame, rows: slice) -> tuple[FloatArray, FloatArray]:
    """Return e and w, float32 (rows, columns, S), by the chromaticities of blocks, and by their
    lines where these are known: c l + s (l - l_j), w = c + s.
    """
    sites, gamma = frame.sites, frame.gamma32
    filled, weight = sites.in_rows(frame.luminance, rows), frame.blocks[frame.grid.whole][rows]
    error = sites.in_rows(frame.signal, rows) * gamma[sites.channels]
    if frame.lines.size:
        lines, channels = frame.lines[frame.grid.whole][rows], len(gamma)
        weight, level, _ = np.split(lines, [channels, 2 * channels], axis=2)
        error = error + np.take(level * gamma, sites.channels, axis=2)
    weight = np.take(weight * gamma, sites.channels, axis=2)
    error = error - weight * filled
    return error.astype(np.float32, copy=False), weight


def estimate_errors(
    error: FloatArray, weight: FloatArray, frame: Frame, rows: slice
) -> tuple[FloatArray, FloatArray]:
    """Return E[d | e], float32 (rows, columns, S), and E[t | e], (rows, columns, S, C), at the
    sites of these rows of blocks.

    Parameters
    ----------
    error, weight : FloatArray
        e and w, (rows, columns, S).
    """
    sites, variance, count = frame.sites, frame.scaled_variance(rows), len(frame.gamma)
    own = mean_of_sites(error, error)
    mean = smoothed(own, _WIDTH)  # M
    share = mean_of_sites(weight, weight)  # q
    bent = np.square(frame.fill_error[rows])
    # a site where luminance happens to be even tells little of the strokes around it
    bent = np.maximum(bent, smoothed(bent, _WIDTH))
    if variance is not None:
        of_noise = mean_of_sites(variance)
        flat = of_noise / (of_noise + _CURVATURE * bent * share + _LEAST_POWER)
        around = mean - (np.float32(_DEVIATIONS) + _FLAT * flat) * of_noise
        beyond = own - (np.float32(_OWN_DEVIATIONS) + _OWN_FLAT * flat) * of_noise
        mean = np.maximum(np.minimum(around, beyond), 0)
    mean = mean.astype(np.float32, copy=False)
    of_filled = np.minimum(bent, mean / np.maximum(share, _LEAST_SHARE))
    of_colour = np.maximum(mean - of_filled * share, np.float32(_TINT) * mean)
    of_colour /= np.float32(1 - 1 / count)
    noise = np.zeros_like(error) if variance is None else np.ascontiguousarray(variance, np.float32)
    change, tints = np.empty_like(error), np.empty((*error.shape, count), np.float32)
    aside = (sites.channels[:, None] == np.arange(count)) - 1 / count
    correlation = nearness(sites.pattern), aside @ aside.T, aside
    given = SiteErrors(error, weight, noise, of_filled, of_colour, *correlation)
    posterior_means(given, change, tints)
    return change, tints


class SiteErrors(NamedTuple):
    """Residuals and what is known of them.

    Attributes
    ----------
    error, weight, noise : Floats3
        e, w and v, (rows, columns, S).
    luminance, colour : Floats2
        D and T, (rows, columns).
    near, alike : Doubles2
        R and P, (S, S).
    aside : Doubles2
        [c_s = i] - 1 / C, (S, C).
    """

    error: Floats3
    weight: Floats3
    noise: Floats3
    luminance: Floats2
    colour: Floats2
    near: Doubles2
    alike: Doubles2
    aside: Doubles2


@parallel_kernel()
def posterior_means(chunks: Chunks, given: SiteErrors, change: Floats3, tints: Floats4) -> None:
    """Compute E[d | e], (rows, columns, S), and E[t | e], (rows, columns, S, C)."""
    near, alike, aside = given.near, given.alike, given.aside
    (_, columns, count), channels = change.shape, aside.shape[1]
    covariance, solution = np.empty((count, count)), np.empty(count)
    for row in range(chunks[0], chunks[1]):
        for column in range(columns):
            of_filled = np.float64(given.luminance[row, column])
            of_colour = np.float64(given.colour[row, column])
            weight, uncertain = given.weight[row, column], of_filled + of_colour
            ridge = _RIDGE * uncertain if uncertain > 0 else 1.0
            for s in range(count):
                solution[s] = given.error[row, column, s]
                for t in range(count):
                    both = max(weight[s], ZERO) * np.float64(max(weight[t], ZERO))
                    covariance[s, t] = near[s, t] * (of_filled * both + of_colour * alike[s, t])
                covariance[s, s] += given.noise[row, column, s] + ridge
            _solve(covariance, solution)
            for s in range(count):
                of_site = 0.0
                for t in range(count):
                    of_site += near[s, t] * max(weight[t], ZERO) * solution[t]
                change[row, column, s] = of_filled * of_site
                for channel in range(channels):
                    of_site = 0.0
                    for t in range(count):
                        of_site += near[s, t] * aside[t, channel] * solution[t]
                    tints[row, column, s, channel] = of_colour * of_site


@kernel
def _solve(matrix: Doubles2, right: Doubles1) -> None:
    """Solve matrix x = right, positive definite, (S, S) and (S,), by elimination; both are
    overwritten, `right` by x.
    """
    size = len(right)
    for row in range(size):
        for below in range(row + 1, size):
            factor = matrix[row, below] / matrix[row, row]
            for column in range(below, size):
                matrix[below, column] -= factor * matrix[row, column]
            right[below] -= factor * right[row]
    for row in range(size - 1, -1, -1):
        for other in range(row + 1, size):
            right[row] -= matrix[row, other] * right[other]
        right[row] /= matrix[row, row]


@dataclass(eq=False)
class SiteResidual(RowStage):
    """Measure the residuals of the picture at the colour sites (`Band.residual`)."""

    frame: Frame

    name = "residual"

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows, with their residual."""
        picture, frame, sites = band.rows(*rows), self.frame, self.frame.sites
        residual = np.zeros(picture.luminance.shape, np.float32)
        for channel, (down, across) in zip(sites.channels, sites.places, strict=True):
            # rows of blocks
            before = [-(-(row - down.start) // down.step) for row in rows]
            first, end = np.clip(before, 0, sites.shape[0]).tolist()
            place = slice(down.start + first * down.step - rows[0], None, down.step), across
            lit = picture.luminance[place][: end - first]
            colour = picture.chromaticity[place][: end - first, :, channel] * lit
            error = (frame.signal[down, across][first:end] - colour) * frame.gamma32[channel]
            residual[place][: end - first] = error * frame.unclipped[first:end]
        return replace(picture, residual=residual)


@dataclass(eq=False)
class Correction(RowStage):
    """Add the expected errors of luminance and colour at the sites of all whole blocks."""

    frame: Frame

    name = "correction"

    @property
    def halo(self) -> Halo:
        """The blocks around a site."""
        return Halo((len(gaussian(_WIDTH)) // 2 + 1) * self.frame.grid.period)

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows, corrected."""
        frame, sites, gamma = self.frame, self.frame.sites, self.frame.gamma32
        blocks = sites.within(band)
        if blocks.start >= blocks.stop:
            return band.rows(*rows)
        places = sites.at(blocks, band.first)
        sited = zip(places, sites.channels, strict=True)
        colours = [band.chromaticity[at][..., channel] * gamma[channel] for at, channel in sited]
        error, weight = sites.residual(band, blocks), np.stack(colours, axis=2)
        along = None  # what a unit of luminance adds to each channel, on the lines of blocks
        if frame.lines.size:
            along = frame.lines[frame.grid.whole][blocks, :, : len(gamma)]
            weight = np.take(along * gamma, sites.channels, axis=2)
        change, tints = estimate_errors(error, weight, frame, blocks)
        if frame.kept is not None:
            tints *= frame.kept[blocks, :, None, None]
        luminance, chromaticity = band.luminance.copy(), band.chromaticity.copy()
        for site, place in enumerate(places):
            before, after = luminance[place], luminance[place] + change[..., site]
            # what is not a number is to be seen, and refused
            lit = ~((after <= DARK) | (before <= DARK))
            luminance[place] = np.where(lit, after, before)
            # Colour that luminance gains has the chromaticity that was there, or is on the line of
            # the block; tints leave luminance as it is.
            share = lit / np.where(lit, after, np.float32(1))
            if along is not None:
                gained = (share * change[..., site])[..., None]
                chromaticity[place] += (along - chromaticity[place]) * gained
            for channel, weight in enumerate(gamma):
                chromaticity[place][..., channel] += tints[..., site, channel] * (share / weight)
        return replace(band, luminance=luminance, chromaticity=chromaticity).rows(*rows)
