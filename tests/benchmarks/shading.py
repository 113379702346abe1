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

from collections.abc import Iterator, Mapping

import numpy as np

from offline import RenderSettings, render
from shared import Mosaic, SensorCalibration, Shading
from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import SRGB_TO_XYZ
from tests.benchmarks.harness import PATTERN, SEED, Corners, compare, photographed
from tests.tools.calibration.known_camera import stating
from tools.calibration.shading import measure_shading
from tools.evaluation.metrics import patch_psnr
from tools.io.colour import xyz_to_lab
from tools.io.colour_difference import delta_e_2000
from tools.simulation.lens import lens_shading
from tools.simulation.sensor import simulate_additive, simulate_sensor

KNOWN = SensorCalibration.of_bits(16)
CORNER, EDGE = 5, 6  # part of the frame, and pixels at its edge that are left out
FLATS, LIGHT = 8, 0.6


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
    return measure_shading([(f"flat{number}", stating(frame, shading=None)) for number, frame in enumerate(frames)]).shading


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


def pictures(
    scenes: Mapping[str, FloatArray], sigma: float, corners: Corners, settings: RenderSettings
) -> Iterator[tuple[str, str, FloatArray]]:
    """The pictures that are compared: source, name, picture."""
    for source, rgb in scenes.items():
        shape = rgb.shape[0], rgb.shape[1]
        shading = lens_shading(*corners, len(PATTERN.planes), shape)
        shot = photographed(rgb, sigma, shading=shading)
        yield source, "no lens", render(photographed(rgb, sigma), settings).rgb
        if sigma:
            yield source, "no lens, noisy", render(noisy(rgb, sigma, shading), settings).rgb
        yield source, "undone", render(shot, settings).rgb
        yield source, "measured", render(stating(shot, shading=from_flats(shading, shape)), settings).rgb
        yield source, "unknown", render(stating(shot, shading=None), settings).rgb * shading.of_plane(shape)[..., None]


if __name__ == "__main__":
    compare(__doc__, "RGB, luminance, chrominance (dB), dE2000", (2.0, 0.15), pictures, figures)
