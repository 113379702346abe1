"""The results that `tests.arm` compares: everything that the camera's software makes of a few
frames, saved as arrays.

Runs with nothing but the base dependencies: python -m tests.arm.probe RESULT.npz
"""

import sys
from io import BytesIO
from itertools import product

import numpy as np

from panchroma.device import Preview
from panchroma.device.capture import Sensor
from panchroma.device.capture.frames import FrameLayout, RawFrame
from panchroma.device.preview.geometry import Geometry
from panchroma.shared import CfaPattern, runtime
from panchroma.shared.dng import encode_dng, read_dng
from tests.shared.dng.examples import calibration

PATTERNS = {
    "K6": CfaPattern.bayer(6),
    "K4": CfaPattern.bayer(4, "BGGR", (3, 1)),
    "K8": CfaPattern.bayer(8, "GRBG", (5, 2)),
}
LAYOUTS = (FrameLayout(83, 61, "raw10"), FrameLayout(160, 120, "raw12", 256))


def graphs(pattern: CfaPattern) -> list[tuple[int, bool]]:
    """The (scale, linear) of every graph for a pattern."""
    return list(product(Geometry.scales(pattern), (False, True)))


def probe() -> dict[str, np.ndarray]:
    """Name -> pictures of noise, the hardest scene, and samples of a shot; for every pattern, its
    graphs and every packing.
    """
    made: dict[str, np.ndarray] = {"onnxruntime": np.array(runtime.onnxruntime.__version__)}
    for name, pattern in PATTERNS.items():
        for layout in LAYOUTS:
            random, stated = np.random.default_rng(layout.bits), calibration(bits=layout.bits)
            data = random.integers(0, 256, layout.frame_bytes, np.uint8).tobytes()
            mosaic = Sensor(layout, pattern, stated).mosaic(RawFrame.now(data))
            pictures = {
                (scale, linear): Preview(pattern, scale, linear=linear, threads=2).run(mosaic)
                for scale, linear in (graphs(pattern) if layout is LAYOUTS[0] else [(1, False)])
            }
            made |= {
                f"{name} {layout.format} {scale}{' linear' * linear}": each
                for (scale, linear), each in pictures.items()
            }
            shot = encode_dng(mosaic, np.asarray(pictures[1, False], np.uint8))
            made[f"{name} {layout.format} samples"] = read_dng(BytesIO(shot)).codes
    return made


if __name__ == "__main__":
    np.savez(sys.argv[1], **probe())  # type: ignore[arg-type]  # NumPy 2.0 would store an "allow_pickle"
