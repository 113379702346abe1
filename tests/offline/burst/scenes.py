"""A drawn scene that is known between pixels too, and the frames of a camera that moved."""

from collections.abc import Iterable

import numpy as np

from panchroma.offline import BEST, RenderSettings
from panchroma.offline.burst import MergedBurst, Motion, in_frame, in_reference, render_burst_bands
from panchroma.shared import CfaPattern, DoubleArray, FloatArray, Mosaic
from tests.offline.scenes import photographed

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


def scene(
    motion: Motion, channels: int = 3, shape: tuple[int, int] = SHAPE, strength: float = 1.5
) -> FloatArray:
    """What a frame sees: fine waves of luminance, and coloured lines of some strength that are thinner
    than the distance of two blocks.
    """
    y, x = in_reference(motion, *pixels(shape), shape).astype(np.float64)
    brightness = luminance_at(y, x) / 3
    lines = np.exp(-np.square((x + 0.3 * y) % 17 - 8) / 3)
    share = np.ones((*shape, channels)) + 0.5 * np.sin(np.arange(channels) + y[..., None] / 40)
    share[..., 0] += strength * lines
    share *= channels * brightness[..., None] / share.sum(axis=2, keepdims=True)
    return share.astype(np.float32)


def taken(
    scenes: Iterable[FloatArray],
    sigma: float = 0.0,
    pattern: CfaPattern = CfaPattern.bayer(6),  # noqa: B008 - frozen
) -> list[Mosaic]:
    """A frame of each scene."""
    return [photographed(rgb, pattern, sigma, seed) for seed, rgb in enumerate(scenes)]


def picture(merged: MergedBurst, settings: RenderSettings = BEST) -> FloatArray:
    return np.concatenate(list(render_burst_bands(merged, settings)))


def error(found: Motion, true: Motion, shape: tuple[int, int] = SHAPE) -> DoubleArray:
    """Distance, pixels, between the places that two motions give, (H, W)."""
    first, second = (in_frame(motion, *pixels(shape), shape) for motion in (found, true))
    return np.hypot(first[0] - second[0], first[1] - second[1]).astype(np.float64)
