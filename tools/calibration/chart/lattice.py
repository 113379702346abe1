"""Find grids of even patches by themselves: where the detector of `mcc` sees nothing, as often it does, this proposes charts.

Even places between edges are blobs; a blob with two neighbours of its size begins a lattice, which grows from neighbour to
neighbour, so that perspective may bend it; each window of 6 x 4 places on a lattice is a proposal.
"""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import find_objects, gaussian_filter, label, sobel, zoom

from shared.arrays import DoubleArray, FloatArray
from tools.scenes.drawn.perspective import apply_homography

from .place import COLUMNS, PATCH, ROWS

SIZES = (500, 900, 1500)  # longer side of the picture that is searched
_EDGES = (0.02, 0.04, 0.08)  # change of the square root of a level from pixel to pixel: less is even
_LEAST_AREA, _LARGEST_PART = 25, 0.04  # of a blob: pixels, part of the picture
_FULL = 0.68  # of the blob's bounding parallelogram that it fills: patches are four-sided
_LONGEST = 2.2  # long over short side
_MOST_BLOBS = 500
_ALIKE = 2.5  # areas of neighbours
_NEAR = 0.28  # of a step: how far from its predicted place a blob may be
_SQUARE = 0.6  # sine of the angle between rows and columns as they are seen
_LEAST_NODES = 9
Cell = tuple[int, int]


def lattice_corners(picture: FloatArray, size: int) -> Iterator[DoubleArray]:
    """Corners (4, 2), x and y, of the patch area of every 6 x 4 window, both ways up and on its side, of every lattice found.

    picture: (H, W, C), linear. Windows with few blobs in them are left out.
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
    """Centres (N, 2), x and y, and areas (N,) of the even four-sided places."""
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
    """The lattice around a blob: cell (column, row) -> blob."""
    alike = np.flatnonzero((areas < _ALIKE * areas[first]) & (areas > areas[first] / _ALIKE))
    away = centres[alike] - centres[first]
    far = np.hypot(*away.T)
    nearest = [index for index in np.argsort(far) if far[index] > 0][:6]
    best: dict[Cell, int] = {}
    highest = 0.0
    for one in nearest:
        for other in nearest:
            right, down = away[one], away[other]
            # Sine of the angle between the steps; positive when clockwise on the screen, as x runs right and y down.
            sine = (right[0] * down[1] - right[1] * down[0]) / (far[one] * far[other])
            if sine < _SQUARE or not 0.55 < far[one] / far[other] < 1.8:
                continue
            nodes = _followed(first, right, down, centres[alike], alike)
            # A step and a diagonal span the same lattice, askew: the squarer pair is meant.
            if len(nodes) * sine > highest:
                best, highest = nodes, len(nodes) * sine
    return best


def _followed(first: int, right: DoubleArray, down: DoubleArray, places: DoubleArray, names: np.ndarray) -> dict[Cell, int]:
    """The lattice from one blob and its two steps on; steps follow the blobs met, so that perspective does not lose them."""
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
    """Corners of every 6 x 4 and 4 x 6 window on a lattice, clockwise from each of two opposite corners' cells."""
    cells = np.array(list(nodes), float)
    points = centres[list(nodes.values())]
    to_frame = _fitted_homography(cells, points)
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
                ends = np.array(
                    [
                        (left - edge, top - edge),
                        (left + wide - 1 + edge, top - edge),
                        (left + wide - 1 + edge, top + tall - 1 + edge),
                        (left - edge, top + tall - 1 + edge),
                    ]
                )
                corners = np.stack(apply_homography(to_frame, ends[:, 0], ends[:, 1]), axis=-1)
                # The first side must be a long one, seen either way up.
                yield corners if wide == COLUMNS else np.roll(corners, -1, axis=0)


def _fitted_homography(source: DoubleArray, destination: DoubleArray) -> DoubleArray | None:
    """The projective map that takes points (N, 2) to others, least squares on the linear equations; None where there is none."""
    shift, scale = destination.mean(axis=0), max(float(destination.std()), 1e-9)
    u, v = ((destination - shift) / scale).T
    x, y = source.T
    one, nil = np.ones_like(x), np.zeros_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, nil, nil, nil, -u * x, -u * y], axis=1),
            np.stack([nil, nil, nil, x, y, one, -v * x, -v * y], axis=1),
        ]
    )
    solved, _, rank, _ = np.linalg.lstsq(rows, np.concatenate([u, v]), rcond=None)
    if rank < rows.shape[1]:
        return None
    back = np.array([[scale, 0, shift[0]], [0, scale, shift[1]], [0, 0, 1]])
    matrix: DoubleArray = back @ np.append(solved, 1.0).reshape(3, 3)
    return matrix
