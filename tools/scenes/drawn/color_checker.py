"""The ColorChecker Classic: the published colours of its patches, their layout, and a chart scene to test calibration with."""

import numpy as np

from shared.arrays import DoubleArray
from shared.colorimetry import SRGB_TO_XYZ, lab_to_xyz
from shared.perspective import apply_homography, homography, rectangle

from ..scene import Scene

DARKEST, BRIGHTEST = 0.01, 0.95  # limits of the reflectances in drawn charts
CARD = 0.035  # reflectance of what is around the patches

# CIE L*a*b* (D50, 2 degrees) of the ColorChecker Classic, in reading order: X-Rite's reference data for charts made after November
# 2014, as colour-science 0.4.7 republishes them ("ColorChecker24 - After November 2014").
COLOR_CHECKER_LAB = (
    (37.54, 14.37, 14.92), (64.66, 19.27, 17.50), (49.32, -3.82, -22.54), (43.46, -12.74, 22.72),
    (54.94, 9.61, -24.79), (70.48, -32.26, -0.37), (62.73, 35.83, 56.50), (39.43, 10.75, -45.17),
    (50.57, 48.64, 16.67), (30.10, 22.54, -20.87), (71.77, -24.13, 58.19), (71.51, 18.24, 67.37),
    (28.37, 15.42, -49.80), (54.38, -39.72, 32.27), (42.43, 51.05, 28.62), (81.80, 2.67, 80.41),
    (50.63, 51.28, -14.12), (49.57, -29.71, -28.32), (95.19, -1.03, 2.93), (81.29, -0.57, 0.44),
    (66.89, -0.75, -0.06), (50.76, -0.13, 0.14), (35.63, -0.46, -0.48), (20.64, 0.07, -0.46),
)  # fmt: skip
DRAWN_PATCH = 0.84  # side of a patch, in distances between patches

# The scene: a ColorChecker in perspective under uneven light.
SAMPLES = 3  # per pixel and axis
WALL = (0.36, 0.34, 0.31)
# Corners of the 6 x 4 cells, (x, y) in parts of the frame's width and height: seen from the left and a little above, tilted.
CORNERS = ((0.10, 0.13), (0.89, 0.07), (0.94, 0.90), (0.05, 0.84))
RIM = 0.25  # card around the patches, in cells
LIGHT = (1.0, 0.62)  # upper left, lower right


def color_checker() -> DoubleArray:
    """Return the 24 patches in linear sRGB, (4, 6, 3); cyan's red and yellow's blue are raised to DARKEST."""
    xyz = lab_to_xyz(np.array(COLOR_CHECKER_LAB).reshape(4, 6, 3))
    return np.clip(xyz @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T, DARKEST, BRIGHTEST)


def draw_patches(u: DoubleArray, v: DoubleArray, ground: DoubleArray, patches: DoubleArray) -> DoubleArray:
    """Draw 24 patches over `ground`.

    u, v: (h, w), positions in cells: the chart covers 0..6 and 0..4, each patch is in the middle of a cell.
    ground: broadcasts to (h, w, C), colours between and around the patches.
    patches: (4, 6, C), such as `color_checker`.
    """
    column, row = np.clip(u, 0, 5.999), np.clip(v, 0, 3.999)
    inside = (np.abs(column % 1 - 0.5) < DRAWN_PATCH / 2) & (np.abs(row % 1 - 0.5) < DRAWN_PATCH / 2)
    return np.where(inside[..., None], patches[row.astype(int), column.astype(int)], ground)


def chart_scene(width: int, height: int) -> Scene:
    """Draw a ColorChecker at any size from 1 x 1: linear sRGB, the patches of `color_checker` times the light."""
    to_cells = homography(np.array(CORNERS) * (width, height), rectangle(0, 0, 6, 4))
    rgb, patches = np.zeros((height, width, 3), np.float32), color_checker()
    for down in range(SAMPLES):
        for right in range(SAMPLES):
            x, y = np.meshgrid(np.arange(width) + (right + 0.5) / SAMPLES, np.arange(height) + (down + 0.5) / SAMPLES)
            u, v = apply_homography(to_cells, x, y)
            card = (u > -RIM) & (u < 6 + RIM) & (v > -RIM) & (v < 4 + RIM)
            colours = draw_patches(u, v, np.where(card[..., None], CARD, np.array(WALL)), patches)
            rgb += (colours / SAMPLES**2).astype(np.float32)
    bright, dim = LIGHT
    fall = 0.65 * np.linspace(0, 1, width)[None, :] + 0.35 * np.linspace(0, 1, height)[:, None]
    rgb *= (bright + (dim - bright) * fall**1.5).astype(np.float32)[..., None]
    return Scene(rgb, f"chart-{width}x{height}", SRGB_TO_XYZ, (1.0, 1.0, 1.0))
