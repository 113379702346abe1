"""Measure chromatic aberration: python -m tests.benchmarks.aberration SCENE... [--sigma 0 0.01] [--lens 1,-1] [--preset best]

Each scene is photographed through a lens that displaces the first and the last channel, in the corners by so many pixels. PSNR
(dB): of luminance and chrominance the median of all 10 x 10 patches, chrominance of the whole picture, and the 10 % quantile of the
patches' chrominance, each with

    no lens         the same without aberration
    unknown         with the aberration, of which the shot says nothing
    undone          with the aberration, which the shot knows
    measured        with the aberration as the edges of all shots of this size show it; left out where they do not tell it

At the end means of the scenes, and how much comes back of what is lost.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from offline import BEST, PAPER, RenderSettings, render
from shared import Aberration, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.sensor import simulate_additive
from tools.calibration.aberration import measure_aberration
from tools.calibration.edges import Edges, find_edges
from tools.camera.lens import lens_aberration
from tools.evaluation.metrics import BORDER, patch_psnr, whole_psnr
from tools.rendering.in_memory import filled_luminance
from tools.scenes.load import load_scene

PATTERN = CfaPattern.bayer(6)
SEED = 3


def photographed(rgb: FloatArray, sigma: float, lens: Aberration | None, seed: int = SEED) -> Mosaic:
    """A shot as it is in a file."""
    sensor = SensorCalibration.of_bits(16, aberration=lens)
    taken = simulate_additive(rgb, PATTERN, sensor, sigma, np.random.default_rng(seed))
    return Mosaic(taken.codes, PATTERN, taken.calibration)


def figures(picture: FloatArray, rgb: FloatArray) -> list[float]:
    """Median PSNR of luminance and chrominance, that of chrominance of the whole picture, and its 10 % quantile."""
    patches = patch_psnr(picture, rgb)
    medians = [float(np.median(plane)) for plane in (patches.luminance, patches.chrominance)]
    return [*medians, whole_psnr(picture, rgb, BORDER)[2], float(np.quantile(patches.chrominance, 0.1))]


def pictures(
    rgb: FloatArray, sigma: float, lens: Aberration, measured: Aberration | None, settings: RenderSettings
) -> Iterator[tuple[str, FloatArray]]:
    """The pictures that are compared, by name."""
    yield "no lens", render(photographed(rgb, sigma, None), settings).rgb
    shot = photographed(rgb, sigma, lens)
    for name, each in {"unknown": None, "undone": lens, **({"measured": measured} if measured else {})}.items():
        yield name, render(replace(shot, calibration=replace(shot.calibration, aberration=each)), settings).rgb


def from_edges(scenes: Sequence[str], sigma: float, corners: tuple[float, float]) -> dict[tuple[int, ...], Aberration]:
    """The aberration that shots of scenes of one size show together, by size."""
    shots: dict[tuple[int, ...], list[Edges]] = {}
    for source in scenes:
        rgb = load_scene(source).rgb
        lens = lens_aberration(*corners, rgb.shape[2], (rgb.shape[0], rgb.shape[1]))
        with suppress(InputError):
            shots.setdefault(rgb.shape[:2], []).append(find_edges(source, photographed(rgb, sigma, lens), filled_luminance))
    found = {}
    for size, edges in shots.items():
        with suppress(InputError):
            if (shown := measure_aberration(edges)).aberration:
                found[size] = shown.aberration
                print(f"{size[1]} x {size[0]}, sigma {sigma:g}: {shown.words}")
    return found


def main() -> None:
    """Print a table for each scene and noise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0, 0.01])
    parser.add_argument("--lens", nargs=2, type=float, default=(1.0, -1.0))
    parser.add_argument("--preset", choices=("best", "paper"), default="best")
    arguments = parser.parse_args()
    first, last = arguments.lens
    settings = BEST if arguments.preset == "best" else PAPER
    for sigma in arguments.sigma:
        rows: dict[str, list[list[float]]] = {}
        measured = from_edges(arguments.scenes, sigma, arguments.lens)
        for source in arguments.scenes:
            rgb = load_scene(source).rgb
            lens = lens_aberration(first, last, rgb.shape[2], (rgb.shape[0], rgb.shape[1]))
            print(f"{Path(source).name}, sigma {sigma:g}: luminance, chrominance, of the whole, 10 % (dB)")
            for name, picture in pictures(rgb, sigma, lens, measured.get(rgb.shape[:2]), settings):
                rows.setdefault(name, []).append(figures(picture, rgb))
                print(line(name, rows[name][-1]), flush=True)
        means = {name: np.mean(found, axis=0) for name, found in rows.items()}
        print(f"mean of {len(arguments.scenes)} scenes, sigma {sigma:g}")
        for name, mean in means.items():
            print(line(name, mean))
            if name not in ("no lens", "unknown"):
                back = (mean - means["unknown"]) / (means["no lens"] - means["unknown"])
                print("    comes back    " + "".join(f"{100 * share:6.0f} %" for share in back))


def line(name: str, row: Iterable[float]) -> str:
    """Figures as a row of the table."""
    return f"  {name:16}" + "".join(f"{figure:8.2f}" for figure in row)


if __name__ == "__main__":
    main()
