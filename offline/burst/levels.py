"""The two planes at halved sizes, smooth enough to be compared at places between pixels."""

from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.motion import Motion

from ..gaussian import smoothed

BLUR = 1.2
"""Pixels of a level: standard deviation of the Gaussian that takes away what sampling and filled pixels add to texture. Chosen."""
SPREAD = 4 * np.pi * BLUR**2
"""Pixels whose mean has the variance that white noise has after that blur."""
_SMALLEST = 24  # pixels: the shorter side of the coarsest level, or less than twice as many; chosen
_LARGEST = 1_500_000  # pixels: larger planes are compared at half their size; chosen, for time


class Level(NamedTuple):
    """Both planes, reduced.

    scale: pixels of the frame per pixel of the level, a power of two.
    shape: (H, W) of the frame.
    reference, frame: float32, smoothed; NaN where a sample is clipped.
    """

    scale: int
    shape: tuple[int, int]
    reference: FloatArray
    frame: FloatArray

    def affine(self, motion: Motion) -> tuple[DoubleArray, DoubleArray]:
        """As `Motion.affine`, in pixels of the level."""
        turn, start = motion.affine(self.shape)
        return turn, (start + (turn - np.eye(2)) @ np.full(2, (self.scale - 1) / 2)) / self.scale

    def offsets(self, places: DoubleArray, axis: int) -> DoubleArray:
        """How far rows (axis 0) or columns (axis 1) of the level are from the frame's centre, pixels of the level."""
        return places + ((self.scale - self.shape[axis]) / 2) / self.scale


def levels(reference: FloatArray, frame: FloatArray) -> list[Level]:
    """All levels, the finest first."""
    shape, scale, found = (reference.shape[0], reference.shape[1]), 1, []
    planes = reference, frame
    if reference.size > _LARGEST:
        planes, scale = (_halved(reference), _halved(frame)), 2
    while True:
        found.append(Level(scale, shape, *(np.ascontiguousarray(smoothed(plane, BLUR)) for plane in planes)))
        if min(planes[0].shape) < 2 * _SMALLEST:
            return found
        planes, scale = (_halved(planes[0]), _halved(planes[1])), 2 * scale


def tile_edges(size: int, scale: int, nodes: int) -> IndexArray:
    """Where tiles begin and end along a side of a level: each has the pixels that are nearest to its node.

    size: of the frame, pixels; the nodes are evenly spaced from its first pixel to its last.
    """
    middles = (np.arange(nodes - 1) + 0.5) * ((size - 1) / (nodes - 1))
    return np.array([0, *np.ceil((middles - (scale - 1) / 2) / scale), size // scale]).astype(np.intp)


def _halved(plane: FloatArray) -> FloatArray:
    """Means of 2 x 2 pixels."""
    height, width = (size // 2 * 2 for size in plane.shape)
    rows = plane[:height:2, :width] + plane[1:height:2, :width]
    return np.float32(0.25) * (rows[:, ::2] + rows[:, 1::2])
