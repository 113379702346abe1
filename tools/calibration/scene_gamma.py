"""Gamma from an ordinary scene: every colour block is compared with the panchromatic samples around it.

A scattered tile is its own block, and its panchromatic samples lie among the colours.

A single block is noisy, so its own colour must not decide its weight: least squares would treat noise as colour, and its gamma
would be too small. The colours of the eight neighbour blocks, whose noise is independent, serve as *instruments* z (O. Reiersøl,
1945; W. A. Fuller, Measurement Error Models, Wiley 1987, section 1.4):

    sum_j w_j z_j (l_j - gamma . c_j) = 0

holds for the true gamma whatever the noise is. For the same reason smoothness and weight of a block come from its neighbours.
"""

from itertools import product

import numpy as np
from scipy.ndimage import convolve

from shared import CfaPattern, Mosaic
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

from .assumed import Assumed, unknowns
from .gamma import INSTEAD, GammaFit, solved, too_few_colours
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
LEAST_BLOCKS = 300
LEAST_STRENGTH = 12.0  # strength of the instruments in the weakest direction, in standard deviations


def fit_scene_gamma(mosaic: Mosaic, excluded: BoolArray | None = None, assumed: Assumed | None = None) -> GammaFit:
    """Estimate gamma from the smooth places of a shot, for any number of channels.

    mosaic: the shot.
    excluded: (H, W), pixels whose blocks are left out (a chart, which is measured separately).
    assumed: what may be off; None = nothing was measured, see `Assumed.of`.

    Raises InputError that says what to shoot instead, if there are too few blocks or too little colour.
    """
    assumed = assumed or Assumed.of(mosaic.calibration)
    level, colours, instruments, classes, where = _chosen(*_measured(mosaic, excluded))
    if len(level) < LEAST_BLOCKS:
        raise InputError(
            f"gamma: only {len(level)} colour blocks lie in smooth, well exposed places, and {LEAST_BLOCKS} are needed: {INSTEAD}"
        )
    channels = colours.shape[1]
    terms, known = unknowns(colours, where), unknowns(instruments, where)
    found = np.zeros(terms.shape[1])
    found[:channels], *_ = np.linalg.lstsq(colours, level, rcond=None)
    information, deviation, weighted = np.zeros(0), np.ones(len(level)), known
    told = found
    for _ in range(_ROUNDS):
        residual = level - terms @ found
        deviation = _deviation(residual, classes)
        weight = np.minimum(1, _HUBER * deviation / np.maximum(np.abs(residual), 1e-12)) / deviation**2
        weighted = known * weight[:, None]
        # The instruments' moments, Z'(l - X x) = 0, by their own covariance (generalized method of moments, two steps).
        moments = weighted * residual[:, None]
        size = np.sqrt((moments**2).sum(axis=0))
        unlike = np.linalg.pinv((moments / size).T @ (moments / size), hermitian=True) / size[:, None] / size
        slopes = unlike @ (weighted.T @ terms)
        information, told = (weighted.T @ terms).T @ slopes, slopes.T @ (weighted.T @ level)
        found, _ = solved(information, told, assumed, mosaic.calibration)
    _check_strength(instruments, colours, deviation)
    residual = level - terms @ found
    information, told = _less(information, told, found[:channels])
    return GammaFit(
        information=(information + information.T) / 2,
        told=told,
        assumed=assumed,
        calibration=mosaic.calibration,
        freedom=len(level) - channels,
        level=level,
        predicted=terms @ found,
        used=np.abs(residual) <= _HUBER * deviation,
        condition=float(np.linalg.cond(instruments / instruments.sum(axis=1, keepdims=True))),
        spread=1.0,
    )


def _less(information: DoubleArray, told: DoubleArray, gamma: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Return what a scene tells if texture adds errors of _FLOOR to gamma and _FLOOR_OFFSET to the offset: Woodbury's identity."""
    count = len(gamma) + 1
    unsure = np.append(_FLOOR * np.abs(gamma), _FLOOR_OFFSET)
    of_these = information[:, :count]
    part = of_these @ np.linalg.inv(np.diag(unsure**-2.0) + of_these[:count])
    return information - part @ of_these.T, told - part @ told[:count]


def _measured(mosaic: Mosaic, excluded: BoolArray | None) -> tuple[DoubleArray, DoubleArray, DoubleArray, BoolArray, DoubleArray]:
    """Measure every whole block that has a ring around it, or scattered tile, on the grid (n, m) of them.

    Returns the panchromatic level at a block's centre (n, m), the channels there (n, m, C), the variance of the ring about a linear
    surface (n, m), whether the block can be used (n, m), and where it is (n, m, 2), see `from_middle`.
    """
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
        shading[..., channel] += np.clip(
            1 + slope / np.maximum(level, 1e-6), 0.5, 2
        )  # The light falls off equally for all filters.
        brightest = np.maximum(brightest, sample)
    usable = brightest < CLIPPED
    if excluded is not None:
        usable &= ~excluded[np.ix_(rows, columns)]
    places = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2) + middle
    where = from_middle(places[:, 0], places[:, 1], mosaic.shape)
    return level, colours / shading, texture, usable, where.reshape(*level.shape, 2)


def _tiles_together(pattern: CfaPattern) -> int:
    """Return how many tiles, along each side, are measured as one block: as many as have enough panchromatic samples.

    Do not look for more of them around a tile instead: they would see another part of the scene than its colours, and on
    photographs errors exceeded their intervals.
    """
    if not pattern.is_scattered:
        return 1
    return int(np.ceil(np.sqrt(_LEAST_RING / (pattern.period**2 - len(pattern.sites)))))


def _chosen(
    levels: DoubleArray, colours: DoubleArray, texture: DoubleArray, usable: BoolArray, where: DoubleArray
) -> tuple[DoubleArray, DoubleArray, DoubleArray, np.ndarray, DoubleArray]:
    """Return level (N,), colours and instruments (N, C), class (N,) and place (N, 2) of smooth blocks; see `_measured`."""
    number = convolve(usable.astype(np.float64), _NEIGHBOURS, mode="constant")

    def around(values: DoubleArray) -> DoubleArray:
        total: DoubleArray = convolve(values * usable, _NEIGHBOURS, mode="constant")
        return total / np.maximum(number, 1)

    level = around(levels)
    roughness = around(texture) + np.maximum(around(levels**2) - level**2, 0) / 10
    instruments = np.stack([around(plane) for plane in np.moveaxis(colours, -1, 0)], axis=-1)
    good = usable & (number >= _LEAST_NEIGHBOURS) & (level > _DARK)
    level, roughness = level[good], roughness[good]
    classes = np.full(level.size, -1)
    for bright, at_level in enumerate(np.array_split(np.argsort(level), _LEVELS)):
        if not at_level.size:
            continue
        by_roughness = at_level[np.argsort(roughness[at_level])]
        smooth = by_roughness[roughness[by_roughness] <= _SMOOTH * np.quantile(roughness[at_level], 0.1)]
        for rough, alike in enumerate(np.array_split(smooth, _TEXTURES)):
            classes[alike] = bright * _TEXTURES + rough
    chosen = classes >= 0
    return levels[good][chosen], colours[good][chosen], instruments[good][chosen], classes[chosen], where[good][chosen]


def _deviation(residual: DoubleArray, classes: np.ndarray) -> DoubleArray:
    """Return the standard deviation of each residual: a robust one for its class."""
    deviation = np.ones(residual.size)
    for index in np.unique(classes):
        alike = classes == index
        deviation[alike] = robust_deviation(residual[alike])
    return np.maximum(deviation, max(0.05 * robust_deviation(residual), 1e-9))


def _check_strength(instruments: DoubleArray, colours: DoubleArray, deviation: DoubleArray) -> None:
    """Raise InputError if the neighbours' chromaticities do not predict a block's own: then there is only noise, not colour."""
    total = instruments.sum(axis=1, keepdims=True)
    grey = np.average(instruments / total, axis=0, weights=total[:, 0])
    expected, found = (values - total * grey for values in (instruments, colours))
    weighted = expected / deviation[:, None] ** 2
    # Chromaticities lie in a plane, so one direction of the C is empty by construction.
    directions = np.linalg.eigh(weighted.T @ expected)[1][:, 1:].T
    strengths = [float(d @ weighted.T @ found @ d / np.sqrt(d @ weighted.T @ expected @ d)) for d in directions]
    if min(strengths) < LEAST_STRENGTH:
        raise InputError(
            f"gamma: in their weakest direction the scene's colours are {max(min(strengths), 0):.1f} standard deviations above the "
            f"noise, and {LEAST_STRENGTH:.0f} are needed: {too_few_colours(colours.shape[1])}"
        )
