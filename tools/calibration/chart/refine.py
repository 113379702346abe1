"""Refine the place of a chart: move its corners until its patches are uniform and its gaps dark."""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import as_rows
from shared.errors import InputError

from .place import COLUMNS, ROWS, ChartPlace

_PROBE = 5  # points across a patch
_BESIDE = 0.045  # of a cell, from the middle of a gap: gaps are 0.12 to 0.16 wide
_EDGE = 0.78  # of a cell: the part that refinement makes uniform, nearly the whole patch


def refined(picture: FloatArray, place: ChartPlace) -> ChartPlace:
    """Return the place with its corners moved so that patches are uniform inside and the gaps as dark as possible.

    picture: (H, W, C), linear.
    """
    luminance = picture.sum(axis=-1)
    best, scale = np.array(place.corners), place.pitch
    for reach in (0.12, 0.04):  # The second search has a new simplex: in eight dimensions the first may collapse too early.
        simplex = np.concatenate([np.zeros((1, 8)), reach * np.eye(8)])
        found = minimize(
            _misfit,
            np.zeros(8),
            args=(luminance, best, scale),
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 700, "xatol": 1e-3, "fatol": 1e-6, "adaptive": True},
        )
        best = best + found.x.reshape(4, 2) * scale
    return ChartPlace(as_rows(best))


def patch_means(picture: FloatArray, place: ChartPlace, size: float = 0.5) -> tuple[DoubleArray, DoubleArray]:
    """Return the patches' means (24, C), and the standard deviation of log luminance inside each, (24,).

    picture: (H, W, C), linear.
    size: side of the part of a cell that is used.
    """
    step = (np.arange(_PROBE) + 0.5) / _PROBE - 0.5
    across, down = (grid.ravel() * size for grid in np.meshgrid(step, step))
    x, y = place.at(place.cells[:, :1] + across, place.cells[:, 1:] + down)
    values = np.stack([_at(plane, x, y) for plane in np.moveaxis(picture, -1, 0)], axis=-1)
    luminance = np.log(np.maximum(values.sum(axis=-1), 1e-4))
    return values.mean(axis=1), luminance.std(axis=1)


def _misfit(moved: DoubleArray, luminance: FloatArray, corners: DoubleArray, scale: float) -> float:
    """Return a measure of how uneven the patches and how bright the gaps are if the corners move by `scale * moved`."""
    try:
        place = ChartPlace(as_rows(corners + moved.reshape(4, 2) * scale))
    except InputError:
        return 1e3
    _, rough = patch_means(luminance[..., None], place, _EDGE)
    return float(np.minimum(rough, 0.5).mean()) + _gap_brightness(np.sqrt(np.maximum(luminance, 0)), place)


def _gap_brightness(root: FloatArray, place: ChartPlace) -> float:
    """Return the mean in the gaps, in the middle and near both sides of each, over the mean of the patches.

    root: square root of luminance. With luminance itself only the bright patches would fix the grid, and the corner at black would
    be loose.
    """
    along = np.array([-0.3, -0.1, 0.1, 0.3])
    beside = np.array([-_BESIDE, 0.0, _BESIDE])
    points = []
    for lines, length, flip in ((COLUMNS, ROWS, False), (ROWS, COLUMNS, True)):
        across = (np.arange(lines + 1)[:, None] + beside).ravel()
        down = (np.arange(length)[:, None] + 0.5 + along).ravel()
        u, v = (grid.ravel() for grid in np.meshgrid(across, down))
        points.append((v, u) if flip else (u, v))
    u, v = (np.concatenate(parts) for parts in zip(*points, strict=True))
    gaps, patches = (float(_at(root, *place.at(*places)).mean()) for places in ((u, v), place.cells.T))
    return gaps / max(patches, 1e-6)


def _at(plane: FloatArray, x: DoubleArray, y: DoubleArray) -> FloatArray:
    """Return a plane's values at points in pixels, interpolated bilinearly."""
    return map_coordinates(plane, [y - 0.5, x - 0.5], order=1, mode="nearest")
