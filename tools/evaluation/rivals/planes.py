"""Linear interpolation of each colour plane from its own sites: what anyone can do with the shot of any filter pattern.

A plane's sites are triangulated (Delaunay), and its values are linear on each triangle. Where a pattern leaves several equally good
triangulations, as a square lattice does, their mean is taken: on a square lattice that is bilinear interpolation but for 0.01 dB.
Over the pictures of four scenes and six tiles this was better than normalised convolution with tents of any width.

`denoised_planes` denoises them before, as `denoise_bayer` does for Bayer shots. BM3D needs samples on a regular grid. Where the
sites of a channel make up one (Honda's green does), it gets them together, otherwise those of each site of the tile by themselves.
Filling a finer grid by interpolation first, and pushing the sites of all rows together, lost up to 2 dB on four tiles.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import product
from math import gcd

import numpy as np

from shared import CfaPattern, Mosaic
from shared.arrays import BoolArray, DoubleArray, FloatArray, IndexArray
from shared.errors import InputError

from ..method import Method
from .denoising import LEAST, denoise_plane

_SLANT = 1e-4  # how far the lattice is slanted and stretched each way, so that each way another triangulation is the only one
_AROUND = 3  # tiles around one that hold all sites of its triangles
_LEAST = 1e-9  # smaller weights are rounding errors

_Taps = tuple[tuple[int, int, float], ...]  # row and column of a site from the pixel, its weight


def planes(mosaic: Mosaic) -> FloatArray:
    """Picture, float32 (H, W, C), scene units, from the shot of any pattern: each channel from its own sites, which are kept.

    Panchromatic samples are not used.
    Raises InputError for a frame smaller than the tile.

    >>> from shared import CfaPattern, SensorCalibration
    >>> kodak = CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW")
    >>> planes(Mosaic(np.full((12, 12), 0.5), kodak, SensorCalibration()))[5, 5].tolist()
    [0.5, 0.5, 0.5]
    """
    return _interpolated(mosaic, len(mosaic.pattern.channels))


def sharpened_planes(mosaic: Mosaic) -> FloatArray:
    """`planes`, and to all channels is added what they lack of the interpolated panchromatic plane (Eq. 7): sharper, more aliased.

    Raises InputError as `planes` does.
    """
    gamma = np.array(mosaic.calibration.gamma, np.float32)
    found = _interpolated(mosaic, len(mosaic.pattern.planes))
    picture, luminance = found[..., :-1], found[..., -1:]
    return picture + (luminance - (picture @ gamma)[..., None]) / gamma.sum()


def _interpolated(mosaic: Mosaic, count: int) -> FloatArray:
    """The first `count` planes, of the channels and then the panchromatic one; (H, W, count)."""
    pattern, samples, period = mosaic.pattern, mosaic.signal, mosaic.pattern.period
    if min(mosaic.shape) < period:
        raise InputError(f"a frame of {mosaic.shape[1]} x {mosaic.shape[0]} pixels is smaller than the tile of {period} x {period}")
    margin = _AROUND * period
    # Beyond the frame repeat the last tile: it keeps the phase of every pattern, a mirror that of symmetric ones only.
    padded = samples[np.ix_(*(_inside(np.arange(-margin, size + margin), size, period) for size in mosaic.shape))]
    found: FloatArray = np.zeros((*mosaic.shape, count), np.float32)
    for plane in range(count):
        for (row, column), taps in zip(np.ndindex(period, period), _taps(pattern, plane), strict=True):
            part = found[row::period, column::period, plane]
            for down, right, weight in taps:
                from_row, from_column = margin + row + down, margin + column + right
                here = padded[from_row::period, from_column::period][: part.shape[0], : part.shape[1]]
                part += np.float32(weight) * here
    return found


@lru_cache(maxsize=64)
def _taps(pattern: CfaPattern, plane: int) -> list[_Taps]:
    """For each pixel of the tile at the frame's origin, row by row: the sites that its value is made of."""
    period = pattern.period
    side = (2 * _AROUND + 1) * period
    sites = np.argwhere(pattern.filter_map((side, side)) == plane)
    pixels = np.argwhere(np.ones((period, period), bool)) + _AROUND * period
    found: list[dict[tuple[int, int], float]] = [{} for _ in pixels]
    slants = list(product((-_SLANT, _SLANT), repeat=2))
    for stretch, shear in slants:
        slanted = np.array([[1 + stretch, 0], [shear, 1]])
        corners, weights = _triangles(sites @ slanted, pixels @ slanted)
        for each, pixel, own, shares in zip(found, pixels, corners, weights, strict=True):
            for (down, right), share in zip((sites[own] - pixel).tolist(), shares.tolist(), strict=True):
                each[down, right] = each.get((down, right), 0.0) + share / len(slants)
    return [tuple((down, right, share) for (down, right), share in each.items() if share > _LEAST) for each in found]


def _triangles(sites: DoubleArray, pixels: DoubleArray) -> tuple[IndexArray, DoubleArray]:
    """The corners of the triangle that each pixel lies in, (n, 3) places in `sites`, and their barycentric weights."""
    from scipy.spatial import Delaunay

    mesh = Delaunay(sites)
    inside = mesh.find_simplex(pixels)
    frames = mesh.transform[inside]
    first = np.einsum("nij,nj->ni", frames[:, :2], pixels - frames[:, 2])
    return mesh.simplices[inside].astype(np.intp), np.column_stack([first, 1 - first.sum(axis=1)])


def _inside(places: IndexArray, size: int, period: int) -> IndexArray:
    """Places in an axis of `size` for places anywhere: those outside are taken from the nearest tile, in their own phase."""
    above: BoolArray = places >= size
    return np.where(places < 0, places % period, places - above * ((places - size) // period + 1) * period)


def denoised_planes(mosaic: Mosaic) -> FloatArray:
    """`planes` of a shot whose colour samples BM3D has denoised; float32 (H, W, C), scene units.

    BM3D gets the true noise, from the shot's calibration. Planes smaller than 8 x 8, and shots without noise or with unknown noise,
    are not denoised.
    Raises InputError as `planes` does.
    """
    noise, samples = mosaic.calibration.noise, mosaic.signal.copy()
    for channel, rows, columns in _grids(mosaic.pattern):
        plane = samples[rows, columns]
        if noise is not None and min(plane.shape) >= LEAST and (noise.shot[channel] or noise.read[channel]):
            samples[rows, columns] = denoise_plane(plane, noise.shot[channel], noise.read[channel])
    return planes(replace(mosaic, samples=samples))


def _grids(pattern: CfaPattern) -> Iterator[tuple[int, slice, slice]]:
    """(channel, rows, columns) of the regular grids that colour samples lie on: one for a channel if that is possible."""
    for channel in range(len(pattern.channels)):
        sites = [(rows, columns) for each, rows, columns in pattern.lattices if each == channel]
        starts = [(rows.start, columns.start) for rows, columns in sites]
        down, across = (gcd(pattern.period, *(start[axis] - starts[0][axis] for start in starts)) for axis in (0, 1))
        if len(sites) * down * across == pattern.period**2:
            sites = [(slice(starts[0][0] % down, None, down), slice(starts[0][1] % across, None, across))]
        yield from ((channel, rows, columns) for rows, columns in sites)


METHODS = (
    Method("planes", "Interpolated planes", planes, sparse=True, seconds=0.1),
    Method("planes+w", "Interpolated planes + W", sharpened_planes, sparse=True, seconds=0.1),
    Method("bm3d+planes", "BM3D + interpolated planes", denoised_planes, sparse=True, packages=("bm3d",), seconds=15),
)
