"""How fast is each packing of raw frames unpacked? python -m tests.benchmarks.packings [--rounds 9]

A frame of 4056 x 3040 pixels with padded lines; megapixels per second of processor time, which one core has: the median of rounds,
in which the formats take turns.
"""

import argparse
import time
from statistics import median

import numpy as np

from device.capture.frames import FORMATS, FrameLayout

WIDTH, HEIGHT, ALIGNMENT = 4056, 3040, 64  # pixels; bytes
LEAST = 200  # megapixels per second that each should reach


def main() -> None:
    """Print a line for each format."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, metavar="N", help="default: 9")
    given = parser.parse_args()
    layouts = []
    for name in FORMATS:
        line = FrameLayout(WIDTH, HEIGHT, name).line_bytes
        layouts.append(FrameLayout(WIDTH, HEIGHT, name, (line // ALIGNMENT + 1) * ALIGNMENT))
    data = np.random.default_rng(0).bytes(max(layout.frame_bytes for layout in layouts))
    speeds: dict[str, list[float]] = {name: [] for name in FORMATS}
    for number in range(given.rounds + 1):
        for layout in layouts:
            started = time.process_time()
            layout.unpack(data[: layout.frame_bytes])
            if number:  # the first round does not count
                speeds[layout.format].append(WIDTH * HEIGHT / 1e6 / (time.process_time() - started))
    for name, measured in speeds.items():
        speed = median(measured)
        print(f"{name:13} {speed:6.0f} MP/s{'' if speed >= LEAST else f', less than {LEAST}'}", flush=True)


if __name__ == "__main__":
    main()
