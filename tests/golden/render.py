"""Generate the pictures that `offline.version.ALGORITHM` stands for: python -m tests.golden.render

Run it after raising the number, and say in the change what is different. (Before the first release
the number may stay.)
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import llvmlite
import llvmlite.binding
import numba
import numpy as np
import onnxruntime

from panchroma.offline import BEST, PAPER, render
from panchroma.offline.version import ALGORITHM
from panchroma.shared import CfaPattern, FloatArray, Mosaic, SensorCalibration
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.sensor import simulate_additive
from tests.scenes import leaves

PRESETS = {"paper": PAPER, "best": BEST}
_FACTS, _PICTURES = (Path(__file__).with_name(f"render.{suffix}") for suffix in ("json", "npz"))


@dataclass(frozen=True)
class Golden:
    """Pictures to compare with.

    algorithm: the number of the algorithm that made them.
    made_by: the compiler and the processor that made them.
    pictures: preset -> the rendering in scene units and for a display, float32 (2, H, W, 3).
    digests: preset -> SHA-256 of the picture's bytes.
    """

    algorithm: int
    made_by: str
    pictures: dict[str, FloatArray]
    digests: dict[str, str]


def now() -> Golden:
    """The pictures that this source makes on this machine."""
    pictures = {name: _picture(name) for name in PRESETS}
    digests = {
        name: hashlib.sha256(picture.tobytes()).hexdigest() for name, picture in pictures.items()
    }
    return Golden(ALGORITHM, _compiler(), pictures, digests)


def saved() -> Golden:
    """The pictures that were kept."""
    with np.load(_PICTURES) as file:
        pictures = {name: file[name] for name in PRESETS}
    return Golden(**json.loads(_FACTS.read_text()), pictures=pictures)


def _picture(preset: str) -> FloatArray:
    """The rendering of a noisy shot of leaves, 36 x 28, K = 6."""
    calibration = SensorCalibration.of_bits(12, gamma=(0.9, 1.1, 0.8))
    scene, pattern, random = leaves(28, 36), CfaPattern.bayer(6), np.random.default_rng(0)
    taken = simulate_additive(scene, pattern, calibration, 0.02, random)
    rgb = render(Mosaic(taken.codes, taken.pattern, taken.calibration), PRESETS[preset]).rgb
    return np.stack([rgb, ColourTransform.to_space(calibration, "srgb").apply(rgb)])


def _compiler() -> str:
    """Everything that the bytes may depend on. Processors with other instructions round sums of
    floats differently.
    """
    features = numba.config.CPU_FEATURES or llvmlite.binding.get_host_cpu_features().flatten()
    processor = numba.config.CPU_NAME or llvmlite.binding.get_host_cpu_name()
    digest = hashlib.sha256(features.encode()).hexdigest()[:8]
    packages = ", ".join(f"{each.__name__} {each.__version__}" for each in (np, numba, llvmlite))
    return f"{packages}, onnxruntime {onnxruntime.__version__}, {processor} {digest}"


def main() -> None:
    """Write both files."""
    made = now()
    facts = {"algorithm": made.algorithm, "made_by": made.made_by, "digests": made.digests}
    _FACTS.write_text(json.dumps(facts, indent=1) + "\n")
    np.savez_compressed(_PICTURES, **made.pictures)  # type: ignore[arg-type]
    print(f"algorithm {made.algorithm}, {made.made_by}: {', '.join(made.pictures)}")


if __name__ == "__main__":
    main()
