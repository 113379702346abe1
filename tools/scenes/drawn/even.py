"""Even light and no light, to calibrate with: flat frames and dark frames of a simulated camera."""

import numpy as np

from ..scene import Scene


def flat_scene(width: int, height: int) -> Scene:
    """An evenly lit white surface that reads full scale everywhere; less light makes flat frames that are not clipped."""
    return Scene(np.ones((height, width, 3), np.float32), f"flat-{width}x{height}")


def dark_scene(width: int, height: int) -> Scene:
    """What a camera sees with its lens covered."""
    return Scene(np.zeros((height, width, 3), np.float32), f"dark-{width}x{height}")
