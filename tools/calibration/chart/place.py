"""Where the patches of a ColorChecker lie in a frame, given four corners."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from shared.arrays import DoubleArray
from shared.errors import InputError
from tools.scenes.drawn.perspective import apply_homography, homography

from ..samples import Region

COLUMNS, ROWS = 6, 4
PATCHES = COLUMNS * ROWS
PATCH = 0.86  # of the distance between patches: 0.84 to 0.88 on the charts sold
INNER = 0.74  # of it that is measured: away from edges and from the lens's blur
LEAST_PERIODS = 2.5  # across what is measured of a patch: 2 x 2 blocks at least, wherever it lies, and 3 x 3 on some
NAMES = (
    "dark skin", "light skin", "blue sky", "foliage", "blue flower", "bluish green",
    "orange", "purplish blue", "moderate red", "purple", "yellow green", "orange yellow",
    "blue", "green", "red", "yellow", "magenta", "cyan",
    "white", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black",
)  # fmt: skip


def least_pitch(period: int) -> int:
    """Pixels from patch to patch that a chart needs at period K."""
    return int(np.ceil(LEAST_PERIODS * period / INNER))


@dataclass(frozen=True)
class ChartPlace:
    """The chart in a frame.

    corners: (x, y) in pixels of the outer corners of the corner patches: dark skin, bluish green, black, white.
    """

    corners: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        points = np.array(self.corners, float)
        if points.shape != (4, 2):
            raise InputError(f"chart: {len(self.corners)} corners, expected four (x, y): dark skin, bluish green, black, white")
        sides = np.roll(points, -1, axis=0) - points
        turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
        if not (turns > 0).all():
            raise InputError(
                "chart: the corners do not go round a convex quadrilateral clockwise; "
                "give those at dark skin, bluish green, black, white"
            )

    @cached_property
    def _to_frame(self) -> DoubleArray:
        edge = (1 - PATCH) / 2
        cells = [(edge, edge), (COLUMNS - edge, edge), (COLUMNS - edge, ROWS - edge), (edge, ROWS - edge)]
        return homography(np.array(cells), np.array(self.corners, float))

    def at(self, u: DoubleArray, v: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
        """(x, y) pixels of points given in cells, from (0, 0) to (6, 4)."""
        return apply_homography(self._to_frame, u, v)

    def lies_in(self, shape: tuple[int, int]) -> bool:
        """Whether all corners are inside a frame (rows, columns)."""
        return all(0 <= x <= shape[1] and 0 <= y <= shape[0] for x, y in self.corners)

    def patch_corners(self, size: float) -> DoubleArray:
        """Corners of the 24 patches in reading order, their sides scaled to `size` cells: (24, 4, 2), x and y."""
        u, v = np.meshgrid(np.arange(COLUMNS) + 0.5, np.arange(ROWS) + 0.5)
        step = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size / 2
        x, y = self.at(u.ravel()[:, None] + step[:, 0], v.ravel()[:, None] + step[:, 1])
        return np.stack([x, y], axis=-1)

    @cached_property
    def pitch(self) -> float:
        """Pixels from patch to patch where the chart is smallest."""
        quads = self.patch_corners(1.0)
        return float(np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=-1).min())

    def regions(self, inner: float = INNER) -> list[Region]:
        """The measured part of each patch, in reading order."""
        return [_polygon(quad) for quad in self.patch_corners(inner)]

    @property
    def cells(self) -> DoubleArray:
        """Centres of the patches in cells, (24, 2): x and y."""
        return np.stack([np.tile(np.arange(COLUMNS) + 0.5, ROWS), np.repeat(np.arange(ROWS) + 0.5, COLUMNS)], axis=1)

    def turned(self, quarter: int) -> "ChartPlace":
        """The same four corners, named from another one on."""
        return ChartPlace((*self.corners[quarter:], *self.corners[:quarter]))


def _polygon(corners: DoubleArray) -> Region:
    """Pixels whose centres lie inside a convex polygon, corners clockwise (x, y)."""
    left, top = np.floor(corners.min(axis=0)).astype(int)
    right, bottom = np.ceil(corners.max(axis=0)).astype(int)
    x, y = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
    mask = np.ones(x.shape, bool)
    for (x0, y0), (x1, y1) in zip(corners.tolist(), np.roll(corners, -1, axis=0).tolist(), strict=True):
        mask &= (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= 0
    return Region(int(top), int(left), mask)
