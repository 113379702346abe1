"""The built-in chart: a ColorChecker in perspective under uneven light, to test calibration against a known truth."""

import numpy as np

from shared.colorimetry import SRGB_TO_XYZ
from shared.perspective import apply_homography, homography, rectangle

from ..scene import Scene
from .charts import CARD
from .color_checker import color_checker, draw_patches

SAMPLES = 3  # per pixel and axis
WALL = (0.36, 0.34, 0.31)
# Corners of the 6 x 4 cells, (x, y) in parts of the frame's width and height: seen from the left and a little above, tilted.
CORNERS = ((0.10, 0.13), (0.89, 0.07), (0.94, 0.90), (0.05, 0.84))
RIM = 0.25  # card around the patches, in cells
LIGHT = (1.0, 0.62)  # upper left, lower right


def chart_scene(width: int, height: int) -> Scene:
    """Draw the chart at any size from 1 x 1: linear sRGB, the patches of `color_checker` times the light."""
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
