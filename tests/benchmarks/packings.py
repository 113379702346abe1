"""How fast is each packing of raw frames unpacked? python -m tests.benchmarks.packings [--rounds 9]

A frame of 4056 x 3040 pixels with padded lines; megapixels per second of processor time, which one
core has: the median of rounds, in which the formats take turns.
"""

import time
from functools import partial
from statistics import median

import numpy as np

from panchroma.device.capture.frames import FORMATS, FrameLayout
from tests.benchmarks.harness import alternate, options

WIDTH, HEIGHT, ALIGNMENT = 4056, 3040, 64  # pixels; bytes


def main() -> None:
    """Print a line for each format."""
    rounds, works = options(__doc__, rounds=9).rounds, {}
    for name in FORMATS:
        line = FrameLayout(WIDTH, HEIGHT, name).line_bytes
        layout = FrameLayout(WIDTH, HEIGHT, name, (line // ALIGNMENT + 1) * ALIGNMENT)
        works[name] = partial(layout.unpack, np.random.default_rng(0).bytes(layout.frame_bytes))
    for name, seconds in alternate(works, rounds, time.process_time).items():
        print(f"{name:13} {WIDTH * HEIGHT / 1e6 / median(seconds):6.0f} MP/s", flush=True)


if __name__ == "__main__":
    main()
