"""Positions of a ColorChecker's patches in a frame, from its four corners."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ....shared import DoubleArray, InputError
from ....shared.colorimetry import Matrix
from ...simulation.perspective import apply_homography, homography, rectangle
from ..places import Pixels

COLUMNS, ROWS = 6, 4
PATCHES = COLUMNS * ROWS
PATCH = 0.86  # side of a patch, in distances between patches: 0.84 to 0.88 on charts sold
INNER = 0.74  # side of the measured part of a patch in chart units: away from edges and lens blur
# Measured part of a patch in periods: holds at least 2 x 2 blocks, on some patches 3 x 3.
LEAST_PERIODS = 2.5
# Of areas beside the chart: periods along a side, at least, and areas along a side of the frame.
_LEAST_AREA, _MOST_AREAS = 5, 40
NAMES = (
    "dark skin", "light skin", "blue sky", "foliage", "blue flower", "bluish green",
    "orange", "purplish blue", "moderate red", "purple", "yellow green", "orange yellow",
    "blue", "green", "red", "yellow", "magenta", "cyan",
    "white", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black",
)  # fmt: skip


def least_pitch(period: int) -> int:
    """Return the distance between patches, in pixels, that a chart needs at period K."""
    return int(np.ceil(LEAST_PERIODS * period / INNER))


@dataclass(frozen=True)
class ChartPlace:
    """The place of a chart in a frame.

    Chart units are distances between patches: the middle of a patch is the middle of a unit square,
    (0, 0) to (6, 4) is the chart.

    corners: four (x, y), pixels: the outer corners of the corner patches dark skin, bluish green,
    black, white. Raises InputError if the corners are not clockwise around a convex quadrilateral.
    """

    corners: Matrix

    def __post_init__(self) -> None:
        points = np.array(self.corners, float)
        sides = np.roll(points, -1, axis=0) - points
        turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
        if not (turns > 0).all():
            fault = "the corners are not clockwise around a convex quadrilateral"
            raise InputError(f"chart: {fault}; give those at dark skin, bluish green, black, white")

    @cached_property
    def _to_frame(self) -> DoubleArray:
        edge = (1 - PATCH) / 2
        patches = rectangle(edge, edge, COLUMNS - edge, ROWS - edge)
        return homography(patches, np.array(self.corners, float))

    def __str__(self) -> str:
        return " ".join(f"{x:.0f},{y:.0f}" for x, y in self.corners)

    def at(self, u: DoubleArray, v: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
        """Return the positions (x, y) in pixels of points in chart units."""
        return apply_homography(self._to_frame, u, v)

    def lies_in(self, shape: tuple[int, ...]) -> bool:
        """Return whether all corners are inside a frame (rows, columns)."""
        return all(0 <= x <= shape[1] and 0 <= y <= shape[0] for x, y in self.corners)

    def patch_corners(self, size: float) -> DoubleArray:
        """Return the corners of squares of `size` chart units in the 24 patches, in reading order:
        (24, 4, 2), x and y.
        """
        step = rectangle(-1, -1, 1, 1) * size / 2
        x, y = self.at(self.centres[:, :1] + step[:, 0], self.centres[:, 1:] + step[:, 1])
        return np.stack([x, y], axis=-1)

    @cached_property
    def pitch(self) -> float:
        """The distance between patches, in pixels, where the chart is smallest."""
        quads = self.patch_corners(1.0)
        return float(np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=-1).min())

    def measured(self) -> list[Pixels]:
        """Return the pixels of the measured parts of the patches, in reading order."""
        return [_pixels(quad) for quad in self.patch_corners(INNER)]

    def around(self, shape: tuple[int, int], period: int) -> list[Pixels]:
        """Return the pixels of squares as large as the measured parts, and of whole periods, on a
        grid over a frame (rows, columns), where it shows no part of the chart.
        """
        side = period * round(max(INNER * self.pitch / period, _LEAST_AREA))
        step = max(side, *(length // _MOST_AREAS for length in shape))
        left, top = np.min(self.corners, axis=0) - self.pitch / 2
        right, bottom = np.max(self.corners, axis=0) + self.pitch / 2
        return [
            tuple(pixels.ravel() for pixels in np.mgrid[row : row + side, column : column + side])
            for row in range(0, shape[0] - side + 1, step)
            for column in range(0, shape[1] - side + 1, step)
            if not (top - side < row < bottom and left - side < column < right)
        ]

    @property
    def centres(self) -> DoubleArray:
        """The centres of the patches in chart units, (24, 2): x and y."""
        rows, columns = np.indices((ROWS, COLUMNS)) + 0.5
        return np.stack([columns.ravel(), rows.ravel()], axis=1)


def _pixels(corners: DoubleArray) -> Pixels:
    """Return the pixels whose centres lie inside a convex polygon; corners: (N, 2), x and y,
    clockwise.
    """
    left, top = np.floor(corners.min(axis=0)).astype(int)
    right, bottom = np.ceil(corners.max(axis=0)).astype(int)
    rows, columns = np.mgrid[top:bottom, left:right]
    x, y = columns + 0.5, rows + 0.5
    starts, ends = corners.T[..., None, None], np.roll(corners, -1, axis=0).T[..., None, None]
    (x0, y0), (x1, y1) = starts, ends
    inside = ((x1 - x0) * (y - y0) >= (y1 - y0) * (x - x0)).all(axis=0)
    return rows[inside], columns[inside]
