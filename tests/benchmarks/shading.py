"""Measure shading: python -m tests.benchmarks.shading SCENE... [--sigma 0 0.01]

Each scene is photographed through a lens that darkens the corners by two stops, and differently in
each colour. Of its four corners, each a fifth of the frame high and wide: the median PSNR of all 10
x 10 patches (RGB, luminance, chrominance; dB) and the mean colour difference (CIEDE2000, balanced
and exposed for the scene), each with

    no lens         the same without shading, with as much noise everywhere
    undone          with the shading, which the shot knows
    unknown         with the shading, of which the shot says nothing; light that is evened out afterwards
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from panchroma.offline import render
from panchroma.shared import DoubleArray, FloatArray
from panchroma.shared.colorimetry import SRGB_TO_XYZ
from panchroma.tools.evaluation.metrics import patch_psnr
from panchroma.tools.io.colour import delta_e_2000, xyz_to_lab
from panchroma.tools.simulation.lens import lens_shading
from panchroma.tools.simulation.load import load_scene
from tests.benchmarks.harness import PATTERN, options, photographed
from tests.tools.calibration.known_camera import stating

CORNER, EDGE = 5, 6  # part of the frame, and pixels at its edge that are left out
# stops, and part of them that differs between colours, as `lens_shading` takes them
LENS = 2.0, 0.15


def cornered(plane: FloatArray) -> Iterator[FloatArray]:
    """The four corners of a plane or picture."""
    rows, columns = (length // CORNER for length in plane.shape[:2])
    for down in (slice(EDGE, rows), slice(-rows, -EDGE)):
        for right in (slice(EDGE, columns), slice(-columns, -EDGE)):
            yield plane[down, right]


def figures(picture: FloatArray, rgb: FloatArray) -> list[float]:
    """Median PSNR of RGB, luminance and chrominance, and mean colour difference, in the corners."""
    pairs = zip(cornered(picture), cornered(rgb), strict=True)
    corners = zip(*(patch_psnr(*pair, border=0) for pair in pairs), strict=True)
    planes = [np.concatenate([patches.ravel() for patches in plane]) for plane in corners]
    mean = rgb.mean(axis=(0, 1), dtype=np.float64)
    gain = mean.mean() / np.maximum(mean, 1e-6)
    gain = gain * 0.9 / float(np.quantile(rgb @ (gain * SRGB_TO_XYZ[1]), 0.99))

    def lab(seen: FloatArray) -> DoubleArray:
        return xyz_to_lab(np.clip(gain * seen, 0.0, 1.0) @ np.array(SRGB_TO_XYZ).T)

    apart = [
        delta_e_2000(lab(one), lab(other)).ravel()
        for one, other in zip(cornered(picture), cornered(rgb), strict=True)
    ]
    return [*(float(np.median(plane)) for plane in planes), float(np.concatenate(apart).mean())]


def pictures(rgb: FloatArray, sigma: float) -> Iterator[tuple[str, FloatArray]]:
    """Name and picture of each row."""
    shape = rgb.shape[0], rgb.shape[1]
    shading = lens_shading(*LENS, len(PATTERN.planes), shape)
    shot = photographed(rgb, sigma, shading=shading)
    yield "no lens", render(photographed(rgb, sigma)).rgb
    yield "undone", render(shot).rgb
    yield "unknown", render(stating(shot, shading=None)).rgb * shading.of_plane(shape)[..., None]


def main() -> None:
    """Print the rows of each scene, and their means, for each noise."""
    given = options(__doc__, "+", sigma=[0.0, 0.01])
    for sigma in given.sigma:
        print(f"sigma {sigma:g}: RGB, luminance, chrominance (dB), dE2000")
        rows = defaultdict[str, list[list[float]]](list)
        for source in given.scenes:
            rgb = load_scene(source).rgb
            for name, picture in pictures(rgb, sigma):
                rows[name].append(figures(picture, rgb))
                line(f"{Path(source).name}, {name}", rows[name][-1])
        for name, found in rows.items():
            line(f"mean, {name}", np.mean(found, axis=0))


def line(name: str, row: Iterable[float]) -> None:
    """Print figures as a row of a table."""
    print(f"  {name:40}" + "".join(f"{figure:8.2f}" for figure in row), flush=True)


if __name__ == "__main__":
    main()
