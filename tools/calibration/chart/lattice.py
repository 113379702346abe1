"""Propose places of charts: look for regular grids of uniform patches.

Uniform areas between edges are blobs. A blob with two neighbours of its size starts a lattice, which grows from neighbour to
neighbour and so follows perspective. Each window of 6 x 4 nodes of a lattice is a proposal.
"""

from collections.abc import Iterator
from itertools import permutations

import numpy as np
from scipy.ndimage import find_objects, gaussian_filter, label, sobel, zoom

from shared.arrays import DoubleArray, FloatArray
from tools.simulation.perspective import apply_homography, fit_homography, rectangle

from .place import COLUMNS, PATCH, ROWS

_EDGES = (0.02, 0.04, 0.08)  # change of the square root of a level from pixel to pixel: less is uniform
_LEAST_AREA, _LARGEST_PART = 25, 0.04  # size of a blob: pixels, part of the picture
_FULL = 0.68  # part of its bounding parallelogram that a blob fills: patches are four-sided
_LONGEST = 2.2  # long over short side of a blob
_MOST_BLOBS = 500
_ALIKE = 2.5  # largest ratio of the areas of neighbours
_NEAR = 0.28  # of a step: largest distance of a blob from its predicted place
_SQUARE = 0.6  # smallest sine of the angle between rows and columns in the picture
_LEAST_NODES = 9
Cell = tuple[int, int]


def lattice_corners(picture: FloatArray, size: int) -> Iterator[DoubleArray]:
    """Yield the corners (4, 2), x and y, of the patch area of every 6 x 4 and 4 x 6 window of every lattice found.

    picture: (H, W, C), linear.
    size: longer side of the reduced picture that is searched.

    Windows that contain few blobs are left out.
    """
    scale = min(size / max(picture.shape[:2]), 1.0)
    root = np.sqrt(np.maximum(picture, 0) / max(float(np.quantile(picture, 0.99)), 1e-6))
    small = zoom(root, (scale, scale, 1), order=1, grid_mode=True, mode="nearest") if scale < 1 else root
    for edge in _EDGES:
        centres, areas = _blobs(small, edge)
        taken: set[int] = set()
        for first in range(len(centres)):
            if first in taken:
                continue
            nodes = _grown(first, centres, areas)
            if len(nodes) < _LEAST_NODES:
                continue
            taken |= set(nodes.values())
            for corners in _windows(nodes, centres):
                yield (corners + 0.5) / scale


def _blobs(root: FloatArray, edge: float) -> tuple[DoubleArray, DoubleArray]:
    """Return centres (N, 2), x and y, and areas (N,) of the uniform four-sided areas."""
    smooth = gaussian_filter(root, (0.8, 0.8, 0))
    steps = np.hypot(sobel(smooth, axis=0), sobel(smooth, axis=1)).max(axis=-1) / 8
    labels, _ = label(steps < edge)
    centres, areas = [], []
    for index, box in enumerate(find_objects(labels), start=1):
        height, width = (side.stop - side.start for side in box)
        if height * width < _LEAST_AREA or height * width > 4 * _LARGEST_PART * steps.size:
            continue
        down, right = np.nonzero(labels[box] == index)
        if not _LEAST_AREA <= down.size <= _LARGEST_PART * steps.size:
            continue
        spread = np.cov(right, down) + np.eye(2) / 12
        short, long = np.sqrt(np.linalg.eigvalsh(spread))
        # A parallelogram has area 12 sqrt(det of its covariance); holes, branches and L shapes have less.
        if long > _LONGEST * short or down.size < _FULL * 12 * short * long:
            continue
        centres.append((box[1].start + right.mean(), box[0].start + down.mean()))
        areas.append(float(down.size))
    order = np.argsort(areas)[::-1][:_MOST_BLOBS] if areas else np.zeros(0, int)
    return np.array(centres).reshape(-1, 2)[order], np.array(areas)[order]


def _grown(first: int, centres: DoubleArray, areas: DoubleArray) -> dict[Cell, int]:
    """Return the lattice around a blob: cell (column, row) -> index of the blob."""
    alike = np.flatnonzero((areas < _ALIKE * areas[first]) & (areas > areas[first] / _ALIKE))
    away = centres[alike] - centres[first]
    far = np.hypot(*away.T)
    nearest = [index for index in np.argsort(far) if far[index] > 0][:6]
    best: dict[Cell, int] = {}
    highest = 0.0
    for one, other in permutations(nearest, 2):
        right, down = away[one], away[other]
        # Sine of the angle between the steps; positive if clockwise on the screen, because x runs right and y down.
        sine = (right[0] * down[1] - right[1] * down[0]) / (far[one] * far[other])
        if sine < _SQUARE or not 0.55 < far[one] / far[other] < 1.8:
            continue
        nodes = _followed(first, right, down, centres[alike], alike)
        # A step and a diagonal span the same lattice, but slanted: prefer the squarer pair.
        if len(nodes) * sine > highest:
            best, highest = nodes, len(nodes) * sine
    return best


def _followed(first: int, right: DoubleArray, down: DoubleArray, places: DoubleArray, names: np.ndarray) -> dict[Cell, int]:
    """Grow the lattice from one blob and two steps; each step is adapted to the blobs found, to follow perspective."""
    start = int(np.flatnonzero(names == first)[0])
    nodes: dict[Cell, int] = {(0, 0): start}
    step: dict[Cell, tuple[DoubleArray, DoubleArray]] = {(0, 0): (right, down)}
    front: list[Cell] = [(0, 0)]
    used = {start}
    while front:
        cell = front.pop(0)
        here, (across, along) = places[nodes[cell]], step[cell]
        for column, row in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            there = (cell[0] + column, cell[1] + row)
            if there in nodes:
                continue
            move = column * across + row * along
            distance = np.hypot(*(places - here - move).T)
            found = int(np.argmin(distance))
            if found in used or distance[found] > _NEAR * float(np.hypot(*move)):
                continue
            met = (places[found] - here) * (column + row)
            nodes[there] = found
            used.add(found)
            step[there] = (0.5 * (across + met), along) if column else (across, 0.5 * (along + met))
            front.append(there)
    return {cell: int(names[node]) for cell, node in nodes.items()}


def _windows(nodes: dict[Cell, int], centres: DoubleArray) -> Iterator[DoubleArray]:
    """Yield the corners of every 6 x 4 and 4 x 6 window on a lattice, clockwise."""
    cells = np.array(list(nodes), float)
    to_frame = fit_homography(cells, centres[list(nodes.values())])
    if to_frame is None:
        return
    low, high = cells.min(axis=0).astype(int), cells.max(axis=0).astype(int)
    edge = PATCH / 2
    for wide, tall in ((COLUMNS, ROWS), (ROWS, COLUMNS)):
        for left in range(min(low[0], high[0] - wide + 1), max(low[0], high[0] - wide + 1) + 1):
            for top in range(min(low[1], high[1] - tall + 1), max(low[1], high[1] - tall + 1) + 1):
                inside = (cells >= (left, top)).all(axis=1) & (cells < (left + wide, top + tall)).all(axis=1)
                if inside.sum() < _LEAST_NODES:
                    continue
                ends = rectangle(left - edge, top - edge, left + wide - 1 + edge, top + tall - 1 + edge)
                corners = np.stack(apply_homography(to_frame, *ends.T), axis=-1)
                # The first side must be a long one.
                yield corners if wide == COLUMNS else np.roll(corners, -1, axis=0)
