"""Gamma from an ordinary scene: every colour block beside the panchromatic samples around it.

A single block is noisy, so its own colour must not choose how it counts: least squares would take noise for colour and come out
too small. The colours of the neighbour blocks, which share none of its noise, stand in as *instruments* z (O. Reiersøl, 1945;
W. A. Fuller, Measurement Error Models, Wiley 1987, section 1.4):

    sum_j w_j z_j (l_j - gamma . c_j) = 0

holds for the true gamma whatever the noise is. For the same reason a block's weight follows the level of its neighbours, and the
texture of the panchromatic samples around it, never its colours.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import convolve

from offline import PAPER
from offline.luminance import recover_luminance
from shared import Mosaic
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

from .gamma import INSTEAD, GammaFit
from .samples import CLIPPED, levels_of

_REACH = 2  # pixels around a block: the ring of panchromatic samples
_DARK = 0.0015  # of full scale: darker places say nothing, and an error of the black level is large there
_NEIGHBOURS = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], float)
_LEAST_NEIGHBOURS = 6
_AROUND = np.exp(-(np.arange(-2, 3)[:, None] ** 2 + np.arange(-2, 3) ** 2) / 2.0)
_AROUND[2, 2] = 0  # A block is no instrument of its own.
_ROUGH = 30.0  # variance around a block, over that of the smoothest tenth at its level: beyond, hardly a site's luminance is known
_LEVELS, _TEXTURES = 12, 16  # classes of blocks that share a variance
_HUBER = 6.0  # standard deviations; closer, and the skew of texture is taken for colour
_ROUNDS = 12
_FLOOR = 0.002  # of gamma: what texture leaves behind on photographs, however many blocks there are
LEAST_BLOCKS = 300
LEAST_STRENGTH = 12.0  # of the instruments in the weakest direction, in standard deviations


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Per block on its grid.

    Panchromatic level of its sites; the channels there; variance of the ring about a plane; whether the block is well exposed, and
    whether gamma is to be taken from it.
    """

    level: DoubleArray
    colours: DoubleArray
    texture: DoubleArray
    usable: BoolArray
    wanted: BoolArray


def fit_scene_gamma(mosaic: Mosaic, excluded: BoolArray | None = None) -> GammaFit:
    """Gamma from all places of a shot, textured ones counting less; any number of channels.

    excluded: (H, W), pixels whose blocks are left out (patches that are measured by themselves).
    Raises InputError, saying what to shoot instead, when there are too few blocks, or too little colour.
    """
    blocks = _measured(mosaic, excluded)
    level, colours, instruments, classes = _chosen(blocks)
    channels = colours.shape[1]
    if len(level) < LEAST_BLOCKS:
        raise InputError(f"gamma: only {len(level)} colour blocks are well exposed, and {LEAST_BLOCKS} are needed: {INSTEAD}")
    gamma, *_ = np.linalg.lstsq(colours, level, rcond=None)
    deviation = weight = np.ones(len(level))
    for _ in range(_ROUNDS):
        residual = level - colours @ gamma
        deviation = _deviation(residual, classes)
        weight = np.minimum(1, _HUBER * deviation / np.maximum(np.abs(residual), 1e-12)) / deviation**2
        weighted = instruments * weight[:, None]
        gamma = np.linalg.lstsq(weighted.T @ colours, weighted.T @ level, rcond=None)[0]
    _check_strength(instruments, colours, deviation)
    residual = level - colours @ gamma
    weighted = instruments * weight[:, None]
    inverse = np.linalg.inv(weighted.T @ colours)
    moments = weighted * residual[:, None]
    covariance = inverse @ (moments.T @ moments) @ inverse.T + np.diag((_FLOOR * gamma) ** 2)
    return GammaFit(
        gamma=gamma.astype(np.float64),
        covariance=covariance,
        freedom=len(level) - channels,
        level=level,
        predicted=colours @ gamma,
        score=residual / deviation,
        used=np.abs(residual) <= _HUBER * deviation,
        condition=float(np.linalg.cond(instruments / instruments.sum(axis=1, keepdims=True))),
        spread=1.0,
        offset=0.0,
    )


def _measured(mosaic: Mosaic, excluded: BoolArray | None) -> _Blocks:
    """Every whole block with a ring around it."""
    pattern, levels = mosaic.pattern, levels_of(mosaic).astype(np.float64)
    grid, (high, wide) = pattern.grid(mosaic.shape), pattern.block_shape
    reach = min(_REACH, pattern.period - max(high, wide))
    rows, columns = (
        origins[(origins >= reach) & (origins + size + reach <= length)]
        for origins, size, length in zip((grid.rows, grid.columns), (high, wide), mosaic.shape, strict=True)
    )
    site = {(row, column): channel for row, column, channel in pattern.sites}
    around = [(row, column) for row in range(-reach, high + reach) for column in range(-reach, wide + reach)]
    ring = [place for place in around if place not in site]
    middle = np.array([(high - 1) / 2, (wide - 1) / 2])

    def at(values: DoubleArray, row: int, column: int) -> DoubleArray:
        return values[np.ix_(rows + row, columns + column)]

    white = np.stack([at(levels, *place) for place in ring], axis=-1) if rows.size and columns.size else np.zeros((0, 0, len(ring)))
    design = np.concatenate([np.ones((len(ring), 1)), np.array(ring) - middle], axis=1)
    texture = ((white - white @ np.linalg.pinv(design).T @ design.T) ** 2).sum(axis=-1) / (len(ring) - 3)
    luminance = _luminance(mosaic)
    colours = np.zeros((rows.size, columns.size, len(pattern.channels)))
    below = np.zeros_like(colours)
    brightest = white.max(axis=-1, initial=0)
    for (row, column), channel in site.items():
        sample = at(levels, row, column)
        colours[..., channel] += sample
        below[..., channel] += at(luminance, row, column)
        brightest = np.maximum(brightest, sample)
    level = np.mean([at(luminance, *place) for place in site], axis=0)
    colours *= level[..., None] / np.maximum(below, 1e-6)  # Light varies over the block alike in all planes.
    wanted = np.ones(level.shape, bool) if excluded is None else ~excluded[np.ix_(rows, columns)]
    return _Blocks(level, colours, texture, brightest < CLIPPED, wanted)


def _luminance(mosaic: Mosaic) -> DoubleArray:
    """Panchromatic levels everywhere, parts of full scale: where texture is, a plane through the ring would miss the sites' own."""
    # What the file says of gamma is not looked at.
    plain = replace(mosaic.calibration, gamma=(1.0,) * len(mosaic.pattern.channels))
    luminance = recover_luminance(Mosaic(mosaic.codes, mosaic.pattern, plain), PAPER.luminance)
    return luminance.astype(np.float64) / plain.full_scale


def _chosen(blocks: _Blocks) -> tuple[DoubleArray, DoubleArray, DoubleArray, np.ndarray]:
    """Level (N,), colours (N, C), instruments (N, C) and class (N,) of the blocks that gamma is taken from."""
    usable = blocks.usable.astype(np.float64)

    def around(values: DoubleArray) -> DoubleArray:
        total: DoubleArray = convolve(values * usable, _AROUND, mode="constant")
        return total / np.maximum(convolve(usable, _AROUND, mode="constant"), 1e-9)

    level = around(blocks.level)
    instruments = np.stack([around(plane) for plane in np.moveaxis(blocks.colours, -1, 0)], axis=-1)
    enough = convolve(usable, _NEIGHBOURS, mode="constant") >= _LEAST_NEIGHBOURS
    good = blocks.usable & blocks.wanted & enough & (level > _DARK)
    level, texture = level[good], blocks.texture[good]
    classes = np.full(level.size, -1)
    for bright, at_level in enumerate(np.array_split(np.argsort(level), _LEVELS)):
        if not at_level.size:
            continue
        by_texture = at_level[np.argsort(texture[at_level])]
        even = by_texture[texture[by_texture] <= _ROUGH * np.quantile(texture[at_level], 0.1)]
        for rough, alike in enumerate(np.array_split(even, _TEXTURES)):
            classes[alike] = bright * _TEXTURES + rough
    chosen = classes >= 0
    return blocks.level[good][chosen], blocks.colours[good][chosen], instruments[good][chosen], classes[chosen]


def _deviation(residual: DoubleArray, classes: np.ndarray) -> DoubleArray:
    """Standard deviation of each residual: the robust one of its class."""
    deviation = np.ones(residual.size)
    overall = 1.4826 * float(np.median(np.abs(residual)))
    for index in np.unique(classes):
        alike = classes == index
        deviation[alike] = 1.4826 * np.median(np.abs(residual[alike]))
    return np.maximum(deviation, max(0.05 * overall, 1e-9))


def _check_strength(instruments: DoubleArray, colours: DoubleArray, deviation: DoubleArray) -> None:
    """Refuse when the neighbours' chromaticities do not foretell a block's own: then there is noise and no colour."""
    total = instruments.sum(axis=1, keepdims=True)
    grey = np.average(instruments / total, axis=0, weights=total[:, 0])
    expected, found = (values - total * grey for values in (instruments, colours))
    weighted = expected / deviation[:, None] ** 2
    # Chromaticities lie in a plane, so one direction of the C is empty by construction.
    directions = np.linalg.eigh(weighted.T @ expected)[1][:, 1:].T
    strengths = [float(d @ weighted.T @ found @ d / np.sqrt(d @ weighted.T @ expected @ d)) for d in directions]
    if min(strengths) < LEAST_STRENGTH:
        raise InputError(
            f"gamma: the scene's colours stand out of the noise by {max(min(strengths), 0):.1f} where they differ least, and "
            f"{LEAST_STRENGTH:.0f} are needed: greys, or too few colours; {INSTEAD}"
        )
