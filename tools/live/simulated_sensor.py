"""The built-in sensor as a source of frames, at its own rate."""

import time
from collections.abc import Iterator
from itertools import count

from device.capture import Sensor
from device.capture.frames import RawFrame
from tools.camera.built_in import moving_scene

_FRAMES = range(4, 49)  # frames of one turn
_MEMORY = 64 * 2**20  # bytes: limits the number of frames of a turn


def moving_frames(sensor: Sensor, rate: float) -> Iterator[RawFrame]:
    """Yield endless frames of 16-bit words, `rate` per second: see `moving_scene`.

    The first turn is simulated as fast as the machine can; later turns repeat its frames at the full rate.
    """
    layout = sensor.layout
    frames = min(max(_MEMORY // layout.frame_bytes, _FRAMES[0]), _FRAMES[-1])
    simulated = moving_scene(sensor.pattern, sensor.calibration, (layout.height, layout.width), frames)
    turn: list[bytes] = []
    due = time.monotonic()
    for number in count():
        if len(turn) < frames:
            turn.append(next(simulated).codes.astype("<u2").tobytes())
        # A sensor does not catch up: a late frame delays all later ones by as much.
        due = max(due + 1 / rate, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0))
        yield RawFrame.now(turn[number % frames])
