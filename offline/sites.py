"""Errors at the colour sites, from the samples of each block.

Luminance under the colour sites is filled in, and wrong by some delta. A sample is c (l + delta) + noise, with c the chromaticity
of its channel. So one error of luminance shows in all samples of the block, in proportion to c. Eqs. 8-9 take these errors for
independent and equal. Here they have a covariance D R D, with D the diagonal matrix of c, and R falls with the distance between
sites, because a stroke or an edge that passes through one of them passes near the others. To it are added the noise, and what
differs from site to site, because one chromaticity does not describe a whole block.

- `settle_luminance`: given the final chromaticity, delta is what the samples make most probable.
- `rows.correction`: what the finished picture still misses (sample minus picture) is shared out to all channels of all sites of the
  block. Some of it is an error of luminance, as far as luminance is uncertain, and the rest an error of colour, which leaves
  luminance as it is. Where luminance is flat, as at an edge between two colours of one brightness, all of it is colour.

Both are conditional means of a Gaussian model, for any pattern. None is in the paper.
"""

import numpy as np

from shared.arrays import FloatArray
from shared.site_errors import nearness

from .blocks import Sites, curvature
from .cleaned import Cleaned, unclipped_blocks
from .gaussian import gaussian, smoothed
from .kernels.sites import share_out
from .kernels.pieces import BLOCK_ROWS, copied, in_strips
from .measured import EVEN, BlockSamples
from .settings import Switch

FILLED = 0.5
"""Correlation of the errors of filled luminance one pixel apart; half or twice changes 0.2 dB."""
# Chosen on photographs; in brackets, by how many decibels half or twice changes the case that it changes most (README).
_CURVED = 0.7  # error of filled luminance as a multiple of its curvature (0.4); pooling has a setting of its own
_TINT = 0.5  # share of the power of errors that is colour at least (0.3)
_DOUBT = 0.1  # least share of it on a line: samples of a dark channel tell nothing of luminance; 0.01 makes speckle 5 times white
_LEAST_SHARE, _LEAST_POWER = 1e-6, 1e-30  # keep quotients finite
_DEVIATIONS = 2.0  # multiple of the noise variance that is taken off the power of errors (0.4)
_WIDTH = 0.7  # blocks: standard deviation of the neighbourhood over which the power of errors is averaged (0.3)


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
    error = np.empty(sites.shape, np.float32)

    def work(rows: slice) -> None:
        bends = [curvature(luminance, place, sites.grid) for place in sites.at(rows)]
        error[rows] = np.sqrt(np.mean(np.square(bends), axis=0)) * np.float32(_CURVED)

    in_strips(work, len(error), BLOCK_ROWS)
    return error


def settle_luminance(
    luminance: FloatArray, blocks: FloatArray, measured: BlockSamples, gamma: FloatArray, settings: Switch
) -> FloatArray:
    """l[n], float32 (H, W), with the most probable error of luminance at the colour sites taken off.

    blocks: chromaticity of every block of the grid, (block rows, block columns, C).
    gamma: (C,), the weights of Eq. 7.
    """
    if not settings.used:
        return luminance
    settled, height = copied(luminance), measured.sites.shape[0]
    reach = len(gaussian(_WIDTH)) // 2

    def work(inner: slice) -> None:
        rows = slice(max(inner.start - reach, 0), min(inner.stop + reach, height))
        delta = _missing_light(luminance, blocks, measured, rows, gamma)[inner.start - rows.start :]
        for site, place in enumerate(measured.sites.at(inner)):
            at_site = settled[place]
            at_site += delta[: len(at_site), :, site]

    in_strips(work, height, 2 * BLOCK_ROWS)  # some rows are computed twice
    return settled


def _missing_light(luminance: FloatArray, blocks: FloatArray, measured: BlockSamples, rows: slice, gamma: FloatArray) -> FloatArray:
    """The most probable error of luminance at the sites of these rows of blocks, (rows, columns, S); see `settle_luminance`."""
    sites = measured.sites
    light = np.stack([luminance[place] for place in sites.at(rows)], axis=2)
    colour = np.take(sites.whole(blocks)[rows] * gamma, sites.channels, axis=2)
    shown = colour * light
    if (lines := measured.lines) is not None:
        offset, slope = (np.moveaxis(plane[:, rows][sites.channels], 0, 2) for plane in (lines.offset, lines.slope))
        apart, least = offset + slope * light - shown, np.square(np.float32(EVEN) * light).mean(axis=2)
        far = np.maximum(np.square(apart).mean(axis=2), np.maximum(least, np.float32(_LEAST_POWER)))
        share = (lines.share[rows] * (1 - least / far))[..., None]
        shown += share * apart
        colour += share * (slope - colour)
    missed = (measured.samples[rows] * gamma[sites.channels] - shown) * measured.unclipped[rows, :, None]
    return most_probable(missed.astype(np.float32, copy=False), colour, measured, rows, gamma)[0]


def most_probable(
    error: FloatArray, colour: FloatArray, measured: BlockSamples, rows: slice, gamma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The most probable errors at the sites of these rows of blocks: of luminance, (rows, columns, S), and of colour, (…, S, C).

    error: sample minus picture, times gamma, (rows, columns, S).
    colour: share of luminance in the channel of each site, (rows, columns, S).
    """
    sites, variance = measured.sites, measured.scaled_variance(gamma, rows)
    power = signal_power(error, None if variance is None else variance.mean(axis=2))
    near, filled = nearness(sites.pattern), measured.fill_error[rows]
    believed = None if measured.lines is None else measured.lines.share[rows]
    light, tints = np.empty_like(error), np.empty((*error.shape, len(gamma)), np.float32)

    def work(part: slice) -> None:
        share, shown = np.square(colour[part]).mean(axis=2), power[part]
        # Luminance is wrong by the error of filling, but not by more than the errors show; the rest of these, or a part, is colour.
        most = shown / np.maximum(share, _LEAST_SHARE)
        fill_variance = np.minimum(np.square(filled[part]), most)
        tint = np.maximum(shown - fill_variance * share, np.float32(_TINT) * shown) / np.float32(1 - 1 / len(gamma))
        if believed is not None:  # where a line says what colour is, errors are of luminance
            tint *= np.maximum(1 - believed[part], np.float32(_DOUBT))
            fill_variance += believed[part] * (most - fill_variance)
        noise = np.zeros_like(error[part]) if variance is None else variance[part]
        known = error[part], colour[part], fill_variance, tint, noise
        share_out(*known, sites.channels, near, light[part], tints[part])

    in_strips(work, len(error), BLOCK_ROWS // 4)
    return light, tints


def signal_power(error: FloatArray, variance: FloatArray | None) -> FloatArray:
    """Mean square of `error`, (rows, columns, S), around each block, without what noise accounts for: float32 (rows, columns).

    variance: of the noise, (rows, columns); None = no noise.
    """
    power = smoothed(np.square(error).mean(axis=2), _WIDTH)
    if variance is not None:
        power = np.maximum(power - np.float32(_DEVIATIONS) * variance, 0)
    return power.astype(np.float32, copy=False)
