"""Fringes: channels that are displaced against luminance, measured in the shot itself.

A lens draws each colour at a size of its own, and a picture whose pixels are quads of a Bayer sensor shows red and blue half a
pixel apart. Every edge then has a fringe of colour that one block in K x K pixels cannot see, and that misleads the blocks beside
it. But all edges have the same one, so that a few numbers tell it: how far each channel is displaced down, across, and outwards
from the middle of the frame.

They are measured by what they do. The chromaticity of a channel is its sample over luminance, where that channel sees it, and
varies least from block to block if the displacement is right. So differences between neighbouring blocks are made small, robustly,
because colours have edges of their own. Filled luminance may be too flat under a block, which looks as if opposite sites were
displaced; by how much is measured along. A displacement is believed as far as tiles of blocks agree on it, and as far as colour
varies less with it in most of them, not in a few edges whose own colours look like fringes.

The samples are corrected to what they would be without it, and colour is estimated from these. In the end the channels are
displaced again (`rows.fringes`): the picture shows what was before the sensor. The paper has none of this.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.pattern import CfaPattern

from ..blocks import Sites, curvature
from ..cleaned import Cleaned, unclipped_blocks
from ..gaussian import smoothed
from ..kernels.fringes import Blocks, Grid, Lens, fringe_equations, without_fringes
from ..kernels.pieces import copied
from ..measured import Fringes
from ..settings import Switch

_APART = 2  # panchromatic pixels between blocks: with one, small print has fringes that are none
# Chosen on 111 photographs to learn from, as they are and with displaced channels; half and twice of each find nearly as many.
_BLOCKS, _SIDE = 1 << 14, 8  # blocks that are looked at in a large frame, about; and along the side of a tile
_SHIFT, _OUTWARD = 0.25, 0.5  # pixels: displacements that are expected, down or across, and outwards in a corner
_FLAT = 0.1  # share by which luminance under a block is expected to be too flat
_STILL = 0.01  # pixels: by how much all channels together may be displaced, which nothing can tell
_BLUR = 1.0  # blocks: standard deviation of the Gaussian that smooths chromaticities
_EVEN, _FILLED = 0.05 / 3, 0.2  # of chromaticities that differ by chance: their own; and the error of luminance, of its curvature
_SCALE = 0.5  # standard deviations from which on a difference counts less
_LEAST, _DARK = 0.02 / 3, 1e-3  # chromaticity; luminance, a share of the mean one
_ROUNDS, _STEP = 10, 2e-3  # the most rounds, and pixels of the last one
# Pixels that no agreement excludes; in these and the deviations between tiles, how large a displacement has to be to be believed,
# and how large, to be believed wholly; and the same of the gain, as a share of what it would be if all tiles gained the same.
# Chosen on 485 photographs to learn from, with three noises each, of 416 and of 222 pixels: 4 and some 15 of these 1455 pictures
# lose more than 0.1 dB; by the displacement alone 24 and 25 did, up to 3.4 dB, and all together gained 0.85 and 0.5 times as much.
_UNSURE, _BELIEVED, _GAINS = 0.05, (3.0, 4.5), (0.28, 0.5)
_MANY = 81  # tiles; with more, a smaller share is as sure

Slopes = tuple[DoubleArray, DoubleArray]
"""`steep`, (T, P, P), and `right`, (T, P), of each tile; see `kernels.fringes.Equations`."""


class FoundFringes(NamedTuple):
    """Fringes, and about the chromaticity of each whole block, float32 (rows, columns, C)."""

    fringes: Fringes
    colour: FloatArray


def find_fringes(frame: Cleaned, luminance: FloatArray, settings: Switch) -> FoundFringes | None:
    """How far the channels of a frame are displaced; None = not at all as far as one can tell, or nobody asks.

    luminance: (H, W), filled in and denoised, scene units.
    """
    sites, gamma = frame.sites, frame.gamma
    if not settings.used or not _is_even(sites.pattern) or min(sites.shape) < 2:
        return None
    samples, noise = sites.of(frame.signal), 0.0 if frame.noise is None else frame.noise.sigma(0.0)
    dark = np.float32(max(_DARK * frame.level, 3 * noise))
    light = np.maximum(sites.of(luminance), dark)
    colour = _colour(frame, samples / light)
    blocks = samples, colour, _variance(frame, luminance, samples, light, colour), unclipped_blocks(frame)
    shifts = _measured(luminance, blocks, _grid(sites), gamma, dark)
    return None if shifts is None else FoundFringes(Fringes(shifts, frame.mosaic.shape), colour)


def _is_even(pattern: CfaPattern) -> bool:
    """Whether filled luminance is as wrong at opposite sites of a block; otherwise it cannot be told from a displacement.

    So it is in full rectangles some way apart, and at single sites.
    """
    height, width = pattern.block_shape
    if not pattern.is_scattered:
        return len(pattern.sites) == height * width and pattern.period >= _APART + max(height, width)
    colour = ~pattern.panchromatic_mask((pattern.period, pattern.period))
    return not any((colour & np.roll(colour, 1, axis)).any() for axis in (0, 1))


def registered_samples(frame: Cleaned, luminance: FloatArray, found: FoundFringes) -> Cleaned:
    """The frame with its colour samples as if no channel were displaced; those beside clipped ones stay. luminance: (H, W)."""
    sites, signal, lens = frame.sites, copied(frame.signal), _lens(frame.gamma, found.fringes)
    samples = sites.of(signal)
    registered = np.empty_like(samples)
    without_fringes(luminance, samples, found.colour, unclipped_blocks(frame), _grid(sites), lens, registered)
    for site, place in enumerate(sites.places):
        signal[place] = registered[..., site]
    return frame.with_samples(signal)


def _grid(sites: Sites) -> Grid:
    rows, columns = (every[0, 0] for every in sites.pixels)
    return np.stack([rows, columns, sites.channels], axis=1), sites.grid.period


def _lens(gamma: DoubleArray, fringes: Fringes) -> Lens:
    down, across = (fringes.seen(axis, np.arange(size)) for axis, size in enumerate(fringes.shape))
    return gamma, down, across


def _colour(frame: Cleaned, shares: FloatArray) -> FloatArray:
    """About the chromaticity of each block, (rows, columns, C). shares: samples over luminance, (rows, columns, S)."""
    means = np.moveaxis(smoothed(np.moveaxis(frame.sites.means(shares), 2, 0), _BLUR), 0, 2).clip(_LEAST)
    return np.ascontiguousarray(means / (means @ frame.gamma)[..., None], np.float32)


def _variance(frame: Cleaned, luminance: FloatArray, samples: FloatArray, light: FloatArray, colour: FloatArray) -> FloatArray:
    """By how much samples over luminance differ by chance: variance, (rows, columns, S)."""
    variance = np.full_like(light, _EVEN**2)
    if frame.noise is not None:
        variance += frame.noise.variance(samples, frame.sites.channels) / light**2
    for site, (channel, place) in enumerate(zip(frame.sites.channels, frame.sites.places, strict=True)):
        error = np.float32(_FILLED) * curvature(luminance, place, frame.sites.grid)
        variance[..., site] += (colour[..., channel] * error / light[..., site]) ** 2
    return variance


def _measured(luminance: FloatArray, blocks: Blocks, grid: Grid, gamma: DoubleArray, dark: np.float32) -> DoubleArray | None:
    """How far the channels are displaced, (C, 3), as far as that is to be believed. blocks, grid: as in `kernels.fringes`."""
    tiles, count = _tiles(blocks[0].shape[:2]), len(gamma)
    expected = np.array([_SHIFT, _SHIFT, _OUTWARD] * count + [_FLAT] * 2)
    together = np.kron(gamma * blocks[1].mean(axis=(0, 1)), np.eye(3)) / _STILL
    prior, size = np.diag(expected**-2), len(expected)
    prior[:-2, :-2] += together.T @ together
    normal, steep, right = (np.zeros((len(tiles), *shape)) for shape in ((size, size), (size, size), (size,)))
    found = np.zeros(size)
    fringes = Fringes(np.zeros((count, 3)), (luminance.shape[0], luminance.shape[1]))
    outward = fringes.outward(0, np.arange(fringes.shape[0])), fringes.outward(1, np.arange(fringes.shape[1]))
    for number in range(_ROUNDS):
        lens = _lens(gamma, replace(fringes, shifts=found[:-2].reshape(count, 3)))
        fringe_equations(luminance, blocks, grid, lens, outward, found[-2:], tiles, _SIDE, dark, _SCALE, (normal, steep, right))
        if number == 0:
            without = steep.copy(), right.copy()
        step = np.linalg.solve(normal.sum(axis=0) + prior, right.sum(axis=0) - prior @ found)
        found = found + step
        if np.abs(step).max() < _STEP:
            break
    return _believed(found, prior, without, (steep, right))


def _believed(found: DoubleArray, prior: DoubleArray, without: Slopes, last: Slopes) -> DoubleArray | None:
    """The displacements found, as far as they, and what is gained, exceed what the tiles differ by; None = not at all.

    without, last: where no channel is displaced, and close to what was found.
    """
    (steep, right), shifts = last, found[:-2]
    tiles, unknowns = right.shape
    if tiles <= unknowns:
        return None
    whole = steep.sum(axis=0) + prior
    changes = np.linalg.solve(whole - steep, right[..., None])[..., 0]  # what would change without each tile
    inverse = np.linalg.inv(whole)
    covariance = tiles / (tiles - unknowns) * np.einsum("ti,tj->ij", changes, changes) + inverse @ prior @ inverse
    apart = covariance[:-2, :-2] + _UNSURE**2 * np.eye(len(shifts))
    deviations = np.sqrt(shifts @ np.linalg.solve(apart, shifts))
    # From the equations without displacement: the noise of luminance, which a displaced channel mixes otherwise, is not in these.
    gains = without[1][:, :-2] @ shifts - np.einsum("i,tij,j->t", shifts, without[0][:, :-2, :-2], shifts) / 2
    gained = gains.sum() / max(np.linalg.norm(gains), np.finfo(float).tiny) / math.sqrt(min(tiles, _MANY))
    share = min(float(np.interp(deviations, _BELIEVED, (0, 1))), float(np.interp(gained, _GAINS, (0, 1))))
    return share * shifts.reshape(-1, 3) if share > 0 else None


def _tiles(blocks: tuple[int, ...]) -> IndexArray:
    """First row and column of blocks of each tile that is looked at: all, or some that are spread over a large frame, (T, 2)."""
    every = max(round(math.sqrt(blocks[0] * blocks[1] / _BLOCKS)), 1)
    rows, columns = (np.arange(0, count, _SIDE)[every // 2 :: every] for count in blocks)
    return np.array([(row, column) for row in rows for column in columns], np.intp)
