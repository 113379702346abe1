"""Colour of every pixel where colour sites are scattered: each channel is pinned at its own sites and spreads from there.

The chromaticity of a tile describes it as a whole, but its sites lie pixels apart: each measures the chromaticity of its own
channel at its own place, r[n] = sample over luminance. Between them a channel changes little, except across edges of luminance (the
prior of section 3.3). Noise makes a single site worth little, so sites count as far as they show more than noise: elsewhere the
chromaticity pooled over similar tiles stays. None of this is in the paper, whose sites form blocks.

Of each channel, the difference x from a base chromaticity b minimises

    sum_n w[n] (b[n] + x[n] - r[n])^2 + f sum_n x[n]^2 + sum_nn' s (x[n] - x[n'])^2 / (1 + ((l[n] - l[n']) / t)^2),

with the confidence w in a site (0 elsewhere), fading f, smoothness s, luminance l and an edge t (`numerics.linked`). The base is
the picture's own chromaticity as far as noise hides what sites show, otherwise that of a wide neighbourhood.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from shared.arrays import BoolArray, FloatArray
from shared.progress import SILENT, Progress

from ..measured import BlockSamples, Measured
from ..numerics.arrays import Bytes2, Doubles1, Floats2, Floats3, Ints1, Pair
from ..numerics.compile import Pieces, parallel_kernel
from ..numerics.functions import tile_at, zeros
from ..numerics.gaussian import smoothed
from ..numerics.interpolation import interpolate
from ..numerics.linked import TILE, Prior, link, solve, tiles_of
from ..numerics.solvers import report
from ..parts import DARK, Look, Part, RowStage
from .correction import signal_power, site_reach

# Chosen; in brackets, by how many decibels half or twice changes Kodak's tile at sigma 0.01 (README).
_SMOOTHNESS, _FADING = 0.1, 1e-3  # of the solution, relative to the precision of a sample (0.1, 0.1)
_EDGE = 0.05  # difference of luminance that is an edge, a share of the mean luminance (0.2)
_TINY = 1e-6  # scene units: the least difference that is an edge
_AROUND = 2.0  # tiles: standard deviation of the neighbourhood whose chromaticity is the base where sites are trusted (0.1)
_CAUTION = 8.0  # times the noise, that what sites show must exceed to count by half: luminance is uncertain too (0.0)
_TAPS = 2  # tiles that interpolation between them looks beyond a pixel: cubic convolution has four taps
_BYTES, _CHANNEL = 29.0, 12.0  # of memory, per pixel of the rows that are held, and per channel of them: measured
_LEAST_SUM = 0.5  # of gamma c, which is about 1: below it, the base stays (0.2)


def _confidence(power: FloatArray, noise: FloatArray | None) -> FloatArray:
    """Confidence in sites, 0 to 1, float32. power: squared residual of the picture there. noise: variance; None = there is none."""
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
        """Dependence of a pixel: its neighbours, and the tiles around those."""
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
        confidence = _confidence(power, noise) * samples.unclipped[tiles]
        places = samples.inside(part, tiles)
        luminance = np.stack([part.luminance[place] for place in places], axis=2)
        # A ratio is the less certain the darker its site is.
        squared = np.square(luminance) / np.maximum(np.square(luminance).mean(axis=2, keepdims=True), DARK**2)
        weight = _confidence(power[..., None] * squared, variance) * np.minimum(squared, 1) * samples.unclipped[tiles, :, None]
        if samples.lines is not None:
            apart = 1 - samples.lines.share[tiles]
            confidence, weight = confidence * apart, weight * apart[..., None]
        ratios, weights = np.zeros_like(part.luminance), np.zeros_like(part.luminance)
        for site, place in enumerate(places):
            lit = luminance[..., site] > DARK
            ratios[place] = np.where(lit, samples.samples[tiles, :, site] / np.where(lit, luminance[..., site], 1), 0)
            weights[place] = np.where(lit, weight[..., site], 0)
        return self._pinned(part, rows, self._base(part, confidence, tiles), ratios, weights)

    def _base(self, part: Part, confidence: FloatArray, tiles: slice) -> FloatArray:
        """The picture's own chromaticity as far as noise hides what sites show, otherwise that of a wide neighbourhood."""
        grid = self.measured.grid
        trusted, plane = np.empty_like(part.luminance), np.empty_like(part.luminance)
        half = (grid.period - 1) / 2
        interpolate(
            confidence,
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
        own, tiles = part.rows(*rows), tiles_of(rows, part.luminance.shape[1])
        pinned = Pinned(np.empty_like(own.chromaticity), np.empty(tiles), np.empty(tiles, np.intp))
        sites, prior = SiteRatios(channels, ratios, weights), (_SMOOTHNESS, _FADING, self._edge)
        pin_samples(part.luminance, base, sites, (rows[0] - part.first, rows[1] - part.first), prior, pinned)
        report(self.progress, "pinning", pinned.used, pinned.residuals, TOLERANCE)
        total = (pinned.chromaticity @ self.measured.gamma)[..., None]
        whole: BoolArray = total > _LEAST_SUM
        return replace(own, chromaticity=np.where(whole, pinned.chromaticity / np.where(whole, total, 1), own.chromaticity))


HALO = 16
"""Pixels around a tile that are solved with it: colour sites are near everywhere, so fields beyond have no influence. Chosen."""
TOLERANCE = 1e-4
"""Relative residual at which conjugate gradients stop. Chosen."""


class SiteRatios(NamedTuple):
    """Samples of the sites, (rows, W).

    channels: the channel of each colour site; C elsewhere.
    ratios: chromaticity of that channel.
    weights: confidence in the site, 0 to 1.
    """

    channels: Bytes2
    ratios: Floats2
    weights: Floats2


class Pinned(NamedTuple):
    """Results, written.

    chromaticity: (rows, W, C).
    residuals, used: (tiles,), relative residual of the worst channel, and iterations.
    """

    chromaticity: Floats3
    residuals: Doubles1
    used: Ints1


@parallel_kernel(pieces=lambda *arguments: len(arguments[-1].used))
def pin_samples(
    pieces: Pieces, luminance: Floats2, base: Floats3, sites: SiteRatios, rows: Pair, prior: Prior, pinned: Pinned
) -> None:
    """Find the chromaticity of some rows of the frame.

    luminance, base: (rows, W) and (rows, W, C), a part of the picture that reaches `HALO` beyond the rows to find.
    rows: first and end row to find, of the part; tiles begin at the first.
    """
    (height, width), count = luminance.shape, base.shape[2]
    for number in range(pieces[0], pieces[1]):
        top, bottom, left, right = tile_at(number, (rows[1] - rows[0], width), (TILE, TILE))
        above, below = max(rows[0] + top - HALO, 0), min(rows[0] + bottom + HALO, height)
        before, after = max(left - HALO, 0), min(right + HALO, width)
        size = below - above, after - before
        links, normal, right_side, change = zeros(4, *size), zeros(count, *size), zeros(count, *size), zeros(count, *size)
        link(luminance[above:below, before:after], prior, links)
        for y in range(above, below):
            for x in range(before, after):
                channel, weight = sites.channels[y, x], sites.weights[y, x]
                if channel < count:
                    normal[channel, y - above, x - before] = weight
                    right_side[channel, y - above, x - before] = weight * (sites.ratios[y, x] - base[y, x, channel])
        fading = np.float32(prior[1])
        pinned.residuals[number], pinned.used[number] = solve(normal, right_side, links, fading, TOLERANCE, change)
        for row in range(top, bottom):
            y = rows[0] + row
            for x in range(left, right):
                for channel in range(count):
                    pinned.chromaticity[row, x, channel] = base[y, x, channel] + change[channel, y - above, x - before]
