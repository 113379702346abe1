"""Dead leaves: a picture of occluding shapes, with the statistics of natural scenes.

Leaves of all sizes fall at random and hide what lies below (G. Matheron's model; A. B. Lee, D.
Mumford and J. Huang, "Occlusion Models for Natural Images", IJCV 2001: radii distributed as r^-3
give the scale invariance that photographs have). Each leaf has one material, so its chromaticity is
constant, while shading, veins and cast shadows vary its luminance. This is the paper's assumption
about the world; the outlines of the leaves are edges that break it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from ...io.colour import decode_srgb

LeafArray = NDArray[np.int32]  # indices of leaves

SAMPLES = 3  # per pixel and axis: outlines are antialiased with nine
LARGEST_LEAF, SMALLEST_LEAF = 0.13, 0.0035  # radii, in parts of the frame's scale
LEAST = 1.5  # pixels: no radius is smaller
# Leaves over each point, per octave of radius, largest first. Equal figures would be exactly r^-3;
# fewer small leaves leave some calm surfaces, as in a photograph.
COVER = (1.7, 1.1, 0.7, 0.4, 0.25, 0.16, 0.11)
FILL = 0.66  # part of its bounding disc that a leaf covers, on average
TIPPED = 0.7  # part of the leaves that are pointed; the others are ellipses
GROUND = (0.030, 0.026, 0.022)  # reflectance where there is no leaf
SHADOW, SHADOW_STEPS = 0.84, 3  # light that one step of shadow lets through; number of steps
STRIP = 192  # rows of pixels drawn at once, to limit memory

# Earth, foliage, bark, blossom, slate, sky: encoded sRGB, and relative frequency.
_LEAF_COLOURS = (
    (0xC48A3C, 3.0), (0x9E542A, 3.0), (0x6E3E28, 3.0), (0x78743C, 3.0),
    (0x4A5C34, 3.0), (0x96965C, 2.0), (0xD0B278, 2.5), (0xAC3228, 1.2),
    (0xDE9632, 1.3), (0x566470, 1.5), (0x3A465C, 1.0), (0x784658, 1.0),
    (0xE2CEAA, 1.3), (0x3C2C26, 2.0), (0x648C82, 0.8), (0xBA6E6E, 0.8),
)  # fmt: skip


_CODES, _FREQUENCIES = np.array(_LEAF_COLOURS).T
_CHANNELS = [(_CODES.astype(int) >> shift) & 255 for shift in (16, 8, 0)]
MATERIALS = decode_srgb(np.stack(_CHANNELS, axis=1) / 255)
"""Reflectances that leaves may have, linear sRGB (materials, 3)."""
# standard deviation of the logarithm of each channel's reflectance among leaves of one material
VARIATION = 0.09


class Leaves(NamedTuple):
    """n leaves, the lowest first; arrays (n,).

    Attributes
    ----------
    x, y, radius : DoubleArray
        Pixels.
    angle : DoubleArray
        Radians.
    breadth : DoubleArray
        Width across, in parts of the radius.
    tipped : BoolArray
        Whether the leaf is pointed.
    reflectance : FloatArray
        float32 (n, 3).
    """

    x: DoubleArray
    y: DoubleArray
    radius: DoubleArray
    angle: DoubleArray
    breadth: DoubleArray
    tipped: BoolArray
    reflectance: FloatArray


def dead_leaves(width: int, height: int, scale: float, seed: int = 1) -> FloatArray:
    """Draw a frame of dead leaves: reflectance times shading, linear sRGB, float32 (height, width,
    3), about 0.003 to 0.95.

    Parameters
    ----------
    width, height : int
        Pixels.
    scale : float
        Pixels per unit of LARGEST_LEAF and SMALLEST_LEAF.
    seed : int, optional
        The same arguments give the same picture.
    """
    leaves = scatter(width, height, scale, seed)
    picture: FloatArray = np.empty((height, width, 3), np.float32)
    step = max(1, round(0.0025 * scale * SAMPLES))
    for top in range(0, height, STRIP):
        bottom = min(top + STRIP, height)
        picture[top:bottom] = _paint(leaves, top, bottom, width, step)
    return picture


def scatter(width: int, height: int, scale: float, seed: int) -> Leaves:
    """Return leaves that cover a frame. Within each octave of radius their number follows r^-3."""
    largest = max(LARGEST_LEAF * scale, 2 * LEAST)
    smallest = max(SMALLEST_LEAF * scale, LEAST)
    octaves = int(np.ceil(np.log2(largest / smallest)))
    places: list[DoubleArray] = []
    for octave in range(octaves):
        high = largest * 0.5**octave
        low = max(high / 2, smallest)
        cover = COVER[min(octave, len(COVER) - 1)] * np.log2(high / low)
        # mean of radius**2 with density r^-3
        mean_square = 2 * np.log(high / low) / (low**-2 - high**-2)
        across, down = width + 2 * high, height + 2 * high
        count = int(np.ceil(cover * across * down / (np.pi * mean_square * FILL)))
        draw = np.random.default_rng((seed, octave)).random((3, count))
        radius = (high**-2 + draw[0] * (low**-2 - high**-2)) ** -0.5
        places.append(np.stack([draw[1] * across - high, draw[2] * down - high, radius]))
    draws = np.random.default_rng((seed, octaves, 0))
    x, y, radius = draws.permutation(np.concatenate(places, axis=1), axis=1)
    tipped = draws.random(x.size) < TIPPED
    angle = draws.random(x.size) * 2 * np.pi
    breadth = np.where(tipped, 0.8, 1.0) * draws.uniform(0.5, 1.0, x.size)
    return Leaves(x, y, radius, angle, breadth, tipped, _reflectances(x / scale, y / scale, draws))


def _reflectances(x: DoubleArray, y: DoubleArray, draws: np.random.Generator) -> FloatArray:
    """Return a reflectance per leaf, float32 (n, 3): one material each, often that of its
    neighbours, as under one tree.
    """
    likely = np.tile(np.log(_FREQUENCIES), (x.size, 1))
    for phase, across, down in draws.random((3, 3, len(MATERIALS))):
        place = phase + np.outer(x, 9 * across - 4.5) + np.outer(y, 9 * down - 4.5)
        likely += 1.1 * np.sin(2 * np.pi * place)
    chosen = np.argmax(likely + draws.gumbel(size=likely.shape), axis=1)
    brightness = draws.normal(0, 0.22, (x.size, 1))
    varied = MATERIALS[chosen] * np.exp(brightness + draws.normal(0, 1, (x.size, 3)) * VARIATION)
    return np.clip(varied, 0.012, 0.8).astype(np.float32)


def _paint(leaves: Leaves, top: int, bottom: int, width: int, step: int) -> FloatArray:
    """Draw rows top..bottom of the picture, (bottom - top, width, 3). step: length of a step of
    shadow, in samples.
    """
    above = min(top * SAMPLES, SHADOW_STEPS * step)  # rows above that cast shadows into this strip
    upmost = _topmost(leaves, top * SAMPLES - above, bottom * SAMPLES, width * SAMPLES)
    index = upmost[above:]
    light = _shading(leaves, index, top)
    # the light comes from the upper left
    for distance in range(step, SHADOW_STEPS * step + 1, step):
        right = min(round(0.75 * distance), index.shape[1] - 1)
        rows = np.maximum(np.arange(above - distance, above - distance + len(index)), 0)
        caster = upmost[rows, : index.shape[1] - right]
        light[:, right:] *= np.where(caster > index[:, right:], np.float32(SHADOW), np.float32(1))
    # index -1 is the ground
    reflectance = np.concatenate([leaves.reflectance, np.array([GROUND], np.float32)])
    mean = np.zeros((bottom - top, width, 3), np.float32)
    for row, column in np.ndindex(SAMPLES, SAMPLES):
        samples = np.s_[row::SAMPLES, column::SAMPLES]
        mean += reflectance[index[samples]] * light[samples][..., None]
    return mean / np.float32(SAMPLES**2)


def _topmost(leaves: Leaves, first: int, last: int, columns: int) -> LeafArray:
    """Return the index of the topmost leaf at each sample of rows first..last; -1 = no leaf."""
    topmost = np.full((last - first, columns), -1, np.int32)
    centre_x, centre_y = leaves.x * SAMPLES - 0.5, leaves.y * SAMPLES - 0.5
    radius = leaves.radius * SAMPLES
    up, down = _span(centre_y, radius, first, last)
    left, right = _span(centre_x, radius, 0, columns)
    cosine, sine = np.cos(leaves.angle) / radius, np.sin(leaves.angle) / radius
    for leaf in np.flatnonzero((up < down) & (left < right)).tolist():
        # Differences in double precision, from the frame's corner, so that outlines do not depend
        # on the strip.
        rows = (np.arange(up[leaf], down[leaf]) - centre_y[leaf]).astype(np.float32)[:, None]
        across = (np.arange(left[leaf], right[leaf]) - centre_x[leaf]).astype(np.float32)[None, :]
        c, s = np.float32(cosine[leaf]), np.float32(sine[leaf])
        along = across * c + rows * s
        aside = (rows * c - across * s) * np.float32(1 / leaves.breadth[leaf])
        outline = np.abs(aside) if leaves.tipped[leaf] else aside * aside
        outline += along * along
        below = topmost[up[leaf] - first : down[leaf] - first, left[leaf] : right[leaf]]
        below[outline < 1] = leaf  # leaves come from the lowest to the topmost
    return topmost


def _span(
    centre: DoubleArray, radius: DoubleArray, first: int, last: int
) -> tuple[IndexArray, IndexArray]:
    """Return each leaf's first sample along an axis and the one after its last, within
    first..last.
    """
    start, stop = np.ceil(centre - radius), np.floor(centre + radius + 1)
    return start.clip(first, last).astype(np.intp), stop.clip(first, last).astype(np.intp)


def _shading(leaves: Leaves, index: LeafArray, top: int) -> FloatArray:
    """Return the part of the light that each sample reflects, about 0.4 to 1.4: curvature, midrib
    and veins; 1 on the ground.
    """

    def per_sample(values: DoubleArray) -> FloatArray:
        return np.append(values, 0).astype(np.float32)[index]

    down = ((np.arange(index.shape[0]) + top * SAMPLES + 0.5) / SAMPLES).astype(np.float32)[:, None]
    right = ((np.arange(index.shape[1]) + 0.5) / SAMPLES).astype(np.float32)[None, :]
    inverse = per_sample(1 / leaves.radius)
    right, down = (right - per_sample(leaves.x)) * inverse, (down - per_sample(leaves.y)) * inverse
    cosine, sine = per_sample(np.cos(leaves.angle)), per_sample(np.sin(leaves.angle))
    along = right * cosine + down * sine
    aside = (down * cosine - right * sine) * per_sample(1 / leaves.breadth)
    away = np.abs(aside)
    midrib = np.float32(0.18) * (away < 0.08 - 0.06 * np.abs(along))
    veins = 0.06 * np.sin(18 * (along + 0.6 * away)) + midrib
    curvature = 1 - 0.28 * (0.6 * right + 0.8 * down) - 0.18 * (along * along + aside * aside)
    tipped = np.append(leaves.tipped, False)[index]
    light: FloatArray = (curvature * (1 + veins * tipped)).astype(np.float32, copy=False)
    light[index < 0] = 1
    return light
