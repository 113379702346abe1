"""Colour of every pixel where colour sites are scattered: each channel is pinned at its own sites.

The chromaticity of a tile describes it as a whole, but its sites lie pixels apart: each measures the chromaticity of its own
channel at its own place, sample over luminance there. Between them a channel changes little, except across
edges of luminance (the prior of section 3.3). Noise makes a single site worth little, so sites count as far as they show more than
noise: elsewhere the chromaticity pooled over similar tiles stays. None of this is in the paper, whose sites form blocks.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from shared.arrays import BoolArray, FloatArray
from shared.progress import SILENT, Progress

from ..gaussian import smoothed
from ..kernels.interpolation import interpolate
from ..kernels.pinning import HALO, TOLERANCE, pin_samples
from ..kernels.linked import TILE, tiles_of
from ..measured import BlockSamples, Measured
from ..parts import DARK, Look, Part, RowStage
from ..sites import signal_power, site_reach
from ..solvers import report

# Chosen; in brackets, by how many decibels half or twice changes Kodak's tile at sigma 0.01 (README).
_SMOOTHNESS, _FADING = 0.1, 1e-3  # of the solution, relative to the precision of a sample (0.1, 0.1)
_EDGE = 0.05  # difference of luminance that is an edge, a share of the mean luminance (0.2)
_TINY = 1e-6  # scene units: the least difference that is an edge
_AROUND = 2.0  # tiles: standard deviation of the neighbourhood whose chromaticity is the base where sites are trusted (0.1)
_CAUTION = 8.0  # times the noise, that what sites show must exceed to count by half: luminance is uncertain too (0.0)
_TAPS = 2  # tiles that interpolation between them looks beyond a pixel: cubic convolution has four taps
_BYTES, _CHANNEL = 29.0, 12.0  # of memory, per pixel of the rows that are held, and per channel of them: measured
_LEAST_SUM = 0.5  # of gamma c, which is about 1: below it, the base stays (0.2)


def _share(power: FloatArray, noise: FloatArray | None) -> FloatArray:
    """How far sites count that miss the picture by `power`, where `noise` is the variance of their noise: 0 to 1, float32."""
    if noise is None:
        return np.ones_like(power)
    total: FloatArray = np.maximum(power + np.float32(_CAUTION) * noise, np.finfo(np.float32).tiny)
    return power / total


@dataclass(eq=False)
class Pinning(RowStage):
    """Pin the chromaticity of a frame at its sites.

    measured: the frame. samples: of all its whole tiles.
    progress: hears what the solver did.
    """

    measured: Measured
    samples: BlockSamples
    progress: Progress = SILENT

    name = "pinning"
    kernels = "pin_samples", "interpolate", "smooth"

    @property
    def look(self) -> Look:
        """What a pixel depends on: its neighbours, and the tiles around those."""
        period = self.measured.pattern.period
        return Look(HALO + site_reach(period) + _TAPS * period, TILE)

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return (_BYTES + _CHANNEL * channels) * pixels

    @cached_property
    def _edge(self) -> float:
        return max(_EDGE * float(self.measured.luminance.mean()), _TINY)

    @cached_property
    def _around(self) -> FloatArray:
        return np.ascontiguousarray(smoothed(np.moveaxis(self.measured.blocks, 2, 0), _AROUND))

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows. Raises ConvergenceError when conjugate gradients do not reach their tolerance."""
        samples, gamma = self.samples, self.measured.gamma
        tiles = samples.within(part)
        if tiles.start >= tiles.stop:
            return part.rows(*rows)
        variance = samples.scaled_variance(gamma, tiles)
        noise = None if variance is None else variance.mean(axis=2)
        power = signal_power(samples.missed(part, tiles), noise)
        share = _share(power, noise) * samples.unclipped[tiles]
        places = samples.inside(part, tiles)
        lights = np.stack([part.luminance[place] for place in places], axis=2)
        # A ratio is the less certain the darker its site is.
        squared = np.square(lights) / np.maximum(np.square(lights).mean(axis=2, keepdims=True), DARK**2)
        trust = _share(power[..., None] * squared, variance) * np.minimum(squared, 1) * samples.unclipped[tiles, :, None]
        if samples.lines is not None:
            apart = 1 - samples.lines.share[tiles]
            share, trust = share * apart, trust * apart[..., None]
        ratios, weights = np.zeros_like(part.luminance), np.zeros_like(part.luminance)
        for site, place in enumerate(places):
            light = lights[..., site]
            lit = light > DARK
            ratios[place] = np.where(lit, samples.samples[tiles, :, site] / np.where(lit, light, 1), 0)
            weights[place] = np.where(lit, trust[..., site], 0)
        return self._pinned(part, rows, self._base(part, share, tiles), ratios, weights)

    def _base(self, part: Part, share: FloatArray, tiles: slice) -> FloatArray:
        """The picture's own chromaticity as far as noise hides what sites show, otherwise that of a wide neighbourhood."""
        grid = self.measured.grid
        trusted, plane = np.empty_like(part.luminance), np.empty_like(part.luminance)
        half = (grid.period - 1) / 2
        interpolate(
            share,
            (float(grid.whole_rows[tiles.start]) + half - part.first, float(grid.whole_columns[0]) + half),
            grid.period,
            trusted,
        )
        base = part.chromaticity.copy()
        for channel, around in enumerate(self._around):
            interpolate(around, (float(grid.rows[0]) + half - part.first, float(grid.columns[0]) + half), grid.period, plane)
            base[..., channel] += trusted * (plane - base[..., channel])
        return base

    def _pinned(self, part: Part, rows: tuple[int, int], base: FloatArray, ratios: FloatArray, weights: FloatArray) -> Part:
        channels = self.measured.pattern.filter_map(part.luminance.shape, (part.first, 0))
        shown = part.rows(*rows)
        found = np.empty_like(shown.chromaticity)
        prior = _SMOOTHNESS, _FADING, self._edge
        tiles = tiles_of(rows, part.luminance.shape[1])
        residuals, used = np.empty(tiles), np.empty(tiles, np.intp)
        pin_samples(part.luminance, base, channels, ratios, weights, part.first, rows, prior, found, residuals, used)
        report(self.progress, "pinning", used, residuals, TOLERANCE)
        total = (found @ self.measured.gamma)[..., None]
        whole: BoolArray = total > _LEAST_SUM
        return replace(shown, chromaticity=np.where(whole, found / np.where(whole, total, 1), shown.chromaticity))
