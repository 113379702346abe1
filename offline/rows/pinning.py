"""Colour of every pixel where colour sites are scattered: each channel is pinned at its own sites.

A tile's one chromaticity says how bright each of its channels is on the whole, but its sites lie pixels apart: each tells the
chromaticity of its own channel at its own place, sample over luminance there. Between them a channel changes little, except across
edges of luminance (the prior of section 3.3). Noise makes a single site worth little, so sites count as far as they show more than
noise: elsewhere the chromaticity pooled over similar tiles stays. None of this is in the paper, whose sites form blocks.
"""

import numpy as np

from shared.arrays import BoolArray, FloatArray
from shared.progress import SILENT, Progress

from ..gaussian import smoothed
from ..kernels.highlights import interpolate
from ..kernels.pinning import HALO, TOLERANCE, pin_samples
from ..kernels.spreading import TILE, tiles_of
from ..settings import SiteSettings
from ..sites import BlockSamples, signal_power, site_reach
from ..solvers import report
from ..tiling import DARK, Part

_SMOOTHNESS, _FADING, _EDGE = 0.1, 1e-3, 0.03
_AROUND = 2.0  # tiles: standard deviation of the neighbourhood whose chromaticity is the base where sites are trusted
_CAUTION = 8.0  # times the noise, that what sites show must exceed to count by half: luminance is uncertain too
_TAPS = 2  # tiles that interpolation between them looks beyond a pixel
_LEAST_SUM = 0.5  # of gamma c: below it, the base stays


def rows_pinned(period: int) -> int:
    """How many rows of a frame `Pinning` looks at, at a time. period: K, pixels."""
    return TILE + 2 * _reach(period)


def _reach(period: int) -> int:
    return HALO + site_reach(period) + _TAPS * period


def _share(power: FloatArray, noise: FloatArray | None) -> FloatArray:
    """How far sites count that miss the picture by `power`, where `noise` is the variance of their noise: 0 to 1, float32."""
    if noise is None:
        return np.ones_like(power)
    total: FloatArray = np.maximum(power + np.float32(_CAUTION) * noise, np.finfo(np.float32).tiny)
    return power / total


class Pinning:
    """How the sites of a frame pin its chromaticity.

    blocks: chromaticity of every tile, (tile rows, tile columns, C).
    sites: the samples of all whole tiles. gamma: (C,), the weights of Eq. 7.
    progress: hears what the solver did.
    """

    def __init__(
        self,
        blocks: FloatArray,
        sites: BlockSamples,
        gamma: tuple[float, ...],
        settings: SiteSettings,
        progress: Progress = SILENT,
    ) -> None:
        self._sites, self._gamma, self._settings, self._progress = sites, np.array(gamma, np.float32), settings, progress
        self._around = np.ascontiguousarray(smoothed(np.moveaxis(blocks, 2, 0), _AROUND))

    @property
    def steps(self) -> tuple[int, int, int]:
        """(reach, step, origin) for `tiling.windows`."""
        return _reach(self._sites.sites.grid.period), TILE, 0

    def applied(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows of a part of the picture, which reaches `steps[0]` rows beyond them.

        Raises ConvergenceError when conjugate gradients do not reach their tolerance.
        """
        sites, gamma = self._sites, self._gamma
        tiles = sites.within(part)
        if tiles.start >= tiles.stop:
            return part.rows(*rows)
        variance = sites.scaled_variance(gamma, tiles)
        noise = None if variance is None else variance.mean(axis=2)
        power = signal_power(sites.error(part, gamma, tiles), noise, self._settings.deviations)
        share = _share(power, noise) * sites.unclipped[tiles]
        places = [place for _, *place in sites.inside(part, tiles)]
        lights = np.stack([part.luminance[*place] for place in places], axis=2)
        # A ratio is the less certain the darker its site is.
        squared = np.square(lights) / np.maximum(np.square(lights).mean(axis=2, keepdims=True), DARK**2)
        trust = _share(power[..., None] * squared, variance) * np.minimum(squared, 1) * sites.unclipped[tiles, :, None]
        ratios, weights = np.zeros_like(part.luminance), np.zeros_like(part.luminance)
        for site, place in enumerate(places):
            light = lights[..., site]
            lit = light > DARK
            ratios[*place] = np.where(lit, sites.samples[tiles, :, site] / np.where(lit, light, 1), 0)
            weights[*place] = np.where(lit, trust[..., site], 0)
        return self._pinned(part, rows, self._base(part, share, tiles), ratios, weights)

    def _base(self, part: Part, share: FloatArray, tiles: slice) -> FloatArray:
        """The picture's own chromaticity as far as noise hides what sites show, otherwise that of a wide neighbourhood."""
        grid = self._sites.sites.grid
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
        channels = self._sites.sites.pattern.filter_map(part.luminance.shape, (part.first, 0))
        shown = part.rows(*rows)
        found = np.empty_like(shown.chromaticity)
        prior = _SMOOTHNESS, _FADING, _EDGE
        tiles = tiles_of(rows, part.luminance.shape[1])
        residuals, used = np.empty(tiles), np.empty(tiles, np.intp)
        pin_samples(part.luminance, base, channels, ratios, weights, part.first, rows, prior, found, residuals, used)
        report(self._progress, "pinning", used, residuals, TOLERANCE)
        total = (found @ self._gamma)[..., None]
        whole: BoolArray = total > _LEAST_SUM
        return Part(shown.first, shown.luminance, np.where(whole, found / np.where(whole, total, 1), shown.chromaticity))
