"""Colour of every pixel where colour sites are scattered: each channel is pinned at its own sites.

The chromaticity of a tile describes it as a whole, but its sites lie pixels apart: each measures the chromaticity of its own
channel at its own place, sample over luminance there. Between them a channel changes little, except across
edges of luminance (the prior of section 3.3). Noise makes a single site worth little, so sites count as far as they show more than
noise: elsewhere the chromaticity pooled over similar tiles stays. None of this is in the paper, whose sites form blocks.

Chromaticity from colour sites that are scattered: each channel is pinned at its own sites and spreads from there.

The field of a channel is the one that stays close to what its sites measured and changes little from pixel to pixel, except across
edges of luminance: a sum of squares, whose minimum conjugate gradients find. It departs from a base, a first guess, to which it
fades where no site is trusted.
"""

from dataclasses import dataclass, replace
from functools import cached_property

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


HALO = 16
"""Pixels around a tile that are solved with it: colour sites are near everywhere, so fields beyond have no influence. Chosen."""
TOLERANCE = 1e-4
"""Relative residual at which conjugate gradients stop. Chosen."""
_ZERO = np.float32(0)


@parallel_kernel()
def pin_samples(
    pieces: Pieces,
    luminance: Floats2,
    base: Floats3,
    channels: Bytes2,
    ratios: Floats2,
    weights: Floats2,
    first: int,
    rows: Pair,
    prior: Prior,
    out: Floats3,
    residuals: Doubles1,
    used: Ints1,
) -> None:
    """Find the chromaticity of some rows of the frame.

    luminance, base: (rows, W) and (rows, W, C), a part of the picture that reaches `HALO` beyond the rows to find.
    channels: (rows, W), the channel of each colour site; C elsewhere.
    ratios: (rows, W), chromaticity of that channel as its site measured it.
    weights: (rows, W), how far the site is trusted, 0 to 1.
    first: the frame's row at luminance[0].
    rows: first and end row to find; the first is a multiple of `TILE`.
    prior: smoothness and fading relative to a site of weight 1, and the difference of luminance, scene units, that is an edge.
    out: (rows, W, C), written.
    residuals, used: (tiles,), written: see `spreading.spread_samples`; the worst of all channels.
    """
    (height, width), count = luminance.shape, base.shape[2]
    for number in range(pieces[0], pieces[1]):
        top, bottom, left, right = tile_at(number, (rows[1] - rows[0], width), (TILE, TILE))
        top, bottom = rows[0] - first + top, rows[0] - first + bottom
        above, below, before, after = max(top - HALO, 0), min(bottom + HALO, height), max(left - HALO, 0), min(right + HALO, width)
        size = below - above, after - before
        links, normal, right_side, fields = zeros(4, *size), zeros(count, *size), zeros(count, *size), zeros(count, *size)
        link(luminance[above:below, before:after], prior, links)
        for row in range(size[0]):
            for column in range(size[1]):
                y, x = above + row, before + column
                channel, weight = channels[y, x], weights[y, x]
                if channel < count:
                    normal[channel, row, column] = weight
                    right_side[channel, row, column] = weight * (ratios[y, x] - base[y, x, channel])
        residuals[number], used[number] = solve(normal, right_side, links, np.float32(prior[1]), TOLERANCE, fields)
        for y in range(top, bottom):
            for x in range(left, right):
                for channel in range(count):
                    out[y - rows[0] + first, x, channel] = base[y, x, channel] + fields[channel, y - above, x - before]
