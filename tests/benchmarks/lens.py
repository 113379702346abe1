"""What the benchmarks of lens faults share: shots through a lens, and the tables."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from offline import PRESETS, RenderSettings
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.sensor import simulate_additive
from tools.scenes.load import load_scene

PATTERN = CfaPattern.bayer(6)
SEED = 3
Corners = tuple[float, float]
"""The two figures of a lens, as `lens_shading` or `lens_aberration` take them."""
Pictures = Callable[[Mapping[str, FloatArray], float, Corners, RenderSettings], Iterator[tuple[str, str, FloatArray]]]
"""Of scenes (H, W, 3) by their source, a sigma, a lens and settings: source, name of what is compared, and its picture."""


def photographed(rgb: FloatArray, sigma: float, seed: int = SEED, **lens: Any) -> Mosaic:
    """A shot of a scene as it is in a file. lens: `shading` or `aberration` of the sensor's calibration."""
    taken = simulate_additive(rgb, PATTERN, SensorCalibration.of_bits(16, **lens), sigma, np.random.default_rng(seed))
    return Mosaic(taken.codes, PATTERN, taken.calibration)


def compare(text: str, title: str, lens: Corners, pictures: Pictures, figures: Callable[..., list[float]]) -> None:
    """Read the command line, and print a table for each noise: figures of each scene, their means, and what comes back.

    text: of the help.
    title: names of the figures.
    lens: the usual one.
    pictures: what is compared; "no lens" and "unknown" are the best and the worst that can be expected.
    figures: of a picture and the truth, both (H, W, 3).
    """
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0, 0.01])
    parser.add_argument("--lens", nargs=2, type=float, default=lens)
    parser.add_argument("--preset", choices=("best", "paper"), default="best")
    arguments = parser.parse_args()
    scenes = {source: load_scene(source).rgb for source in arguments.scenes}
    for sigma in arguments.sigma:
        print(f"sigma {sigma:g}: {title}")
        rows: dict[str, list[list[float]]] = {}
        for source, name, picture in pictures(scenes, sigma, arguments.lens, PRESETS[arguments.preset]):
            rows.setdefault(name, []).append(figures(picture, scenes[source]))
            print_line(f"{Path(source).name}, {name}", rows[name][-1])
        means = {name: np.mean(found, axis=0) for name, found in rows.items()}
        for name, mean in means.items():
            print_line(f"mean of {len(scenes)} scenes, {name}", mean)
            if name not in ("no lens", "unknown"):
                back = (mean - means["unknown"]) / (means["no lens"] - means["unknown"])
                print_line("    comes back, %", 100 * back)


def print_line(name: str, row: Iterable[float]) -> None:
    """Print figures as a row of the table."""
    print(f"  {name:40}" + "".join(f"{figure:8.2f}" for figure in row), flush=True)
