"""The colour samples of all frames of a burst, each at its own place in the reference.

The sums of Eqs. 8-9 are additive: a sample that lies near a block of the reference is one more term of the block's sums, the more
certain the nearer it is.

At the end, samples correct the picture too, each at its own place.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from shared.arrays import ByteArray, FloatArray
from shared.progress import SILENT, Progress

from ..frame import BlockSums, Cleaned, Sites, unclipped_blocks
from ..measured import Measured
from ..numerics.gaussian import smoothed
from ..numerics.linked import TILE, tiles_of
from ..numerics.solvers import report
from ..parts import Look, Part, RowStage
from .frames import FILL_ERROR, NEIGHBOURHOOD, SHARED, TINY
from .selection import Kept
from .spreading import HALO, TOLERANCE, Samples, spread_samples

# Chosen: half and twice of each change the picture of a drawn scene by the decibels in brackets, some scenes up and others down.
_GRADIENT = 0.04  # change of chromaticity per pixel: uncertainty of a sample for a block that it does not lie in (0.1)
_FLOOR = 3e-4  # standard deviation of a sample where there is no noise, a share of the mean luminance (0.0)
_INSIDE = 0.5  # squared distance from the middle of a 2 x 2 block, pixels, of its own sites: half a pixel both ways
_ENOUGH = 4.0  # times what others take off the variance: from there on the reference's own samples count in full (0.0)
_ERROR = 2e-3  # standard deviation of what a picture misses of a sample besides noise, a share of the mean luminance (1.0)


@dataclass(frozen=True, eq=False)
class ColourSamples:
    """M colour samples.

    places: (M, 2), row and column in the reference, pixels.
    channels: (M,).
    values: (M,), scene units of the reference.
    light: (M,), luminance there.
    variance: (M,), of their noise; 0 where there is none.
    weight: (M,), how far their frames agree with the reference there, more than 0, at most 1.
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
    def of(cls, kept: Sequence[Kept], light: FloatArray, weight: FloatArray, sites: Sites) -> "ColourSamples":
        """The colour samples of all frames that lie in the reference. light, weight: from `merge`. sites: of the reference."""
        parts = []
        for kept_frame, lights, weights in zip(kept, light, weight, strict=True):
            used, noise = weights > 0, kept_frame.frame.noise
            rows, columns = (place[used] for place in sites.pixels)
            places = np.stack(kept_frame.motion.back(rows, columns, sites.grid.frame), axis=1)
            channels = np.broadcast_to(sites.channels.astype(np.uint8), used.shape)[used]
            values = kept_frame.frame.colours[used]
            variance = noise.variance(values, channels) if noise else np.zeros_like(values)
            parts.append(cls(places, channels, values, lights[used], variance, weights[used], own=0))
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
        return cls(**arrays, own=len(parts[0].values))

    @property
    def level(self) -> float:
        """Mean luminance. Lengths in light are shares of it, so that the exposure changes no picture but its brightness."""
        return max(float(self.light.mean()), TINY) if self.light.size else 1.0

    def relit(self, change: FloatArray) -> "ColourSamples":
        """The samples where luminance has changed. change: (H, W)."""
        there = map_coordinates(change, self.places.T, order=1, mode="nearest")
        return replace(self, light=(self.light + there).astype(np.float32, copy=False))

    def where_others(self, luminance: FloatArray, shares: FloatArray) -> "ColourSamples":
        """The samples where the reference is not alone. Where it is, the picture stays that of one frame.

        luminance: (H, W). shares: (H, W), variance of merged luminance relative to the reference's.
        Where few frames overlap, luminance between the reference's pixels is uncertain: beside edges a sample counts less there.
        """
        mean, power = (smoothed(plane, NEIGHBOURHOOD) for plane in (luminance, np.square(luminance)))
        deviation = FILL_ERROR * alone_of(shares) * np.sqrt(np.maximum(power - np.square(mean), 0))
        there, alone = (map_coordinates(plane, self.places.T, order=1, mode="nearest") for plane in (deviation, shares))
        error = (_ERROR * self.level) ** 2 + self.variance
        weight = self.weight * error / (error + np.square(there))
        weight[: self.own] *= np.minimum(_ENOUGH * (1 - alone[: self.own]), 1)
        return replace(self, weight=weight.astype(np.float32))

    def block_sums(self, sites: Sites) -> BlockSums:
        """The sums of Eqs. 8-9 from the samples of other frames around each whole block.

        Each term counts relative to a sample in the middle of the block.
        """
        rest, shape, period = slice(self.own, None), sites.shape, sites.grid.period
        at = (self.places[rest] - sites.middle) / period
        block = np.rint(at).astype(np.intp)
        inside = ((block >= 0) & (block < shape)).all(axis=1)
        far = np.maximum(np.square((at - block) * period).sum(axis=1) - _INSIDE, 0)
        light, variance = self.light[rest].astype(np.float64), self.variance[rest] + (_FLOOR * self.level) ** 2
        share = inside * self.weight[rest] * variance / (variance + np.square(_GRADIENT * light) * far)
        full = *shape, len(sites.pattern.channels)
        place = np.ravel_multi_index((*block.clip(0, np.array(shape) - 1).T, self.channels[rest]), full)
        sums = (np.bincount(place, share * light * factor, minlength=math.prod(full)) for factor in (light, self.values[rest]))
        return BlockSums(*(np.asarray(each, np.float64).reshape(full) for each in sums))

    def by_tile(self, shape: tuple[int, int], gamma: FloatArray) -> tuple[Samples, float]:
        """The samples as `spread_samples` takes them, and their median precision, 0 to 1."""
        across = -(-shape[1] // TILE)
        tile = (self.places.clip(0, np.array(shape) - 1) // TILE).astype(np.intp) @ (across, 1)
        order = np.argsort(tile, kind="stable")
        starts = np.searchsorted(tile[order], np.arange(-(-shape[0] // TILE) * across + 1))
        per_channel = gamma[self.channels]
        error = (_ERROR * self.level) ** 2
        precision = error / (error + self.variance * per_channel**2)
        figures = np.empty((len(self.values), 5), np.float32)
        figures[:, :2] = self.places
        figures[:, 2], figures[:, 3], figures[:, 4] = self.values * per_channel, self.light, self.weight * precision
        typical = float(np.median(precision)) if len(precision) else 1.0
        return (figures[order], self.channels[order], starts), typical


_ARRAYS = [field.name for field in fields(ColourSamples) if field.name != "own"]


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


# With less, where noise is as strong as light, single precision cannot solve the system. At sigma 0.1 it is 5 times as much.
_LEAST_FADING = 1e-7
_SMOOTHNESS, _FADING = 0.15, 0.01  # chosen: half and twice change drawn scenes by 0.8 and 0.1 dB, some up and others down
_EDGE = 0.08  # difference of luminance that is an edge, a share of the mean luminance; chosen likewise: 0.7 dB


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
        corrected, residuals, used = np.empty_like(shown.chromaticity), np.empty(tiles), np.empty(tiles, np.intp)
        where = part.luminance, part.chromaticity, part.first, rows, height
        spread_samples(*where, samples, gamma, _basis(len(gamma)), prior, corrected, residuals, used)
        report(self.progress, "samples", used, residuals, TOLERANCE)
        return Part(shown.first, shown.luminance, corrected)


def _basis(channels: int) -> FloatArray:
    """Orthonormal columns that add up to zero, (C, C - 1)."""
    square = np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0]
    return np.ascontiguousarray(square[:, 1:], np.float32)
