"""A simulated sensor that looks at a moving scene, frame by frame: a camera for those who have none at hand."""

import math
import time
from collections.abc import Iterator
from itertools import count

import numpy as np

from device.capture import Sensor
from device.frames import RawFrame
from shared.sensor import simulate_sensor
from tools.scenes.drawn.builtin import builtin_scene

_SWING = 16  # the frame moves on a circle with this part of its shorter side as radius
_FRAMES = range(4, 49)  # of one turn
_MEMORY = 64 * 2**20  # bytes for the frames of a turn, as far as so many fit
_SEED = 0


def moving_scene(sensor: Sensor, rate: float) -> Iterator[RawFrame]:
    """`rate` frames a second without end, as the sensor's 16-bit words: the built-in scene, seen while circling over it.

    The first turn is simulated (noise and all) frame by frame, as fast as the machine can; later turns repeat it, in time.
    """
    layout = sensor.layout
    swing = max(min(layout.width, layout.height) // _SWING, 2)
    scene = builtin_scene(layout.width + 2 * swing, layout.height + 2 * swing).rgb
    rng = np.random.default_rng(_SEED)
    frames = min(max(_MEMORY // layout.frame_bytes, _FRAMES[0]), _FRAMES[-1])
    turn: list[bytes] = []
    due = time.monotonic()
    for number in count():
        if len(turn) < frames:
            angle = 2 * math.pi * number / frames
            top, left = round(swing * (1 - math.cos(angle))), round(swing * (1 + math.sin(angle)))
            seen = scene[top : top + layout.height, left : left + layout.width]
            mosaic = simulate_sensor(seen, sensor.pattern, sensor.calibration, 1.0, rng)
            turn.append(mosaic.codes.astype("<u2").tobytes())
        # A sensor does not catch up: a frame that is late makes all that follow as late.
        due = max(due + 1 / rate, time.monotonic())
        time.sleep(due - time.monotonic() if due > time.monotonic() else 0)
        yield RawFrame.now(turn[number % frames])
