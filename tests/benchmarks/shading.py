"""Measure shading: python -m tests.benchmarks.shading SCENE... [--sigma 0 0.01] [--lens 2,15] [--preset best]

Each scene is photographed through a lens that darkens the corners, and differently in each colour. Of its four corners, each a
fifth of the frame high and wide: the median PSNR of all 10 x 10 patches (RGB, luminance, chrominance; dB) and the mean colour
difference (CIEDE2000, balanced and exposed for the scene), each with

    no lens         the same without shading, with as much noise everywhere
    no lens, noisy  the same without shading, with noise that is multiplied by the gain
    undone          with the shading, which the shot knows
    measured        with the shading as flat frames showed it
    unknown         with the shading, of which the shot says nothing; light that is evened out afterwards
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from offline import BEST, PAPER, RenderSettings, render
from shared import CfaPattern, Mosaic, SensorCalibration, Shading
from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import SRGB_TO_XYZ, xyz_to_lab
from shared.colour_difference import delta_e_2000
from shared.sensor import simulate_additive, simulate_sensor
from tools.calibration.shading import measure_shading
from tools.camera.lens import lens_shading
from tools.evaluation.metrics import patch_psnr
from tools.scenes.load import load_scene

PATTERN = CfaPattern.bayer(6)
KNOWN = SensorCalibration.of_bits(16)
CORNER, EDGE = 5, 6  # part of the frame, and pixels at its edge that are left out
FLATS, LIGHT = 8, 0.6
SEED = 3


def photographed(rgb: FloatArray, sigma: float, shading: Shading | None) -> Mosaic:
    """A shot as it is in a file."""
    taken = simulate_additive(rgb, PATTERN, replace(KNOWN, shading=shading), sigma, np.random.default_rng(SEED))
    return Mosaic(taken.codes, PATTERN, taken.calibration)


def noisy(rgb: FloatArray, sigma: float, shading: Shading) -> Mosaic:
    """A shot without shading, with noise that is multiplied by the gain; it states that of the corners."""
    clean = simulate_additive(rgb, PATTERN, KNOWN, 0.0, np.random.default_rng(SEED))
    gain = shading.of_plane(clean.shape)
    corners = float(np.sqrt(np.mean([np.square(each).mean() for each in cornered(gain)])))
    stated = simulate_additive(rgb, PATTERN, KNOWN, sigma * corners, np.random.default_rng(SEED)).calibration
    for channel, *lattice in PATTERN.lattices:
        gain[*lattice] = shading.of_plane(clean.shape, channel, *lattice)
    noise = np.random.default_rng(SEED).normal(0, sigma, clean.shape).astype(np.float32)
    return Mosaic(Mosaic(clean.samples + noise * gain, PATTERN, stated).codes, PATTERN, stated)


def from_flats(shading: Shading, shape: tuple[int, int]) -> Shading:
    """The shading as a sensor with typical noise shows it in flat frames."""
    sensor = SensorCalibration.of_bits(12, headroom=False, shading=shading)
    even, random = np.ones((*shape, 3), np.float32), np.random.default_rng(SEED)
    frames = [simulate_sensor(even, PATTERN, sensor, LIGHT, random) for _ in range(FLATS)]
    bare = [replace(frame, calibration=replace(frame.calibration, shading=None)) for frame in frames]
    found = measure_shading([(f"flat{number}", frame) for number, frame in enumerate(bare)]).shading
    assert found is not None
    return found


def cornered(plane: FloatArray) -> Iterator[FloatArray]:
    """The four corners of a plane or picture."""
    rows, columns = (length // CORNER for length in plane.shape[:2])
    for down in (slice(EDGE, rows), slice(-rows, -EDGE)):
        for right in (slice(EDGE, columns), slice(-columns, -EDGE)):
            yield plane[down, right]


def figures(picture: FloatArray, rgb: FloatArray) -> list[float]:
    """Median PSNR of RGB, luminance and chrominance, and mean colour difference, in the corners."""
    patches = [patch_psnr(*pair, border=0) for pair in zip(cornered(picture), cornered(rgb), strict=True)]
    planes = [np.concatenate([getattr(patch, name).ravel() for patch in patches]) for name in ("rgb", "luminance", "chrominance")]
    mean = rgb.mean(axis=(0, 1), dtype=np.float64)
    gain = mean.mean() / np.maximum(mean, 1e-6)
    gain = gain * 0.9 / float(np.quantile(rgb @ (gain * SRGB_TO_XYZ[1]), 0.99))

    def lab(seen: FloatArray) -> DoubleArray:
        return xyz_to_lab(np.clip(gain * seen, 0.0, 1.0) @ np.array(SRGB_TO_XYZ).T)

    apart = [delta_e_2000(lab(one), lab(other)).ravel() for one, other in zip(cornered(picture), cornered(rgb), strict=True)]
    return [*(float(np.median(plane)) for plane in planes), float(np.concatenate(apart).mean())]


def pictures(rgb: FloatArray, sigma: float, shading: Shading, settings: RenderSettings) -> Iterator[tuple[str, FloatArray]]:
    """The pictures that are compared, by name."""
    shape = rgb.shape[0], rgb.shape[1]
    yield "no lens", render(photographed(rgb, sigma, None), settings).rgb
    if sigma:
        yield "no lens, noisy", render(noisy(rgb, sigma, shading), settings).rgb
    shot = photographed(rgb, sigma, shading)
    yield "undone", render(shot, settings).rgb
    for name, known in (("measured", from_flats(shading, shape)), ("unknown", None)):
        picture = render(replace(shot, calibration=replace(shot.calibration, shading=known)), settings).rgb
        yield name, picture if known else picture * shading.of_plane(shape)[..., None]


def main() -> None:
    """Print a table for each scene and noise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0, 0.01])
    parser.add_argument("--lens", nargs=2, type=float, default=(2.0, 0.15))
    parser.add_argument("--preset", choices=("best", "paper"), default="best")
    arguments = parser.parse_args()
    stops, colour = arguments.lens
    for source in arguments.scenes:
        rgb = load_scene(source).rgb
        shading = lens_shading(stops, colour, len(PATTERN.planes), (rgb.shape[0], rgb.shape[1]))
        for sigma in arguments.sigma:
            print(f"{Path(source).name}, sigma {sigma:g}: RGB, luminance, chrominance (dB), dE2000")
            for name, picture in pictures(rgb, sigma, shading, BEST if arguments.preset == "best" else PAPER):
                print(f"  {name:16}" + "".join(f"{figure:8.2f}" for figure in figures(picture, rgb)), flush=True)


if __name__ == "__main__":
    main()
