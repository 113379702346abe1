"""Measure how well edges tell lateral chromatic aberration: python -m tests.benchmarks.edges

A sensor with shot and read noise behind lenses that displace red and blue by (1, -0.5), (-0.6, 0.8), (0.2, 0) and (0, 0) pixels in
the corners. Per set of shots: how far the displacement is off, in pixels, its standard error, and what was concluded.
Photographs are not free of aberration themselves: where theirs is not small, it is part of what is off.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from shared import CfaPattern, Mosaic
from shared.errors import InputError
from shared.sensor import simulate_sensor
from tests.data import DATA
from tests.tools.calibration.known_camera import PATTERNS, TRUTH, stating
from tools.calibration.aberration import measure_aberration
from tools.calibration.edges import find_edges
from tools.camera.lens import lens_aberration
from tools.rendering.in_memory import filled_luminance
from tools.scenes.load import load_scene

LENSES = (1.0, -0.5), (-0.6, 0.8), (0.2, 0.0), (0.0, 0.0)
SETS = {
    "chart, 1.0 MP": ("chart:1200x800",),
    "drawn scene, 1.0 MP": ("builtin:1200x800",),
    **{f"kodim{number}, 0.4 MP": (f"kodak/kodim{number}.png",) for number in ("05", "08", "24")},
    "five photographs, 0.4 MP": tuple(f"kodak/kodim{number}.png" for number in ("05", "08", "13", "23", "24")),
    "eight photographs, 0.1 MP": tuple(f"linear/intel_tau_{number:03}.png" for number in (1, 3, 4, 5, 11, 12, 13, 15)),
}


def taken(source: str, pattern: CfaPattern, lens: tuple[float, float], seed: int) -> Mosaic:
    """A shot of a scene, which does not know its lens."""
    rgb = load_scene(source if ":" in source else str(DATA / source)).rgb
    sensor = replace(TRUTH, aberration=lens_aberration(*lens, 3, rgb.shape[:2]))
    shot = simulate_sensor(rgb, pattern, sensor, 0.6, np.random.default_rng(seed))
    return stating(shot, aberration=None)


def main() -> None:
    """Print every figure."""
    for name, pattern in list(PATTERNS.items())[:4]:
        off, units, refused = [], [], 0
        for (title, sources), lens in product(SETS.items(), LENSES):
            shots = [find_edges(each, taken(each, pattern, lens, seed), filled_luminance) for seed, each in enumerate(sources)]
            line = f"{name}, {title}, R {lens[0]:+.1f} B {lens[1]:+.1f}: "
            try:
                found = measure_aberration(shots)
            except InputError as error:
                refused += 1
                print(f"{line}refused: {error}", flush=True)
                continue
            errors, known = found.corner[[0, 2]] - lens, found.error[[0, 2]]
            off.append(errors)
            units.append(errors / known)
            kind = "measured" if found.aberration else "none"
            print(f"{line}off by {errors.round(2)} ± {known.round(2)} pixels, {kind}", flush=True)
        mean, mean_units = (float(np.sqrt(np.mean(np.square(each)))) for each in (off, units))
        all_ = f"off by {mean:.2f} pixels, {mean_units:.2f} standard errors (root mean square)"
        print(f"{name}: {all_}, {refused} refused", flush=True)


if __name__ == "__main__":
    main()
