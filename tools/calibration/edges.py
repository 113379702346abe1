"""The places of a shot with the most edges: colour samples, and the luminance around them.

Luminance at a colour site is filled in; its error is about as large as the curvature of luminance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Literal, NamedTuple

import numpy as np
from scipy import ndimage

from shared import Mosaic
from shared.aberration import half_diagonal
from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.errors import InputError

from .samples import CLIPPED

Filled = Callable[[Mosaic], tuple[FloatArray, NoiseModel]]
"""Returns the luminance of a mosaic, filled in at colour sites, float32 (H, W), scene units, and the noise of its samples."""

_FARTHEST = 9.0  # pixels: largest displacement for which luminance is known
_NEAR, _WIDE = 0.5, 1.0  # pixels to each side of a slope
_MARGIN = 11  # pixels around a window: the reach, and what cubic splines see beyond
_SIDE, _BLOCKS = 24, 3  # pixels along a side of a window, and blocks, at least
_TILES = 8  # along an axis: edges are taken from everywhere
_MOST_SAMPLES = 100_000  # colour samples of a shot
_LEAST = 12  # windows
_FLAT = 0.01  # share of the light: less contrast than this is no edge
_EVERY, _DARK = 7, 0.01  # one of so many pixels decides; share of full scale that the brightest have to exceed
_BLACK = 1e-3  # of full scale
_NOISY = 1.5  # times what noise alone has: windows with less have no edges
_HOLES = 0.7  # pixels: standard deviation of the mean of squared curvature
_LEAST_NOISE = 0.002  # of full scale, read noise at least
_SLOPE, _AROUND = 1.2, 2.0  # pixels: standard deviations, of what slopes and their directions are taken from
_STRAIGHT = 0.5, 0.9  # coherence of slopes: from which on edges are straight, and which are so entirely
_STEP = 2.0  # pixels to both sides along an edge, where holes end
_ROUNDS = 3  # number of fill-and-refit iterations
_BORDER = 4  # pixels of a window in which nothing is filled anew
_CURVED = 20  # times its variance is what noise adds to the squared Laplacian


class DisplacedLuminance(NamedTuple):
    """Luminance at displaced samples; all (N, S), scene units.

    value: by cubic splines.
    down, right: its derivatives, per pixel.
    fill_variance: of what is filled in, up to a factor.
    """

    value: DoubleArray
    down: DoubleArray
    right: DoubleArray
    fill_variance: DoubleArray


@dataclass(frozen=True, eq=False)
class Edges:
    """N windows of one shot, each with S colour samples at the same places of the pattern; C channels.

    name: of the shot.
    shape: (rows, columns) of the frame.
    focal_length: of the lens, millimetres; None = unknown.
    channels, gamma: of the camera.
    channel: (S,), of each sample.
    place: (S, 2), row and column of each sample in its window.
    line: (2, N), row and column of windows that a window lies in.
    down, right: (N, S), where samples lie, from the middle of the frame, in half diagonals.
    sample: (N, S), scene units; variance: (N, S), of its noise.
    noise: (N, 1), variance of the noise of luminance.
    """

    name: str
    shape: tuple[int, int]
    focal_length: float | None
    channels: str
    gamma: DoubleArray
    channel: IndexArray
    place: IndexArray
    line: IndexArray
    down: DoubleArray
    right: DoubleArray
    sample: DoubleArray
    variance: DoubleArray
    noise: DoubleArray
    _spline: FloatArray  # (N, height, width): windows of luminance with their margins, as coefficients
    _curvature: FloatArray  # likewise, squared

    def luminance(self, down: DoubleArray, right: DoubleArray) -> DoubleArray:
        """Return luminance at the samples, displaced by these numbers of pixels; all (N, S)."""
        return self._at(self._spline, down, right, 3)

    def displaced(self, down: DoubleArray, right: DoubleArray) -> DisplacedLuminance:
        """Return luminance, its slopes and its variance where samples are displaced by so much, pixels, (N, S)."""
        variance = self._at(self._curvature, down, right, 1)
        return DisplacedLuminance(self.luminance(down, right), *self._slopes(down, right, _NEAR), variance)

    def wide_slopes(self, down: DoubleArray, right: DoubleArray) -> DoubleArray:
        """Return differences over more pixels, which hardly depend on errors of luminance there, per pixel, (2, N, S)."""
        return np.stack(self._slopes(down, right, _WIDE))

    def _slopes(self, down: DoubleArray, right: DoubleArray, reach: float) -> tuple[DoubleArray, DoubleArray]:
        def slope(y: float, x: float) -> DoubleArray:
            return (self.luminance(down + y, right + x) - self.luminance(down - y, right - x)) / (2 * reach)

        return slope(reach, 0), slope(0, reach)

    def _at(self, plane: FloatArray, down: DoubleArray, right: DoubleArray, order: Literal[1, 3]) -> DoubleArray:
        count, height, width = plane.shape
        first = np.arange(count)[:, None] * height + _MARGIN
        down, right = (np.clip(each, -_FARTHEST, _FARTHEST) for each in (down, right))
        y, x = first + self.place[:, 0] + down, self.place[:, 1] + right
        return ndimage.map_coordinates(plane.reshape(-1, width), [y, x + _MARGIN], np.float64, order, prefilter=False)

    def chosen(self, which: IndexArray) -> "Edges":
        """Return some of the windows."""
        names = ("down", "right", "sample", "variance", "noise", "_spline", "_curvature")
        return replace(self, line=self.line[:, which], **{name: getattr(self, name)[which] for name in names})

    def of_channels(self, values: DoubleArray) -> DoubleArray:
        """Return sums over the samples of each channel: (N, S) -> (N, C)."""
        return np.stack([values[:, self.channel == each].sum(axis=1) for each in range(len(self.channels))], axis=1)


def find_edges(name: str, mosaic: Mosaic, filled: Filled, gamma: DoubleArray | None = None) -> Edges:
    """Return the windows of a shot with the most edges.

    name: of the shot.
    filled: recovers luminance.
    gamma: in place of the calibration's; None = that.

    Raises InputError if it has hardly any.
    """
    even = mosaic.evenly_shaded()
    pattern, shape, signal, full = even.pattern, even.shape, even.signal, even.calibration.full_scale
    if np.quantile(signal[::_EVERY, ::_EVERY], 0.99) < _DARK * full:
        raise InputError("it is dark; expose more")
    luminance, noise = filled(even)
    # Otherwise flat places, where all fits, would decide how much edges may be off.
    noise = replace(noise, read=tuple(max(each, _LEAST_NOISE * full) for each in noise.read))
    variance = noise.shot[-1] * np.maximum(luminance, 0) + noise.read[-1] ** 2
    side = max(_BLOCKS, -(-_SIDE // pattern.period)) * pattern.period
    corners = [
        np.arange(_MARGIN + (origin - _MARGIN) % pattern.period, length - side - _MARGIN + 1, side)
        for origin, length in zip(pattern.block_origin, shape, strict=True)
    ]
    top, left = (each.ravel() for each in np.meshgrid(*corners, indexing="ij"))
    clipped = _sums((signal >= CLIPPED * full).astype(np.float32), top, left, side, _MARGIN) > 0
    down, right = np.gradient(luminance)
    slopes = (down**2 + right**2) / (variance + (_FLAT * np.maximum(luminance, _BLACK * full)) ** 2)
    score = _sums(slopes, top, left, side)
    tile = top * _TILES // shape[0] * _TILES + left * _TILES // shape[1]
    per_window = len(pattern.sites) * (side // pattern.period) ** 2
    kept = _strongest(
        np.where(clipped | (score < _NOISY * side**2), 0, score), tile, max(1, _MOST_SAMPLES // per_window // _TILES**2)
    )
    if len(kept) < _LEAST:
        if clipped.mean() > 0.5:
            raise InputError(f"{100 * clipped.mean():.0f} % of the frame have clipped samples; expose less")
        raise InputError("it has hardly any edges, or is too small; take a scene with many sharp edges all over the frame")
    top, left = top[kept], left[kept]
    curvature = ndimage.gaussian_filter(ndimage.laplace(luminance) ** 2, _HOLES) - _CURVED * variance
    planes = pattern.filter_map((side, side), (int(top[0]), int(left[0])))
    place = np.argwhere(planes < len(pattern.channels))
    channel = planes[*place.T].astype(np.intp)
    rows, columns = top[:, None] + place[:, 0], left[:, None] + place[:, 1]
    sample = signal[rows, columns].astype(np.float64)
    shot, read = (np.array(figures)[channel] for figures in (noise.shot, noise.read))
    half = np.float64(half_diagonal(shape))
    reach = side + 2 * _MARGIN
    holes = ~pattern.panchromatic_mask((reach, reach), (int(top[0]) - _MARGIN, int(left[0]) - _MARGIN))
    windows = _cut(luminance, top, left, side)
    if not pattern.is_scattered:  # whose holes are single pixels
        windows = fill_along_edges(windows, holes)
    return Edges(
        name,
        shape,
        mosaic.metadata.focal_length,
        pattern.channels,
        np.array(even.calibration.gamma) if gamma is None else gamma,
        channel,
        place,
        np.stack([top, left]) // side,
        (rows - (shape[0] - 1) / 2) / half,
        (columns - (shape[1] - 1) / 2) / half,
        sample,
        shot * np.maximum(sample, 0) + read**2,
        _cut(variance, top, left, side).mean(axis=(1, 2), dtype=np.float64)[:, None],
        _splines(windows),
        _cut(curvature, top, left, side).clip(0),
    )


def _cut(plane: FloatArray | DoubleArray, top: IndexArray, left: IndexArray, side: int) -> FloatArray:
    """Return windows of a plane with their margins, (N, height, width)."""
    reach = np.arange(-_MARGIN, side + _MARGIN)
    return plane[(top[:, None] + reach)[:, :, None], (left[:, None] + reach)[:, None, :]].astype(np.float32)


def fill_along_edges(windows: FloatArray, holes: BoolArray) -> FloatArray:
    """Return windows of luminance, (N, height, width), with holes filled along the edges that run straight through them.

    holes: (height, width), those of every window.
    """
    inner = np.zeros_like(holes)
    inner[_BORDER:-_BORDER, _BORDER:-_BORDER] = True
    row, column = np.nonzero(holes & inner)
    slopes = [ndimage.gaussian_filter(windows, (0, _SLOPE, _SLOPE), order) for order in ((0, 1, 0), (0, 0, 1))]
    down, both, right = (
        ndimage.gaussian_filter(one * other, (0, _AROUND, _AROUND))[:, row, column]
        for one, other in combinations_with_replacement(slopes, 2)
    )  # the structure tensor (Bigun, Granlund 1987)
    angle = np.arctan2(2 * both, right - down) / 2
    straight = np.hypot(right - down, 2 * both) / np.maximum(right + down, np.finfo(np.float32).tiny)
    weight = ((straight - _STRAIGHT[0]) / (_STRAIGHT[1] - _STRAIGHT[0])).clip(0, 1)
    along, filled = _STEP * np.stack([np.cos(angle), -np.sin(angle)]), windows.copy()
    first = np.arange(len(windows))[:, None] * windows.shape[1] + row
    for _ in range(_ROUNDS):
        spline = _splines(filled).reshape(-1, windows.shape[2])
        ends = [
            ndimage.map_coordinates(spline, [first + side * along[0], column + side * along[1]], np.float32, prefilter=False)
            for side in (-1, 1)
        ]
        filled[:, row, column] += weight * ((ends[0] + ends[1]) / 2 - filled[:, row, column])
    return filled


def _splines(windows: FloatArray) -> FloatArray:
    """Return the coefficients of the cubic splines through windows, (N, height, width)."""
    for axis in (1, 2):
        windows = ndimage.spline_filter1d(windows, 3, axis, np.float32, mode="mirror")
    return windows


def _sums(plane: FloatArray | DoubleArray, top: IndexArray, left: IndexArray, side: int, margin: int = 0) -> DoubleArray:
    """Return the sum of a plane over each window, (N,), and as much around it as the margin."""
    total = np.pad(plane.cumsum(axis=0, dtype=np.float64).cumsum(axis=1), ((1, 0), (1, 0)))
    first, last = (top - margin, left - margin), (top + side + margin, left + side + margin)
    return total[*last] - total[first[0], last[1]] - total[last[0], first[1]] + total[*first]


def _strongest(score: DoubleArray, tile: IndexArray, most: int) -> IndexArray:
    """Return the windows with the highest scores, `most` of each tile at most, in their order."""
    order = np.lexsort((-score, tile))
    first = np.searchsorted(tile[order], tile[order])
    taken = order[(np.arange(len(order)) - first < most) & (score[order] > 0)]
    return np.sort(taken)
