"""Colour of every pixel where colour sites are scattered: each channel is pinned at its own sites
and spreads from there.

The chromaticity of a block describes it as a whole, but its sites lie pixels apart: each measures
the chromaticity of its own channel at its own place, r[n] = sample over luminance. Between them a
channel changes little, except across edges of luminance (the prior of section 3.3). Noise makes a
single site worth little, so sites count as far as they show more than noise: elsewhere the
chromaticity pooled over similar blocks stays. None of this is in the paper, whose sites adjoin.

Of each channel, the difference x from a base chromaticity b minimises

    sum_n w[n] (b[n] + x[n] - r[n])^2 + f sum_n x[n]^2
    + sum_nn' s (x[n] - x[n'])^2 / (1 + ((l[n] - l[n']) / t)^2),

with the confidence w in a site (0 elsewhere), fading f, smoothness s, luminance l and an edge t
(`numerics.linked`). The base is the picture's own chromaticity as far as noise hides what sites
show, otherwise that of a wide neighbourhood. A channel without sites follows from the others by
Eq. 7.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...shared.arrays import BoolArray, FloatArray
from ...shared.calibration import derived_channel
from ..bands import DARK, Band, Halo, RowStage
from ..frame import Frame, mean_of_sites
from ..numerics.gaussian import smoothed
from ..numerics.interpolation import interpolate
from ..numerics.linked import SIDE, Extent, Prior, Samples, fitted
from .correction import signal_power, site_reach

# Chosen; in brackets, by how many decibels half or twice changes Kodak's tile at sigma 0.01.
# Of the solution, relative to the precision of a sample (0.1, 0.1).
_SMOOTHNESS, _FADING = 0.1, 1e-3
_EDGE = 0.05  # difference of luminance that is an edge, a share of the mean luminance (0.2)
# blocks: standard deviation of the neighbourhood whose chromaticity is the base where sites are
# trusted (0.1)
_AROUND = 2.0
# times the noise, that what sites show must exceed to count by half: luminance is uncertain too
# (0.0)
_CAUTION = 8.0
# blocks that interpolation between them looks beyond a pixel: cubic convolution has four taps
_TAPS = 2
_LEAST_SUM = 0.5  # of gamma c, which is about 1: below it, the base stays (0.2)
HALO = 16
"""Pixels around a chunk that are solved with it: colour sites are near everywhere, so fields beyond
have no influence. Chosen.
"""
TOLERANCE = 1e-4
"""Relative residual at which conjugate gradients stop. Chosen."""


def _confidence(power: FloatArray, noise: FloatArray | None) -> FloatArray:
    """Confidence in sites, 0 to 1, float32. power: squared residual of the picture there. noise:
    variance; None = there is none.
    """
    if noise is None:
        return np.ones_like(power)
    total: FloatArray = np.maximum(power + np.float32(_CAUTION) * noise, np.finfo(np.float32).tiny)
    return power / total


@dataclass(eq=False)
class Pinning(RowStage):
    """Pin the chromaticity of a frame at its sites.

    Attributes
    ----------
    frame : Frame
        With what was learned of its sites.
    """

    frame: Frame

    name = "pinning"

    @property
    def halo(self) -> Halo:
        """Dependence of a pixel: its neighbours, and the blocks around those."""
        period = self.frame.pattern.period
        return Halo(HALO + site_reach(period) + _TAPS * period, SIDE)

    @cached_property
    def _edge(self) -> float:
        return max(_EDGE * float(self.frame.luminance.mean()), DARK)

    @cached_property
    def _around(self) -> FloatArray:
        return np.ascontiguousarray(smoothed(np.moveaxis(self.frame.blocks, 2, 0), _AROUND))

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows.

        Raises
        ------
        ConvergenceError
            When conjugate gradients do not reach their tolerance.
        """
        frame, sites = self.frame, self.frame.sites
        blocks = sites.within(band)
        if blocks.start >= blocks.stop:
            return band.rows(*rows)
        variance = frame.scaled_variance(blocks)
        noise = None if variance is None else mean_of_sites(variance)
        power = signal_power(sites.residual(band, blocks), noise)
        confidence = _confidence(power, noise) * frame.unclipped[blocks]
        luminance = sites.in_rows(band.luminance, blocks, band.first)
        # A ratio is the less certain the darker its site is.
        mean = np.square(luminance).mean(axis=2, dtype=np.float32, keepdims=True)
        squared = np.square(luminance) / mean.clip(np.float32(DARK**2))
        weight = _confidence(power[..., None] * squared, variance) * np.minimum(squared, 1)
        weight *= frame.unclipped[blocks, :, None]
        ratios, weights = np.zeros_like(band.luminance), np.zeros_like(band.luminance)
        samples = sites.in_rows(frame.signal, blocks)
        for site, place in enumerate(sites.at(blocks, band.first)):
            lit = luminance[..., site] > DARK
            ratio = samples[..., site] / np.where(lit, luminance[..., site], 1)
            ratios[place] = np.where(lit, ratio, 0)
            weights[place] = np.where(lit, weight[..., site], 0)
        return self._pinned(band, rows, self._base(band, confidence, blocks), ratios, weights)

    def _base(self, band: Band, confidence: FloatArray, blocks: slice) -> FloatArray:
        """The picture's own chromaticity as far as noise hides what sites show, otherwise that of a
        wide neighbourhood.
        """
        grid = self.frame.grid
        trusted, plane = np.empty_like(band.luminance), np.empty_like(band.luminance)
        half = (grid.period - 1) / 2
        down, across = float(grid.whole_rows[blocks.start]), float(grid.whole_columns[0])
        interpolate(confidence, (down + half - band.first, across + half), grid.period, trusted)
        base = band.chromaticity.copy()
        first = float(grid.rows[0]) + half - band.first, float(grid.columns[0]) + half
        for channel, around in enumerate(self._around):
            interpolate(around, first, grid.period, plane)
            base[..., channel] += trusted * (plane - base[..., channel])
        return base

    def _pinned(
        self,
        band: Band,
        rows: tuple[int, int],
        base: FloatArray,
        ratios: FloatArray,
        weights: FloatArray,
    ) -> Band:
        filters = self.frame.pattern.filter_map(band.luminance.shape, (band.first, 0))
        of_channel = np.arange(base.shape[2])[:, None, None] == filters
        apart = weights * (ratios - np.moveaxis(base, 2, 0))
        samples = Samples(of_channel * weights, of_channel * apart)
        extent = Extent(rows[0] - band.first, rows[1] - band.first, HALO, TOLERANCE)
        prior = Prior(_SMOOTHNESS, _FADING, self._edge)
        change = fitted(band.luminance, samples, prior, extent, "pinning")
        own, pinned = band.rows(*rows), base[extent.first : extent.end] + np.moveaxis(change, 0, 2)
        gamma, derived = self.frame.gamma32, self.frame.pattern.derived
        if derived is not None:  # Eq. 7
            pinned[..., derived] = derived_channel(1, pinned, gamma, derived).clip(0)
        total = (pinned @ gamma)[..., None]
        whole: BoolArray = total > _LEAST_SUM
        pinned = np.where(whole, pinned / np.where(whole, total, 1), own.chromaticity)
        return replace(own, chromaticity=pinned)
