"""A simulated sensor that looks at a moving scene: to try capture and viewfinder without a camera."""

import math
import time
from collections.abc import Iterator
from itertools import count

import numpy as np

from device.capture import Sensor
from device.capture.frames import RawFrame
from shared.sensor import simulate_sensor
from tools.camera.filters import filters_for
from tools.scenes.drawn.builtin import builtin_scene

_SWING = 16  # the frame moves on a circle; its radius is the shorter side divided by this
_FRAMES = range(4, 49)  # frames of one turn
_MEMORY = 64 * 2**20  # bytes: limits the number of frames of a turn
_SEED = 0


def moving_scene(sensor: Sensor, rate: float) -> Iterator[RawFrame]:
    """Yield endless frames of 16-bit words, `rate` per second: the built-in scene, over which the sensor circles.

    The first turn is simulated, with noise, as fast as the machine can; later turns repeat its frames at the full rate.
    """
    layout = sensor.layout
    swing = max(min(layout.width, layout.height) // _SWING, 2)
    scene = builtin_scene(layout.width + 2 * swing, layout.height + 2 * swing)
    light = filters_for(sensor.pattern, scene).of(scene.rgb)
    rng = np.random.default_rng(_SEED)
    frames = min(max(_MEMORY // layout.frame_bytes, _FRAMES[0]), _FRAMES[-1])
    turn: list[bytes] = []
    due = time.monotonic()
    for number in count():
        if len(turn) < frames:
            angle = 2 * math.pi * number / frames
            top, left = round(swing * (1 - math.cos(angle))), round(swing * (1 + math.sin(angle)))
            seen = light[top : top + layout.height, left : left + layout.width]
            mosaic = simulate_sensor(seen, sensor.pattern, sensor.calibration, 1.0, rng)
            turn.append(mosaic.codes.astype("<u2").tobytes())
        # A sensor does not catch up: a late frame delays all later ones by as much.
        due = max(due + 1 / rate, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0))
        yield RawFrame.now(turn[number % frames])
