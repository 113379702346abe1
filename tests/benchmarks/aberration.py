"""Measure chromatic aberration: python -m tests.benchmarks.aberration SCENE... [--sigma 0 0.01] [--lens 1,-1] [--preset best]

Each scene is photographed through a lens that displaces the first and the last channel, in the corners by this many pixels. PSNR
(dB): of luminance and chrominance the median of all 10 x 10 patches, chrominance of the whole picture, and the 10 % quantile of the
patches' chrominance, each with

    no lens         the same without aberration
    unknown         with the aberration, of which the shot says nothing
    undone          with the aberration, which the shot knows
    measured        with the aberration as the edges of all shots of this size show it; left out where they do not tell it

At the end means of the scenes, and how much comes back of what is lost.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress

import numpy as np

from offline import RenderSettings, render
from shared import Aberration
from shared.arrays import FloatArray
from shared.errors import InputError
from tests.benchmarks.harness import Corners, compare, photographed
from tests.tools.calibration.known_camera import stating
from tools.calibration.aberration import measure_aberration
from tools.calibration.edges import Edges, find_edges
from tools.camera.lens import lens_aberration
from tools.evaluation.metrics import BORDER, patch_psnr, whole_psnr
from tools.rendering.in_memory import filled_luminance


def figures(picture: FloatArray, rgb: FloatArray) -> list[float]:
    """Median PSNR of luminance and chrominance, that of chrominance of the whole picture, and its 10 % quantile."""
    patches = patch_psnr(picture, rgb)
    medians = [float(np.median(plane)) for plane in (patches.luminance, patches.chrominance)]
    return [*medians, whole_psnr(picture, rgb, BORDER)[2], float(np.quantile(patches.chrominance, 0.1))]


def pictures(
    scenes: Mapping[str, FloatArray], sigma: float, corners: Corners, settings: RenderSettings
) -> Iterator[tuple[str, str, FloatArray]]:
    """The pictures that are compared: source, name, picture."""
    measured = from_edges(scenes, sigma, corners)
    for source, rgb in scenes.items():
        yield source, "no lens", render(photographed(rgb, sigma), settings).rgb
        lens = lens_of(rgb, corners)
        shot, known = photographed(rgb, sigma, aberration=lens), {"unknown": None, "undone": lens}
        if rgb.shape in measured:
            known["measured"] = measured[rgb.shape]
        for name, each in known.items():
            yield source, name, render(stating(shot, aberration=each), settings).rgb


def lens_of(rgb: FloatArray, corners: Corners) -> Aberration:
    """The lens before a scene."""
    return lens_aberration(*corners, rgb.shape[2], (rgb.shape[0], rgb.shape[1]))


def from_edges(scenes: Mapping[str, FloatArray], sigma: float, corners: Corners) -> dict[tuple[int, ...], Aberration]:
    """The aberration that shots of scenes of one shape show together, by shape."""
    shots, found = defaultdict[tuple[int, ...], list[Edges]](list), {}
    for source, rgb in scenes.items():
        with suppress(InputError):
            shot = photographed(rgb, sigma, aberration=lens_of(rgb, corners))
            shots[rgb.shape].append(find_edges(source, shot, filled_luminance))
    for shape, edges in shots.items():
        with suppress(InputError):
            if (shown := measure_aberration(edges)).aberration:
                found[shape] = shown.aberration
                print(f"{shape[1]} x {shape[0]}, sigma {sigma:g}: {shown.words}")
    return found


if __name__ == "__main__":
    compare(__doc__, "luminance, chrominance, of the whole, 10 % (dB)", (1.0, -1.0), pictures, figures)
