"""The built-in sensor and what it looks at: to try capture and viewfinder without a camera."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np

from shared import Camera, CfaPattern, Mosaic, SensorCalibration
from shared.errors import InputError
from shared.sensor import simulate_sensor, typical_noise
from tools.scenes.drawn.builtin import builtin_scene

from .filters import filters_for
from .simulated_camera import SimulatedCamera

_SWING = 16  # the frame moves on a circle; its radius is the shorter side divided by this
_SEED = 0


def built_in_sensor(pattern: CfaPattern, camera: Camera | None) -> SensorCalibration:
    """Calibration of the sensor in a camera file, or of one with this pattern. Raises InputError when its filters are unknown."""
    scene = builtin_scene(1, 1)
    calibration = SimulatedCamera.of(pattern, camera).before(scene, filters_for(pattern, scene))
    return calibration if calibration.noise else replace(calibration, noise=typical_noise(calibration))


def usual_gamma(pattern: CfaPattern) -> tuple[float, ...]:
    """Gamma of filters that are mixtures of red, green and blue; otherwise 1 for each channel."""
    try:
        return filters_for(pattern, builtin_scene(1, 1)).gamma
    except InputError:
        return (1.0,) * len(pattern.channels)


def moving_scene(pattern: CfaPattern, calibration: SensorCalibration, shape: tuple[int, int], turn: int) -> Iterator[Mosaic]:
    """Endless frames, (H, W) = shape, of the built-in scene, over which the sensor circles once in `turn` frames; with noise."""
    height, width = shape
    swing = max(min(shape) // _SWING, 2)
    scene = builtin_scene(width + 2 * swing, height + 2 * swing)
    light = filters_for(pattern, scene).of(scene.rgb)
    rng = np.random.default_rng(_SEED)
    for number in count():
        angle = 2 * math.pi * number / turn
        top, left = round(swing * (1 - math.cos(angle))), round(swing * (1 + math.sin(angle)))
        yield simulate_sensor(light[top : top + height, left : left + width], pattern, calibration, 1.0, rng)
