"""The colour samples of all frames of a burst, each at its own place in the reference.

The sums of Eqs. 8-9 are additive: a sample that lies near a block of the reference is one more term of the block's sums, the more
certain the nearer it is.

At the end, samples correct the picture too, each at its own place. A picture differs from each sample by some error. The correction
of the picture's colour leaves little of these errors and changes little from pixel to pixel, except across edges of luminance: it
minimises a sum of squares, by conjugate gradients. Without samples near a pixel its correction fades to nothing. Corrections leave
luminance as it is.

Colours are weighted by gamma there: then channels have the unit of luminance, and a colour is a set of C numbers that add up to
zero: C - 1 coefficients on an orthonormal basis.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from shared.arrays import ByteArray, FloatArray
from shared.progress import SILENT, Progress

from ..blocks import BlockSums, Sites
from ..cleaned import Cleaned, unclipped_blocks
from ..measured import Measured
from ..numerics.arrays import Area, Bytes1, Doubles1, Floats1, Floats2, Floats3, Ints1, Pair, Scalar
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import tile_at, zeros
from ..numerics.gaussian import smoothed
from ..numerics.linked import TILE, Prior, link, solve, tiles_of
from ..numerics.solvers import report
from ..parts import DARK, Look, Part, RowStage
from .agree import FILL_ERROR, NEIGHBOURHOOD
from .align import TINY, in_reference
from .select import Kept

# Chosen: half and twice of each change the picture of a drawn scene by the decibels in brackets, some scenes up and others down.
_GRADIENT = 0.04  # change of chromaticity per pixel: uncertainty of a sample for a block that it does not lie in (0.1)
_INSIDE = 0.5  # squared distance from the middle of a 2 x 2 block, pixels, of its own sites: half a pixel both ways
_ENOUGH = 4.0  # times what others take off the variance: from there on the reference's own samples count in full (0.0)
_ERROR = 2e-3  # standard deviation of what a picture misses of a sample besides noise, a share of the mean luminance (1.0)
_SMOOTHNESS, _FADING = 0.15, 0.01  # half and twice: 0.8 and 0.1 dB
_EDGE = 0.08  # difference of luminance that is an edge, a share of the mean luminance (0.7)
# With less, where noise is as strong as light, single precision cannot solve the system. At sigma 0.1 it is 5 times as much.
_LEAST_FADING = 1e-7
SHARED = 0.3
"""Variance of merged luminance relative to the reference's, from which on the reference counts as alone, up to 1, where it is.

Chosen: half of it costs 0.5 dB, twice gains 0.02."""
HALO = 24
"""Pixels around a tile that are solved with it. Chosen."""
TOLERANCE = 1e-3
"""Relative residual at which conjugate gradients stop. Chosen: that of `AffinitySettings`."""
_ZERO, _ONE, _DARK = np.float32(0), np.float32(1), np.float32(DARK)


class Samples(NamedTuple):
    """M colour samples for kernels, sorted by tile.

    figures: (M, 5), row and column in the reference, value times gamma, luminance, precision. channels: (M,).
    starts: (tiles + 1,), where those of each tile begin, tiles counted row by row.
    """

    figures: Floats2
    channels: Bytes1
    starts: Ints1


@dataclass(frozen=True, eq=False)
class ColourSamples:
    """M colour samples.

    places: (M, 2), row and column in the reference, pixels.
    channels: (M,).
    values: (M,), scene units of the reference.
    light: (M,), luminance there.
    variance: (M,), of their noise; 0 where there is none.
    weight: (M,), how far they count by the agreement of their frames and by what is known of luminance there, 0 to 1.
    own: how many of them, the first ones, are the reference's.
    """

    places: FloatArray
    channels: ByteArray
    values: FloatArray
    light: FloatArray
    variance: FloatArray
    weight: FloatArray
    own: int

    @classmethod
    def of(cls, kept: Sequence[Kept], luminance: FloatArray, shares: FloatArray, sites: Sites) -> "ColourSamples":
        """The colour samples of all frames that lie in the reference, where it is not alone: there the picture stays that of one.

        luminance: merged, (H, W). shares: (H, W), variance of its noise relative to the reference's. sites: of the reference.
        Where few frames overlap, luminance between the reference's pixels is uncertain: beside edges a sample counts less there.
        """
        parts = []
        for one in kept:
            places, noise = in_reference(one.motion, *sites.pixels, sites.grid.frame), one.frame.noise
            near = np.floor(places + np.float32(0.5)).astype(np.intp)
            limits = np.array(luminance.shape)[:, None, None, None]
            agrees = one.agreement[*near.clip(0, limits - 1)] * ((near >= 0) & (near < limits)).all(axis=0)
            used = agrees > 0
            channels = np.broadcast_to(sites.channels.astype(np.uint8), used.shape)[used]
            values = one.frame.colours[used]
            variance = noise.variance(values, channels) if noise else np.zeros_like(values)
            parts.append((places[:, used].T, channels, values, variance, agrees[used] / np.float32(255)))
        places, channels, values, variance, weight = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        samples = cls(places, channels, values, np.empty_like(values), variance, weight, len(parts[0][0])).lit_by(luminance)
        mean, power = (smoothed(plane, NEIGHBOURHOOD) for plane in (luminance, np.square(luminance)))
        deviation = FILL_ERROR * alone_of(shares) * np.sqrt(np.maximum(power - np.square(mean), 0))
        deviation, alone = (map_coordinates(plane, places.T, order=1, mode="nearest") for plane in (deviation, shares))
        error = samples.error + variance
        weight = weight * error / (error + np.square(deviation))
        weight[: samples.own] *= np.minimum(_ENOUGH * (1 - alone[: samples.own]), 1)
        return replace(samples, weight=weight.astype(np.float32))

    def lit_by(self, luminance: FloatArray) -> "ColourSamples":
        """The samples in another luminance, (H, W), of the reference."""
        return replace(self, light=map_coordinates(luminance, self.places.T, order=3, mode="mirror"))

    @property
    def level(self) -> float:
        """Mean luminance. Lengths in light are shares of it, so that the exposure changes no picture but its brightness."""
        return max(float(self.light.mean()), TINY) if self.light.size else 1.0

    @property
    def error(self) -> float:
        """Variance of what a picture misses of a sample besides noise."""
        return (_ERROR * self.level) ** 2

    def block_sums(self, sites: Sites) -> BlockSums:
        """The sums of Eqs. 8-9 from the samples of other frames around each whole block.

        Each term counts relative to a sample in the middle of the block.
        """
        rest, shape, period = slice(self.own, None), sites.shape, sites.grid.period
        at = (self.places[rest] - sites.middle) / period
        block = np.rint(at).astype(np.intp)
        inside = ((block >= 0) & (block < shape)).all(axis=1)
        far = np.maximum(np.square((at - block) * period).sum(axis=1) - _INSIDE, 0)
        light, variance = self.light[rest].astype(np.float64), self.variance[rest] + self.error
        share = inside * self.weight[rest] * variance / (variance + np.square(_GRADIENT * light) * far)
        full = *shape, len(sites.pattern.channels)
        place = np.ravel_multi_index((*block.clip(0, np.array(shape) - 1).T, self.channels[rest]), full)
        sums = (np.bincount(place, share * light * factor, minlength=math.prod(full)) for factor in (light, self.values[rest]))
        return BlockSums(*(np.asarray(plane, np.float64).reshape(full) for plane in sums))

    def by_tile(self, shape: tuple[int, int], gamma: FloatArray) -> tuple[Samples, float]:
        """The samples as `spread_samples` takes them, and their median precision, 0 to 1."""
        across = -(-shape[1] // TILE)
        tile = (self.places.clip(0, np.array(shape) - 1) // TILE).astype(np.intp) @ (across, 1)
        order = np.argsort(tile, kind="stable")
        starts = np.searchsorted(tile[order], np.arange(-(-shape[0] // TILE) * across + 1))
        scale = gamma[self.channels]
        precision = self.error / (self.error + self.variance * scale**2)
        figures = np.column_stack([self.places, self.values * scale, self.light, self.weight * precision]).astype(np.float32)
        typical = float(np.median(precision)) if len(precision) else 1.0
        return Samples(figures[order], self.channels[order], starts), typical


def relit_sites(frame: Cleaned, luminance: FloatArray, sums: BlockSums) -> Cleaned:
    """The reference with saturated colour samples replaced by what other frames saw around their blocks.

    luminance: merged, (H, W). sums: of the other frames (`ColourSamples.block_sums`).
    """
    if unclipped_blocks(frame).all():
        return frame
    signal = frame.signal.copy()
    for channel, place in zip(frame.sites.channels, frame.sites.places, strict=True):
        power, product = sums.weight[..., channel], sums.product[..., channel]
        known = (power > TINY) & (signal[place] >= frame.clipping)
        share = product / np.where(known, power, 1)
        signal[place] = np.where(known, share * luminance[place], signal[place])
    return frame.with_samples(signal)


def alone_of(shares: FloatArray) -> FloatArray:
    """How far the reference is alone, 0 to 1, by the variance of merged luminance relative to its own."""
    return np.maximum(shares - SHARED, 0) / (1 - SHARED)


@dataclass(eq=False)
class Spreading(RowStage):
    """Correct the chromaticity around colour samples by what they show.

    samples: of all frames. measured: the reference. progress: hears what the solver did.
    """

    samples: ColourSamples
    measured: Measured
    progress: Progress = SILENT

    name = "samples"
    kernels = ("spread_samples",)

    @property
    def look(self) -> Look:
        """A tile and what surrounds it."""
        return Look(HALO, TILE)

    @cached_property
    def _by_tile(self) -> tuple[Samples, float]:
        return self.samples.by_tile(self.measured.shape, self.measured.gamma)

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows. Raises ConvergenceError when conjugate gradients do not reach their tolerance."""
        gamma, (samples, precision), (height, width) = self.measured.gamma, self._by_tile, self.measured.shape
        prior = _SMOOTHNESS, max(_FADING * precision, _LEAST_FADING), _EDGE * self.samples.level
        shown, tiles = part.rows(*rows), tiles_of(rows, width)
        picture = Picture(part.luminance, part.chromaticity, part.first, height, gamma, basis_of(len(gamma)), prior)
        corrected = Corrected(np.empty_like(shown.chromaticity), np.empty(tiles), np.empty(tiles, np.intp))
        spread_samples(picture, samples, rows, corrected)
        report(self.progress, "samples", corrected.used, corrected.residuals, TOLERANCE)
        return Part(shown.first, shown.luminance, corrected.chromaticity)


def basis_of(channels: int) -> FloatArray:
    """Orthonormal columns that add up to zero, (C, C - 1)."""
    square = np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0]
    return np.ascontiguousarray(square[:, 1:], np.float32)


class Picture(NamedTuple):
    """A part of a picture for kernels, which reaches `HALO` beyond the rows to correct.

    luminance, chromaticity: (rows, W) and (rows, W, C). first: the frame's row at luminance[0]. height: rows of the frame.
    gamma: (C,), the weights of Eq. 7. basis: see `basis_of`.
    prior: smoothness and fading relative to the precision of a sample, and the difference of luminance, scene units, that is an
        edge.
    """

    luminance: Floats2
    chromaticity: Floats3
    first: int
    height: int
    gamma: Floats1
    basis: Floats2
    prior: Prior


class Corrected(NamedTuple):
    """Corrected rows of a picture.

    chromaticity: (rows, W, C). residuals, used: (tiles,), relative residual and iterations of each tile, see `tiles_of`.
    """

    chromaticity: Floats3
    residuals: Doubles1
    used: Ints1


@parallel_kernel(pieces=lambda *arguments: len(arguments[-1].used))
def spread_samples(pieces: Pieces, picture: Picture, samples: Samples, rows: Pair, corrected: Corrected) -> None:
    """Correct the chromaticity of some rows of the frame.

    rows: first and end row to correct; the first is a multiple of `TILE`, and so is the end, or it is the frame's.
    corrected: written.
    """
    width, basis = picture.luminance.shape[1], picture.basis
    channels, parts = basis.shape
    for number in range(pieces[0], pieces[1]):
        top, bottom, left, right = tile_at(number, (rows[1] - rows[0], width), (TILE, TILE))
        top, bottom = rows[0] + top, rows[0] + bottom
        area = max(top - HALO, 0), min(bottom + HALO, picture.height), max(left - HALO, 0), min(right + HALO, width)
        size = area[1] - area[0], area[3] - area[2]
        light = picture.luminance[area[0] - picture.first : area[1] - picture.first, area[2] : area[3]]
        colour = picture.chromaticity[area[0] - picture.first : area[1] - picture.first, area[2] : area[3]]
        unknowns, right_side = zeros(parts, *size), zeros(parts, *size)
        normal, links = zeros(parts * channels // 2, *size), zeros(4, *size)
        down, across = (picture.height + TILE - 1) // TILE, (width + TILE - 1) // TILE
        for row in range(max(top // TILE - 1, 0), min(top // TILE + 2, down)):
            first, last = max(left // TILE - 1, 0), min(left // TILE + 1, across - 1)
            taken = samples.starts[row * across + first], samples.starts[row * across + last + 1]
            _gather(light, colour, area, taken, samples, picture, normal, right_side)
        link(light, picture.prior, links)
        residual, used = solve(normal, right_side, links, np.float32(picture.prior[1]), TOLERANCE, unknowns)
        corrected.residuals[number], corrected.used[number] = residual, used
        for row in range(top, bottom):
            for column in range(left, right):
                y, x = row - area[0], column - area[2]
                lit = light[y, x] > _DARK
                for channel in range(channels):
                    step = _ZERO
                    for part in range(parts):
                        step += basis[channel, part] * unknowns[part, y, x]
                    change = step / (picture.gamma[channel] * light[y, x]) if lit else _ZERO
                    corrected.chromaticity[row - rows[0], column, channel] = colour[y, x, channel] + change


@kernel
def _gather(
    light: Floats2, colour: Floats3, area: Area, taken: Pair, samples: Samples, picture: Picture, normal: Floats3, right: Floats3
) -> None:
    """Add some samples to the normal equations of an area, each shared out to the four pixels around it. taken: first and end."""
    basis = picture.basis
    for sample in range(taken[0], taken[1]):
        y, x = samples.figures[sample, 0] - np.float32(area[0]), samples.figures[sample, 1] - np.float32(area[2])
        if not (_ZERO <= y <= light.shape[0] - 1 and _ZERO <= x <= light.shape[1] - 1):
            continue
        above, before = min(int(y), light.shape[0] - 2), min(int(x), light.shape[1] - 2)
        lower, after = y - np.float32(above), x - np.float32(before)
        channel, missed = samples.channels[sample], _ZERO
        for corner in range(4):
            missed += _share(corner, lower, after) * colour[above + corner // 2, before + corner % 2, channel]
        missed = samples.figures[sample, 2] - picture.gamma[channel] * missed * samples.figures[sample, 3]
        for corner in range(4):
            share = _share(corner, lower, after) * samples.figures[sample, 4]
            i, j, place = above + corner // 2, before + corner % 2, 0
            for part in range(basis.shape[1]):
                right[part, i, j] += share * basis[channel, part] * missed
                for other in range(part, basis.shape[1]):
                    normal[place, i, j] += share * basis[channel, part] * basis[channel, other]
                    place += 1


@kernel
def _share(corner: int, down: Scalar, along: Scalar) -> Scalar:
    """The share of one of the four pixels around a place in bilinear interpolation."""
    return (down if corner // 2 else _ONE - down) * (along if corner % 2 else _ONE - along)
