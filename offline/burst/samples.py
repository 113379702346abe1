"""The colour samples of all frames of a burst, each at its own place in the reference.

The sums of Eqs. 8-9 are additive: a sample that lies near a block of the reference is one more term of the block's sums, the more
certain the nearer it is.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from shared.arrays import ByteArray, FloatArray
from shared.pattern import BlockGrid

from ..blocks import BlockSums
from ..gaussian import smoothed
from ..kernels.spreading import TILE, Samples

_GRADIENT = 0.04  # change of chromaticity per pixel: how much less a sample tells of a block that it is not in
_FLOOR = 1e-8  # variance of a sample, scene units squared, where there is no noise
_INSIDE = 0.5  # squared distance from the middle of a block, pixels, of its own sites
_NEAR = 1.0  # pixels: standard deviation of the neighbourhood in which luminance is looked at
_DOUBT, _KNOWN = 0.3, 0.3  # error of light as a share of the contrast, where the reference is alone; relative variance without it
_ENOUGH = 4.0  # times what others take off the variance: from there on the reference's own samples count in full
_ERROR = 5e-7  # variance of what a picture misses of a sample besides noise, scene units squared


@dataclass(frozen=True, eq=False)
class ColourSamples:
    """M colour samples.

    places: (M, 2), row and column in the reference, pixels.
    channels: (M,).
    values: (M,), scene units of the reference.
    light: (M,), luminance there.
    variance: (M,), of their noise; 0 where there is none.
    weight: (M,), how far they are trusted, more than 0, at most 1.
    own: how many of them, the first ones, are the reference's.
    """

    places: FloatArray
    channels: ByteArray
    values: FloatArray
    light: FloatArray
    variance: FloatArray
    weight: FloatArray
    own: int

    def relit(self, change: FloatArray) -> "ColourSamples":
        """The samples where luminance has changed. change: (H, W)."""
        there = map_coordinates(change, self.places.T, order=1, mode="nearest")
        return replace(self, light=(self.light + there).astype(np.float32, copy=False))

    def where_others(self, luminance: FloatArray, shares: FloatArray) -> "ColourSamples":
        """The samples where the reference is not alone. Where it is, the picture is what one frame makes of it.

        luminance: (H, W). shares: (H, W), variance of merged luminance relative to the reference's.
        Where few frames see the light, it is not known between the reference's pixels: beside edges a sample then tells little.
        """
        edge = np.sqrt(np.maximum(smoothed(np.square(luminance), _NEAR) - np.square(smoothed(luminance, _NEAR)), 0))
        doubt = _DOUBT * np.maximum(shares - _KNOWN, 0) / (1 - _KNOWN) * edge
        there, alone = (map_coordinates(plane, self.places.T, order=1, mode="nearest") for plane in (doubt, shares))
        error = _ERROR + self.variance
        weight = self.weight * error / (error + np.square(there))
        weight[: self.own] *= np.minimum(_ENOUGH * (1 - alone[: self.own]), 1)
        return replace(self, weight=weight.astype(np.float32))

    def block_sums(self, grid: BlockGrid, channels: int) -> BlockSums:
        """The sums of Eqs. 8-9 from the samples of other frames around each whole block.

        Each term counts relative to a sample in the middle of the block.
        """
        rest = slice(self.own, None)
        shape = len(grid.whole_rows), len(grid.whole_columns)
        middle = np.array([grid.whole_rows[0], grid.whole_columns[0]]) + (np.array(grid.block_shape) - 1) / 2
        at = (self.places[rest] - middle) / grid.period
        block = np.rint(at).astype(np.intp)
        inside = ((block >= 0) & (block < shape)).all(axis=1)
        far = np.maximum(np.square((at - block) * grid.period).sum(axis=1) - _INSIDE, 0)
        light, variance = self.light[rest].astype(np.float64), self.variance[rest] + _FLOOR
        share = inside * self.weight[rest] * variance / (variance + np.square(_GRADIENT * light) * far)
        number = (block.clip(0, np.array(shape) - 1) * (shape[1], 1)).sum(axis=1)
        weight, product = np.empty((2, *shape, channels))
        for channel in range(channels):
            mine = self.channels[rest] == channel
            for plane, factor in ((weight, light), (product, self.values[rest])):
                terms = (share * light * factor)[mine]
                plane[..., channel] = np.bincount(number[mine], terms, minlength=shape[0] * shape[1]).reshape(shape)
        return BlockSums(weight, product)

    def by_tile(self, shape: tuple[int, int], gamma: FloatArray) -> tuple[Samples, float]:
        """The samples as `spread_samples` takes them, and their median precision, 0 to 1."""
        across = -(-shape[1] // TILE)
        tile = (self.places.clip(0, np.array(shape) - 1) // TILE).astype(np.intp) @ (across, 1)
        order = np.argsort(tile, kind="stable")
        starts = np.searchsorted(tile[order], np.arange(-(-shape[0] // TILE) * across + 1))
        per_channel = gamma[self.channels]
        precision = _ERROR / (_ERROR + self.variance * per_channel**2)
        figures = np.empty((len(self.values), 5), np.float32)
        figures[:, :2] = self.places
        figures[:, 2], figures[:, 3], figures[:, 4] = self.values * per_channel, self.light, self.weight * precision
        typical = float(np.median(precision)) if len(precision) else 1.0
        return (figures[order], self.channels[order], starts), typical
