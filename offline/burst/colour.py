"""The colour samples of all frames of a burst, each at its own place in the reference.

The sums of Eqs. 8-9 are additive: a sample that lies near a block of the reference is one more term
of the block's sums, the more certain the nearer it is.

At the end, samples correct the picture too, each at its own place. A picture differs from each
sample by some error. The correction of the picture's colour leaves little of these errors and
changes little from pixel to pixel, except across edges of luminance: it minimises a sum of squares
(`numerics.linked`) in each channel, times gamma. Without samples near a pixel its correction fades
to nothing, and so it does where noise explains the errors. The mean of the channels' corrections is
taken off them, which leaves luminance as it is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from ...shared.arrays import ByteArray, DoubleArray, FloatArray, IndexArray
from ..bands import DARK, Band, Halo, RowStage
from ..frame import BlockSums, Frame, Sites
from ..numerics.gaussian import filtered, gaussian, smoothed
from ..numerics.linked import SIDE, Fit, fitted
from .agree import FILL_ERROR, NEIGHBOURHOOD
from .align import TINY
from .motion import in_reference
from .select import Kept

# Chosen on drawn scenes. Change of chromaticity per pixel: uncertainty of a sample for a block that
# it does not lie in
_GRADIENT = 0.04
# squared distance from the middle of a 2 x 2 block, pixels, of its own sites: half a pixel both
# ways
_INSIDE = 0.5
# times what others take off the variance: from there on the reference's own samples count in full
_ENOUGH = 4.0
_SAME = 0.2  # pixels: a sample that is as far from a site is no more one of it
# standard deviation of a sample's residual besides noise, a share of the mean luminance
_ERROR = 2e-3
# Of the solution; fading relative to the weight of a usual sample, and the least of it, with which
# the solver takes hundreds of iterations. Chosen on five photographs, in noise of 0 to 0.03.
_SMOOTHNESS, _FADING, _LEAST_FADING = 0.08, 2e-3, 1e-5
_NEAR = 3.0  # pixels: standard deviation of a neighbourhood of samples; two reach `HALO`
_EDGE = 0.08  # difference of luminance that is an edge, a share of the mean luminance
SHARED = 0.3
"""Variance of merged luminance relative to the reference's, from which on the reference counts as
alone, up to 1, where it is. Chosen.
"""
HALO = 24
"""Pixels around a chunk that are solved with it. Chosen."""
TOLERANCE = 1e-3
"""Relative residual at which conjugate gradients stop. Chosen: that of `AffinitySettings`."""


@dataclass(frozen=True, eq=False)
class ColourSamples:
    """M colour samples.

    Attributes
    ----------
    own : int
        How many of them, the first ones, are the reference's.
    places : FloatArray
        (M, 2), row and column in the reference, pixels.
    channels : ByteArray
        (M,).
    values : FloatArray
        (M,), scene units of the reference.
    filled : FloatArray
        (M,), luminance there, scene units.
    variance : FloatArray
        (M,), of their noise; 0 where there is none.
    usual : FloatArray
        (M,), of the noise of such a sample of the reference, with the frame's gains of colour.
    weight : FloatArray
        (M,), how far they count by the agreement of their frames and by what is known of luminance
        there, 0 to 1.
    """

    own: int
    places: FloatArray
    channels: ByteArray
    values: FloatArray
    filled: FloatArray
    variance: FloatArray
    usual: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, kept: Sequence[Kept], fine: FloatArray, sites: Sites) -> "ColourSamples":
        """The colour samples of all frames that lie in the reference.

        Parameters
        ----------
        kept : Sequence[Kept]
            The reference first.
        fine : FloatArray
            See `merge_luminance`.
        sites : Sites
            Of the reference.
        """
        spline = spline_filter(fine, mode="mirror", output=np.float32)
        last = np.array(sites.grid.frame)[:, None, None, None] - 1
        frames = list[tuple[FloatArray, ...]]()
        for one in kept:
            places = in_reference(one.motion, *sites.pixels, sites.grid.frame)
            near = np.rint(places).astype(np.intp).clip(0, last)
            agrees = one.agreement[*near] * ((places >= 0) & (places <= last)).all(axis=0)
            used = agrees > 0
            channels = np.broadcast_to(sites.channels, used.shape)[used]
            values, places = one.frame.colours[used], places[:, used]
            filled = map_coordinates(spline, 2 * places, mode="mirror", prefilter=False)
            gains = np.broadcast_to(one.frame.colour_gains, used.shape)[used]
            models = one.frame.noise, kept[0].frame.noise
            variance, usual = (noise.variance(values, channels, gains) for noise in models)
            weight, kinds = agrees[used] / np.float32(255), channels.astype(np.uint8)
            frames.append((places.T, kinds, values, filled, variance, usual, weight))
        # in the order of the fields
        return cls(len(frames[0][0]), *map(np.concatenate, zip(*frames, strict=True)))

    def relit(self, change: FloatArray) -> "ColourSamples":
        """The samples where luminance has changed.

        Parameters
        ----------
        change : FloatArray
            (H, W).
        """
        return replace(self, filled=self.filled + self._there(change))

    def where_others(
        self, luminance: FloatArray, noise_ratio: FloatArray, gaps: FloatArray
    ) -> "ColourSamples":
        """The samples where the reference is not alone. Where it is, the picture stays that of one
        frame.

        Where few frames overlap, or none measures luminance, it is uncertain: beside edges a sample
        counts less there.

        Parameters
        ----------
        luminance : FloatArray
            (H, W).
        noise_ratio : FloatArray
            (H, W), variance of merged luminance relative to the reference's.
        gaps : FloatArray
            See `merge.uncovered`.
        """
        mean = smoothed(luminance, NEIGHBOURHOOD)
        power = smoothed(np.square(luminance), NEIGHBOURHOOD)
        contrast = np.sqrt(np.maximum(power - np.square(mean), 0))
        # chosen: colour tells half of the luminance that no frame has measured
        deviation = FILL_ERROR * np.maximum(single_frame_weight(noise_ratio), gaps / 2) * contrast
        error = self.error + self.variance
        weight = self.weight * error / (error + np.square(self._there(deviation)))
        weight[: self.own] *= np.minimum(_ENOUGH * (1 - self._there(noise_ratio)[: self.own]), 1)
        return replace(self, weight=weight.astype(np.float32))

    def _there(self, plane: FloatArray | DoubleArray) -> FloatArray:
        """The values of a plane of the reference, (H, W), at the places of the samples."""
        return map_coordinates(plane, self.places.T, order=1, mode="nearest")

    @property
    def level(self) -> float:
        """Mean luminance. Differences of luminance are fractions of it, so that exposure changes no
        picture but its brightness.
        """
        return max(float(self.filled.mean()), TINY) if self.filled.size else 1.0

    @property
    def error(self) -> float:
        """Variance of what a picture misses of a sample besides noise."""
        return (_ERROR * self.level) ** 2

    def block_sums(self, sites: Sites) -> BlockSums:
        """The sums of Eqs. 8-9 from the samples of other frames around each whole block.

        Each term counts relative to a sample of the reference in the middle of the block.
        """
        rest, shape, period = slice(self.own, None), sites.shape, sites.grid.period
        at = (self.places[rest] - sites.middle) / period
        block = np.rint(at).astype(np.intp)
        inside = ((block >= 0) & (block < shape)).all(axis=1)
        far = np.maximum(np.square((at - block) * period).sum(axis=1) - _INSIDE, 0)
        filled = self.filled[rest].astype(np.float64)
        distant = self.error + self.variance[rest] + np.square(_GRADIENT * filled) * far
        share = inside * self.weight[rest] * (self.error + self.usual[rest]) / distant
        full, within = (*shape, len(sites.pattern.channels)), block.clip(0, np.array(shape) - 1)
        place = np.ravel_multi_index((*within.T, self.channels[rest]), full)
        factors = filled, self.values[rest]
        sums = (np.bincount(place, share * filled * factor, math.prod(full)) for factor in factors)
        return BlockSums(*(np.asarray(plane, np.float64).reshape(full) for plane in sums))


def averaged_sites(frame: Frame, samples: ColourSamples) -> Frame:
    """The reference with the mean of all samples of a channel that lie at one of its sites, as all
    do on a tripod, and some where frames were displaced by about whole pixels.
    """
    places, rest = samples.places[samples.own :], slice(samples.own, None)
    pixels = np.rint(places).astype(np.intp)
    number = np.ravel_multi_index(tuple(pixels.T), frame.shape)
    same = frame.pattern.filter_map(frame.shape).take(number) == samples.channels[rest]
    far = np.square(places - pixels).sum(axis=1) / _SAME**2
    weight = same * samples.weight[rest] * np.maximum(1 - far, 0)
    share = weight * (samples.usual[rest] + TINY) / (samples.variance[rest] + TINY)
    factors = np.ones_like(share), samples.values[rest], weight
    sums = (np.bincount(number, share * factor, frame.signal.size) for factor in factors)
    total, product, squares = (frame.sites.of(plane.reshape(frame.shape)) for plane in sums)
    signal = frame.signal.copy()
    signal[frame.sites.pixels] = (frame.samples + product) / (1 + total)
    left = (1 + squares) / np.square(1 + total)
    return replace(frame.with_samples(signal), site_noise=left.astype(np.float32))


def relit_sites(frame: Frame, luminance: FloatArray, sums: BlockSums) -> Frame:
    """The reference with saturated colour samples replaced by what other frames saw around their
    blocks.

    Parameters
    ----------
    luminance : FloatArray
        Merged, (H, W).
    sums : BlockSums
        Of the other frames (`ColourSamples.block_sums`).
    """
    sites = frame.sites
    limits, signal = frame.limits(slice(0, sites.shape[0])), frame.signal.copy()
    for site, (channel, place) in enumerate(zip(sites.channels, sites.places, strict=True)):
        power, product = sums.weight[..., channel], sums.product[..., channel]
        known = (power > TINY) & (signal[place] >= limits[..., site])
        np.copyto(signal[place], product / np.maximum(power, TINY) * luminance[place], where=known)
    return frame.with_samples(signal)


def single_frame_weight(noise_ratio: FloatArray) -> FloatArray:
    """Single-frame weight of the reference, 0 to 1, from the noise variance of the merged luminance
    relative to its own.
    """
    return np.maximum(noise_ratio - SHARED, 0) / (1 - SHARED)


@dataclass(eq=False)
class Spreading(RowStage):
    """Correct the chromaticity around colour samples by what they show.

    Attributes
    ----------
    samples : ColourSamples
        Of all frames.
    measured : Frame
        The reference.
    """

    samples: ColourSamples
    measured: Frame

    name = "samples"
    halo = Halo(HALO + 1, SIDE)  # a sample beside the halo shows in its last row

    @cached_property
    def _in_rows(self) -> tuple[IndexArray, FloatArray, FloatArray]:
        """The order of the samples by their rows, these rows, and the precision of each sample, at
        most 1.
        """
        error, order = self.samples.error, np.argsort(self.samples.places[:, 0], kind="stable")
        gamma = self.measured.gamma32[self.samples.channels]
        precision = error / (error + self.samples.variance * np.square(gamma))
        return order, self.samples.places[order, 0], precision

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows.

        Raises
        ------
        ConvergenceError
            When conjugate gradients do not reach their tolerance.
        """
        gamma, shown = self.measured.gamma32, band.rows(*rows)
        order, down, precision = self._in_rows
        first, end = np.searchsorted(down, band.first), np.searchsorted(down, band.end - 1, "right")
        near = order[first:end]
        weights, products, noise = samples_of(band, self.samples, near, precision[near], gamma)
        span = rows[0] - band.first, rows[1] - band.first
        usual = float(np.median(precision)) if precision.size else 1.0
        fading, edge = max(_FADING * usual, _LEAST_FADING), _EDGE * self.samples.level
        fit = Fit(_SMOOTHNESS, fading, edge, HALO, TOLERANCE)
        fields = fitted(band.luminance, weights, products, fit, span)
        fields *= beyond_noise(weights, products, noise)[slice(*span)]
        fields = np.moveaxis(fields, 0, 2)
        divisor = np.where(shown.luminance > DARK, shown.luminance, np.inf)[..., None]
        change = (fields - fields.mean(axis=2, keepdims=True)) / (gamma * divisor)
        return Band(shown.first, shown.luminance, (shown.chromaticity + change).astype(np.float32))


def samples_of(
    band: Band, samples: ColourSamples, near: IndexArray, precision: FloatArray, gamma: FloatArray
) -> list[FloatArray]:
    """Weights of samples in a band of the picture, distributed to the four pixels around each, and
    these times their residuals, times gamma; and the variance of what noise adds to the latter:
    float32 (C, rows, W) each.

    Parameters
    ----------
    near : IndexArray
        (N,), which samples.
    precision : FloatArray
        (N,), of each.
    """
    rows, columns = band.luminance.shape
    last = rows - 1, columns - 1
    places = (samples.places[near] - (band.first, 0)).clip(0, last)
    first = places.astype(np.intp)
    (top, left), (bottom, right) = first.T, np.minimum(first + 1, last).T
    pixels = np.stack([columns * y + x for y in (top, bottom) for x in (left, right)], axis=1)
    down, across = (places - first).T
    shares = np.stack([y * x for y in (1 - down, down) for x in (1 - across, across)], axis=1)
    channels = samples.channels[near].astype(np.intp)
    chromaticity = band.chromaticity.reshape(rows * columns, -1)[pixels, channels[:, None]]
    colour = (chromaticity * shares).sum(axis=1)
    residual = gamma[channels] * (samples.values[near] - colour * samples.filled[near])
    weights = (samples.weight[near] * precision)[:, None] * shares
    shape = len(gamma), rows, columns
    at = (channels[:, None] * (rows * columns) + pixels).ravel()
    # the variance of a residual is the error over its precision
    noise = weights * (samples.error * samples.weight[near])[:, None]
    planes = weights, weights * residual[:, None], noise
    sums = (np.bincount(at, plane.ravel(), math.prod(shape)) for plane in planes)
    return [plane.reshape(shape).astype(np.float32) for plane in sums]


def beyond_noise(weights: FloatArray, products: FloatArray, noise: FloatArray) -> FloatArray:
    """The fraction of the power of local mean residuals, in the plane of constant luminance, beyond
    what noise and `ColourSamples.error` explain, 0 to 1, (rows, W).

    The residuals count as independent of the picture, though the same samples made it.

    Parameters
    ----------
    weights, products, noise : FloatArray
        What `samples_of` returns.
    """
    taps = gaussian(_NEAR)
    reach = len(taps) // 2
    border, inner = ((0, 0), (reach, reach), (reach, reach)), np.s_[:, reach:-reach, reach:-reach]
    # the variance of a sum has the squares of its weights
    sums = zip((weights, products, noise), (taps, taps, taps**2), strict=True)
    weights, products, left = (filtered(np.pad(planes, border), of)[inner] for planes, of in sums)
    weights = weights + np.float32(TINY)
    means = products / weights
    means -= means.mean(axis=0)
    by_noise = (left / np.square(weights)).sum(axis=0) * np.float32(1 - 1 / len(means))
    found, expected = (smoothed(plane, _NEAR) for plane in (np.square(means).sum(axis=0), by_noise))
    return np.maximum(1 - expected / np.maximum(found, TINY), 0)
