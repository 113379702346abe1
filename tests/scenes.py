"""Scenes and lenses for tests of what must not know the rooms of `tools`, where the built-in
scene is.
"""

import numpy as np

from panchroma.shared import FloatArray, Shading


def leaves(height: int, width: int, seed: int = 1) -> FloatArray:
    """Fallen leaves: discs of many sizes and colours that hide each other, as photographs have
    them, (H, W, 3), 0.02 to 0.95.
    """
    random = np.random.default_rng(seed)
    rows, columns = np.arange(height)[:, None], np.arange(width)
    picture = np.full((height, width, 3), 0.3)
    for radius in np.sort(9 * (1 - random.random(400)) ** (-1 / 2))[::-1]:
        row, column = random.uniform(0, height), random.uniform(0, width)
        within = (rows - row) ** 2 + (columns - column) ** 2 < min(radius, height / 3) ** 2
        # what lies together has similar colours
        warm = (1 + np.sin(6 * column / width + 3 * row / height)) / 2
        light = random.uniform(0.05, 0.6)
        picture[within] = light * (np.array((warm, 0.2, 1 - warm)) + random.uniform(0, 0.3, 3))
    picture *= 1.1 - 0.4 * (rows / height + columns / width)[..., None] / 2
    picture += random.normal(0, 0.01, (height, width, 1))
    return picture.clip(0.02, 0.95).astype(np.float32)


def darker_corners(shape: tuple[int, int], planes: int = 4, colour: float = 0.15) -> Shading:
    """The shading of a lens whose corners are four times as dark as the middle, and by up to
    `colour` more or less by plane.

    The gain is 1 plus a square of the distance from the middle, for which the control points of a
    cubic spline are known.
    """
    step = 0.5  # of five control points, whose middle three span the frame
    place = (np.arange(5) - 1) * step - 0.5
    square = place[:, None] ** 2 + place**2 - 2 * step**2 / 3
    slopes = 6 * (1 + colour * np.linspace(-1, 1, planes))
    return Shading((1 + slopes[:, None, None] * square).tolist(), shape)
