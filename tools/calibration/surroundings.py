"""Gamma from what surrounds a chart: every colour block is compared with the panchromatic samples around it.

A scattered tile is its own block, and its panchromatic samples lie among the colours.

A single block is noisy, so its own colour must not decide its weight: least squares would treat noise as colour, and its gamma
would be too small. The colours of the eight neighbour blocks, whose noise is independent, serve as *instruments* z (O. Reiersøl,
1945; W. A. Fuller, Measurement Error Models, Wiley 1987, section 1.4):

    sum_j w_j z_j (l_j - gamma . c_j) = 0

holds for the true gamma whatever the noise is. For the same reason smoothness and weight of a block come from its neighbours.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.ndimage import convolve

from shared import CfaPattern, Mosaic
from shared.arrays import BoolArray, DoubleArray, IndexArray

from .gamma import Assumed, GammaFit, NormalEquations, unknowns
from .samples import CLIPPED, from_middle, levels_of, robust_deviation

_REACH = 2  # pixels: width of the ring of panchromatic samples around a block
_LEAST_RING = 8  # panchromatic samples of a scattered tile, through which a linear surface is fitted
_DARK = 0.0015  # of full scale: in darker places an error of the black level is large
_NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], float)
_LEAST_NEIGHBOURS = 6
_SMOOTH = 2.0  # largest roughness of a smooth place, over that of the smoothest tenth at its level
_LEVELS, _TEXTURES = 10, 8  # numbers of classes of blocks that share a variance
_HUBER = 4.0  # standard deviations; with less, the skew of texture would count as colour
_ROUNDS = 12
_FLOOR = 0.004  # of gamma: error that texture causes on photographs, however many blocks there are
_FLOOR_OFFSET = 5e-4  # of full scale: the same for the offset
_LEAST_BLOCKS = 300
_LEAST_STRENGTH = 12.0  # strength of the instruments in the weakest direction, in standard deviations
_VAGUE = 0.2  # half width over gamma: beyond it there is hardly any colour, and the interval cannot be trusted


def fit_surroundings(mosaic: Mosaic, chart: BoolArray, where: DoubleArray, assumed: Assumed | None = None) -> GammaFit | None:
    """Estimate gamma, for any number of channels, from the smooth places around a chart; None = they have too little colour.

    mosaic: the shot.
    chart: (H, W), pixels of the chart, whose blocks are left out.
    where: the place for which gamma is stated, see `GammaFit`.
    assumed: what may be off; None = nothing was measured, see `Assumed.of`.
    """
    assumed = assumed or Assumed.of(mosaic.calibration)
    blocks = _blocks(mosaic, chart)
    level, colours = blocks.level, blocks.colours
    if len(level) < _LEAST_BLOCKS:
        return None
    channels = colours.shape[1]
    terms, known = unknowns(colours, blocks.where), unknowns(blocks.instruments, blocks.where)
    found = np.zeros(terms.shape[1])
    found[:channels], *_ = np.linalg.lstsq(colours, level, rcond=None)
    equations, deviation = NormalEquations(np.zeros(0), found), np.ones(len(level))
    for _ in range(_ROUNDS):
        residual = level - terms @ found
        deviation = _deviation(residual, blocks.classes)
        weight = np.minimum(1, _HUBER * deviation / np.maximum(np.abs(residual), 1e-12)) / deviation**2
        weighted = known * weight[:, None]
        # The instruments' moments, Z'(l - X x) = 0, by their own covariance (generalized method of moments, two steps).
        moments = weighted * residual[:, None]
        size = np.sqrt((moments**2).sum(axis=0))
        unlike = np.linalg.pinv((moments / size).T @ (moments / size), hermitian=True) / size[:, None] / size
        slopes = unlike @ (weighted.T @ terms)
        equations = NormalEquations((weighted.T @ terms).T @ slopes, slopes.T @ (weighted.T @ level))
        found, _ = equations.solved(assumed, mosaic.calibration)
    if _strength(blocks, deviation) < _LEAST_STRENGTH:
        return None
    residual = level - terms @ found
    fit = GammaFit(
        equations=_with_texture(equations, found[:channels]),
        assumed=assumed,
        calibration=mosaic.calibration,
        freedom=len(level) - channels,
        level=level,
        predicted=terms @ found,
        used=np.abs(residual) <= _HUBER * deviation,
        condition=float(np.linalg.cond(blocks.instruments / blocks.instruments.sum(axis=1, keepdims=True))),
        spread=1.0,
        where=where,
    )
    return fit if fit.gamma.min() > 0 and fit.worst < _VAGUE else None


def _with_texture(equations: NormalEquations, gamma: DoubleArray) -> NormalEquations:
    """Return the information if texture adds errors of _FLOOR to gamma and _FLOOR_OFFSET to the offset: Woodbury's identity."""
    information, right_hand_side = equations.information, equations.right_hand_side
    count = len(gamma) + 1
    errors = np.append(_FLOOR * np.abs(gamma), _FLOOR_OFFSET)
    of_these = information[:, :count]
    part = of_these @ np.linalg.inv(np.diag(errors**-2.0) + of_these[:count])
    information = information - part @ of_these.T
    return NormalEquations((information + information.T) / 2, right_hand_side - part @ right_hand_side[:count])


@dataclass(frozen=True, eq=False)
class _Blocks:
    """N blocks in smooth places.

    level: (N,), panchromatic, at a block's centre.
    colours: (N, C), the channels there.
    where: (N, 2), see `from_middle`.
    instruments: (N, C), mean colours of the blocks around.
    classes: (N,), blocks of one class share a variance.
    """

    level: DoubleArray
    colours: DoubleArray
    where: DoubleArray
    instruments: DoubleArray
    classes: IndexArray


def _blocks(mosaic: Mosaic, excluded: BoolArray) -> _Blocks:
    """Measure every whole block that has a ring around it, or every scattered tile, and choose those in smooth places."""
    pattern, levels = mosaic.pattern, levels_of(mosaic.evenly_shaded()).astype(np.float64)
    grid, tiles, period = pattern.grid(mosaic.shape), _tiles_together(pattern), pattern.period
    high, wide = (size + (tiles - 1) * period for size in pattern.block_shape)
    reach = min(_REACH, period - max(pattern.block_shape))
    rows, columns = (
        origins[(origins >= reach) & (origins + size + reach <= length)][::tiles]
        for origins, size, length in zip((grid.rows, grid.columns), (high, wide), mosaic.shape, strict=True)
    )
    first = pattern.block_origin[0] - reach, pattern.block_origin[1] - reach
    ring = np.argwhere(pattern.panchromatic_mask((high + 2 * reach, wide + 2 * reach), first)) - reach
    middle = np.array([(high - 1) / 2, (wide - 1) / 2])

    def at(row: int, column: int) -> DoubleArray:
        return levels[np.ix_(rows + row, columns + column)]

    white = np.stack([at(*place) for place in ring], axis=-1) if rows.size and columns.size else np.zeros((0, 0, len(ring)))
    design = np.concatenate([np.ones((len(ring), 1)), ring - middle], axis=1)
    plane = white @ np.linalg.pinv(design).T
    texture = ((white - plane @ design.T) ** 2).sum(axis=-1) / (len(ring) - 3)
    level = plane[..., 0]
    colours, shading = np.zeros((*level.shape, len(pattern.channels))), np.zeros((*level.shape, len(pattern.channels)))
    brightest = white.max(axis=-1, initial=0)
    tops = lefts = range(0, tiles * period, period)
    for top, left, (down, across, channel) in product(tops, lefts, pattern.sites):
        place = top + down, left + across
        slope = plane[..., 1:] @ (np.array(place) - middle)
        sample = at(*place)
        colours[..., channel] += sample
        # The light falls off equally for all filters.
        shading[..., channel] += np.clip(1 + slope / np.maximum(level, 1e-6), 0.5, 2)
        brightest = np.maximum(brightest, sample)
    usable = (brightest < CLIPPED) & ~excluded[np.ix_(rows, columns)]
    places = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2) + middle
    where = from_middle(places[:, 0], places[:, 1], mosaic.shape)
    return _chosen(level, colours / shading, texture, usable, where.reshape(*level.shape, 2))


def _tiles_together(pattern: CfaPattern) -> int:
    """Return how many tiles, along each side, are measured as one block: as many as have enough panchromatic samples.

    Do not look for more of them around a tile instead: they would see another part of the scene than its colours, and on
    photographs errors exceeded their intervals.
    """
    if not pattern.is_scattered:
        return 1
    return int(np.ceil(np.sqrt(_LEAST_RING / (pattern.period**2 - len(pattern.sites)))))


def _chosen(level: DoubleArray, colours: DoubleArray, texture: DoubleArray, usable: BoolArray, where: DoubleArray) -> _Blocks:
    """Choose the blocks in smooth places.

    level, colours, where: as in `_Blocks`, but on the grid (n, m) of all blocks.
    texture: (n, m), variance of the ring about a linear surface.
    usable: (n, m), whether nothing is clipped or excluded.
    """
    number = convolve(usable.astype(np.float64), _NEIGHBOURS, mode="constant")

    def around(values: DoubleArray) -> DoubleArray:
        total: DoubleArray = convolve(values * usable, _NEIGHBOURS, mode="constant")
        return total / np.maximum(number, 1)

    near = around(level)
    roughness = around(texture) + np.maximum(around(level**2) - near**2, 0) / 10
    instruments = np.stack([around(plane) for plane in np.moveaxis(colours, -1, 0)], axis=-1)
    good = usable & (number >= _LEAST_NEIGHBOURS) & (near > _DARK)
    near, roughness = near[good], roughness[good]
    classes = np.full(near.size, -1)
    for bright, at_level in enumerate(np.array_split(np.argsort(near), _LEVELS)):
        if not at_level.size:
            continue
        by_roughness = at_level[np.argsort(roughness[at_level])]
        smooth = by_roughness[roughness[by_roughness] <= _SMOOTH * np.quantile(roughness[at_level], 0.1)]
        for rough, alike in enumerate(np.array_split(smooth, _TEXTURES)):
            classes[alike] = bright * _TEXTURES + rough
    chosen = classes >= 0
    level, colours, where, instruments = (values[good][chosen] for values in (level, colours, where, instruments))
    return _Blocks(level, colours, where, instruments, classes[chosen])


def _deviation(residual: DoubleArray, classes: IndexArray) -> DoubleArray:
    """Return the standard deviation of each residual: a robust one for its class."""
    deviation = np.ones(residual.size)
    for index in np.unique(classes):
        alike = classes == index
        deviation[alike] = robust_deviation(residual[alike])
    return np.maximum(deviation, max(0.05 * robust_deviation(residual), 1e-9))


def _strength(blocks: _Blocks, deviation: DoubleArray) -> float:
    """Return how well the neighbours' chromaticities predict a block's own in the weakest direction, in standard deviations.

    Where they do not, there is only noise, not colour.
    """
    total = blocks.instruments.sum(axis=1, keepdims=True)
    grey = np.average(blocks.instruments / total, axis=0, weights=total[:, 0])
    expected, found = (values - total * grey for values in (blocks.instruments, blocks.colours))
    weighted = expected / deviation[:, None] ** 2
    # Chromaticities lie in a plane, so one direction of the C is empty by construction.
    directions = np.linalg.eigh(weighted.T @ expected)[1][:, 1:].T
    return min(float(d @ weighted.T @ found @ d / np.sqrt(d @ weighted.T @ expected @ d)) for d in directions)
