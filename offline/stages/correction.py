"""Errors at the colour sites, from the samples of each block.

Luminance under the colour sites is filled in, and wrong by some delta. A sample is c (l + delta) + noise, with c the chromaticity
of its channel. So one error of luminance shows in all samples of the block, in proportion to c. Eqs. 8-9 take these errors for
independent and equal. Here they have a covariance D R D, with D the diagonal matrix of c, and R falls with the distance between
sites, because a stroke or an edge that passes through one of them passes near the others. To it are added the noise, and what
differs from site to site, because one chromaticity does not describe a whole block.

- `settle_luminance`: given the final chromaticity, delta is what the samples make most probable.
- `Correction`: what the finished picture still misses (sample minus picture) is shared out to all channels of all sites of the
  block. Some of it is an error of luminance, as far as luminance is uncertain, and the rest an error of colour, which leaves
  luminance as it is. Where luminance is flat, as at an edge between two colours of one brightness, all of it is colour.

Both are conditional means of a Gaussian model, for any pattern. None is in the paper.

What the finished picture misses at the colour sites, and its correction (see `offline.sites`).

What the samples of a colour block say about the errors at its sites: small systems of equations, eight blocks in lanes.
"""

from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import FloatArray
from shared.site_errors import nearness

from ..frame import Cleaned, Sites, curvature, unclipped_blocks
from ..measured import EVEN, BlockSamples
from ..numerics.arrays import Doubles2, Doubles3, Floats2, Floats3, Floats4, Ints1
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.gaussian import gaussian, smoothed
from ..numerics.lanes import WIDTH, load, quotient, store, where_less
from ..numerics.pieces import BLOCK_ROWS, copied, in_pieces, in_strips
from ..parts import DARK, Look, Part, RowStage
from ..stage import Switch


@dataclass(frozen=True)
class SettlingSettings(Switch):
    """Correction of luminance at the colour sites once the colour of blocks is known (see `sites`); not in the paper."""

    kernels = "share_out", "smooth"


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


@dataclass(eq=False)
class Missed(RowStage):
    """Measure what the picture misses at the colour sites (`Part.missed`). gamma: (C,), the weights of Eq. 7."""

    samples: BlockSamples
    gamma: FloatArray

    name = "missed"

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, with what they miss."""
        shown, sites = part.rows(*rows), self.samples.sites
        missed = np.zeros(shown.luminance.shape, np.float32)

        def measure(site: int) -> None:
            channel, (down, across) = sites.channels[site], sites.places[site]
            first, end = (max(-(-(row - down.start) // down.step), 0) for row in rows)  # rows of blocks
            end, top = min(end, sites.shape[0]), down.start + first * down.step - rows[0]
            if end <= first:
                return
            place = slice(top, top + (end - first - 1) * down.step + 1, down.step), across
            seen = shown.chromaticity[place][..., channel] * shown.luminance[place]
            error = (self.samples.samples[first:end, :, site] - seen) * self.gamma[channel]
            missed[place] = error * self.samples.unclipped[first:end]

        in_pieces(lambda site, _: measure(site), len(sites.places))
        return replace(shown, missed=missed)


@dataclass(eq=False)
class Correction(RowStage):
    """Share out what the picture misses at the colour sites of a block to all channels of all of them."""

    samples: BlockSamples
    gamma: FloatArray

    name = "correction"
    kernels = "share_out", "smooth"

    @property
    def look(self) -> Look:
        """The blocks around a site."""
        return Look(site_reach(self.samples.sites.grid.period))

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * (2 + channels) * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, corrected."""
        return correct_sites(part, self.samples, self.gamma).rows(*rows)


def correct_sites(part: Part, measured: BlockSamples, gamma: FloatArray) -> Part:
    """A part of a picture with the errors at its colour sites shared out; only rows `site_reach` inside the part are final.

    part: with what it misses. gamma: (C,), the weights of Eq. 7.
    """
    rows = measured.within(part)
    if rows.start >= rows.stop:
        return part
    places, channels = measured.inside(part, rows), measured.sites.channels
    colour = np.empty((rows.stop - rows.start, measured.sites.shape[1], len(places)), np.float32)

    def look(site: int) -> None:
        np.multiply(part.chromaticity[places[site]][..., channels[site]], gamma[channels[site]], out=colour[..., site])

    in_pieces(lambda site, _: look(site), len(places))
    light, tints = most_probable(measured.missed(part, rows), colour, measured, rows, gamma)
    if measured.kept is not None:
        tints *= measured.kept[rows, :, None, None]
    luminance, chromaticity = copied(part.luminance), copied(part.chromaticity)

    def correct(site: int) -> None:
        place = places[site]
        before = luminance[place]
        after = before + light[..., site]
        lit = ~((after <= DARK) | (before <= DARK))[..., None]  # what is not a number is to be seen, and refused
        # Colour that luminance gains has the chromaticity that was there; tints leave luminance as it is.
        tinted = chromaticity[place] + tints[:, :, site] / (gamma * np.where(lit, after[..., None], 1))
        luminance[place] = np.where(lit[..., 0], after, before)
        chromaticity[place] = np.where(lit, tinted, chromaticity[place])

    in_pieces(lambda site, _: correct(site), len(places))
    return replace(part, luminance=luminance, chromaticity=chromaticity)


_LANES = WIDTH // 2  # of float64
_LEAST = 1e-6  # of the variance of errors: what keeps equations solvable whose sites are all explained by one error


@parallel_kernel()
def share_out(
    pieces: Pieces,
    error: Floats3,
    colour: Floats3,
    fill_variance: Floats2,
    tint: Floats2,
    variance: Floats3,
    channels: Ints1,
    near: Doubles2,
    light: Floats3,
    tints: Floats4,
) -> None:
    """The most probable errors at each site, of luminance and of colour, given the errors of the samples (see `offline.sites`).

    error: sample minus picture, (rows, columns, S), in units of luminance.
    colour: share of luminance in the channel of each site, (rows, columns, S).
    fill_variance: variance of the error of luminance, (rows, columns).
    tint: variance of the error of colour, (rows, columns).
    variance: variance of the noise at each site, (rows, columns, S).
    channels: (S,), channel of each site.
    near: (S, S), correlation of errors at two sites.
    light: (rows, columns, S), written: errors of luminance.
    tints: (rows, columns, S, C), written: errors of the channels that leave luminance as it is.
    """
    columns, sites = error.shape[1:]
    count = tints.shape[3]
    for row in range(pieces[0], pieces[1]):
        covariance, right = np.empty((sites, sites, _LANES)), np.empty((sites, 1, _LANES))
        weight, noise, powers = np.empty((sites, _LANES)), np.empty((sites, _LANES)), np.empty((2, _LANES))
        lights, odds = np.empty((sites, _LANES)), np.empty((sites, count, _LANES))
        for group in range(0, columns, _LANES):
            for lane in range(_LANES):
                column = min(group + lane, columns - 1)  # the spare lanes of the last group repeat the last block
                powers[0, lane], powers[1, lane] = fill_variance[row, column], tint[row, column]
                for site in range(sites):
                    weight[site, lane] = max(np.float64(colour[row, column, site]), 0.0)
                    right[site, 0, lane] = error[row, column, site]
                    noise[site, lane] = variance[row, column, site]
            power, odd = load(powers, (0, 0)), load(powers, (1, 0))
            for i in range(sites):
                for j in range(sites):
                    same = (1.0 if channels[i] == channels[j] else 0.0) - 1 / count
                    store(covariance, (i, j, 0), near[i, j] * (power * load(weight, (i, 0)) * load(weight, (j, 0)) + odd * same))
                own = load(noise, (i, 0)) + _LEAST * (power + odd)
                store(covariance, (i, i, 0), load(covariance, (i, i, 0)) + own)
            _solve(covariance, right)
            lights[:], odds[:] = 0.0, 0.0
            for site in range(sites):
                for other in range(sites):
                    part = near[site, other] * load(right, (other, 0, 0))
                    store(lights, (site, 0), load(lights, (site, 0)) + power * load(weight, (other, 0)) * part)
                    for channel in range(count):
                        same = (1.0 if channels[other] == channel else 0.0) - 1 / count
                        store(odds, (site, channel, 0), load(odds, (site, channel, 0)) + odd * same * part)
            for lane in range(min(_LANES, columns - group)):
                uncertain = powers[0, lane] + powers[1, lane] > 0
                for site in range(sites):
                    light[row, group + lane, site] = lights[site, lane] if uncertain else 0.0
                    for channel in range(count):
                        tints[row, group + lane, site, channel] = odds[site, channel, lane] if uncertain else 0.0


@kernel
def _solve(matrix: Doubles3, right: Doubles3) -> None:
    """Solve matrix x = right for each column of `right`, in place; NaN if the symmetric matrix is not positive definite."""
    size, columns = len(matrix), right.shape[1]
    for i in range(size):
        pivot = load(matrix, (i, i, 0))
        inverse = where_less(0.0, pivot, quotient(1.0, pivot), np.nan)
        for k in range(i + 1, size):
            factor = load(matrix, (i, k, 0)) * inverse
            for j in range(k, size):
                store(matrix, (k, j, 0), load(matrix, (k, j, 0)) - factor * load(matrix, (i, j, 0)))
            for column in range(columns):
                store(right, (k, column, 0), load(right, (k, column, 0)) - factor * load(right, (i, column, 0)))
        store(matrix, (i, i, 0), inverse)
    for i in range(size - 1, -1, -1):
        for column in range(columns):
            total = load(right, (i, column, 0))
            for j in range(i + 1, size):
                total -= load(matrix, (i, j, 0)) * load(right, (j, column, 0))
            store(right, (i, column, 0), total * load(matrix, (i, i, 0)))
