"""A drawn scene that is known between pixels too, and the frames of a camera that moved."""

import numpy as np

from panchroma.offline.burst import Motion, in_frame, in_reference
from panchroma.shared.arrays import DoubleArray, FloatArray

SHAPE = (150, 210)


def luminance_at(y: DoubleArray, x: DoubleArray, seed: int = 0) -> DoubleArray:
    """Luminance, about 0.5 to 2.5, at points: waves of 6 to 80 pixels in all directions."""
    random = np.random.default_rng(seed)
    scene = np.full(y.shape, 1.5)
    for _ in range(40):
        length = 6 * (80 / 6) ** random.random()
        direction, phase = random.uniform(0, np.pi), random.uniform(0, 2 * np.pi)
        way = np.cos(direction) * y + np.sin(direction) * x
        scene += 0.12 * np.sin(2 * np.pi / length * way + phase)
    return scene


def pixels(shape: tuple[int, int] = SHAPE) -> tuple[DoubleArray, DoubleArray]:
    """Rows and columns of all pixels."""
    y, x = np.indices(shape).astype(np.float64)
    return y, x


def seen(motion: Motion, shape: tuple[int, int] = SHAPE, seed: int = 0) -> FloatArray:
    """What a frame sees of the scene after a motion."""
    y, x = in_reference(motion, *pixels(shape), shape).astype(np.float64)
    return luminance_at(y, x, seed).astype(np.float32)


def error(found: Motion, true: Motion, shape: tuple[int, int] = SHAPE) -> DoubleArray:
    """Distance, pixels, between the places that two motions give, (H, W)."""
    first, second = (in_frame(motion, *pixels(shape), shape) for motion in (found, true))
    return np.hypot(first[0] - second[0], first[1] - second[1]).astype(np.float64)
