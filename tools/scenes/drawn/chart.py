"""The built-in chart: a ColorChecker in perspective under uneven light, so that calibration can be tried against the truth."""

import numpy as np

from shared.colorimetry import SRGB_TO_XYZ

from ..scene import Scene
from .charts import CARD
from .color_checker import PATCH, color_checker
from .perspective import apply_homography, homography

SAMPLES = 3  # per pixel and axis
WALL = (0.36, 0.34, 0.31)
# Corners of the 6 x 4 cells, as (x, y) parts of the frame's width and height: seen from the left and a little above, tilted.
CORNERS = ((0.10, 0.13), (0.89, 0.07), (0.94, 0.90), (0.05, 0.84))
RIM = 0.25  # of a cell: card around the patches
LIGHT = (1.0, 0.62)  # in the upper left and in the lower right


def chart_scene(width: int, height: int) -> Scene:
    """The chart at any size from 1 x 1, linear sRGB; the patches are those of `color_checker` times the light."""
    to_cells = homography(np.array(CORNERS) * (width, height), np.array([(0, 0), (6, 0), (6, 4), (0, 4)], float))
    patches = color_checker()
    rgb = np.zeros((height, width, 3), np.float32)
    for down in range(SAMPLES):
        for right in range(SAMPLES):
            x, y = np.meshgrid(np.arange(width) + (right + 0.5) / SAMPLES, np.arange(height) + (down + 0.5) / SAMPLES)
            u, v = apply_homography(to_cells, x, y)
            card = (u > -RIM) & (u < 6 + RIM) & (v > -RIM) & (v < 4 + RIM)
            column, row = np.clip(u, 0, 5.999), np.clip(v, 0, 3.999)
            inside = (np.abs(u - column.astype(int) - 0.5) < PATCH / 2) & (np.abs(v - row.astype(int) - 0.5) < PATCH / 2)
            colours = np.where(card[..., None], CARD, np.array(WALL))
            colours[inside] = patches[row.astype(int), column.astype(int)][inside]
            rgb += (colours / SAMPLES**2).astype(np.float32)
    bright, dim = LIGHT
    fall = 0.65 * np.linspace(0, 1, width)[None, :] + 0.35 * np.linspace(0, 1, height)[:, None]
    rgb *= (bright + (dim - bright) * fall**1.5).astype(np.float32)[..., None]
    return Scene(rgb, f"chart-{width}x{height}", SRGB_TO_XYZ, (1.0, 1.0, 1.0))
