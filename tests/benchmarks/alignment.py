"""Measure alignment: python -m tests.benchmarks.alignment [SCENE...] [--sigma 0 0.03] [--frames 8] [--reduce 2]

For each scene and noise, of a simulated burst (motion up to 3 pixels and 0.3 degrees): the median over the pixels of a frame of the
distance between the true and the found place, its median and its worst over the frames, what alignment itself estimates, and the
processor's time for a frame. Also: with a thing that moves through the scene; with exposures two stops apart
(a real sensor's noise and clipping instead of sigma); with parallax, the left half shifted by one pixel more than the right.

Without scenes: the test photographs (PANCHROMA_TEST_DATA).
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from offline import BEST
from offline.burst import View, align
from offline.whole.luminance import recover_luminance
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.sensor import simulate_additive, simulate_sensor
from tests.data import DATA
from tools.camera.burst import SimulatedBurst, SimulatedFrame, burst_frames
from tools.scenes.load import load_scene

PATTERN, CALIBRATION = CfaPattern.bayer(6), SensorCalibration.of_bits(12, headroom=False)
PIXELS, DEGREES = 3.0, 0.3
STOPS = 2.0
SMOOTH = 24  # nodes across the frame, over which parallax goes from one side to the other


@dataclass(frozen=True)
class Figures:
    """Of the frames of a burst: median error of each, pixels; estimated errors; seconds; how many were refused."""

    errors: list[float]
    estimates: list[float]
    seconds: list[float]
    refused: int

    def __str__(self) -> str:
        if not self.errors:
            return f"{'all refused':>40}"
        middle, worst, estimate = np.median(self.errors), max(self.errors), np.median(self.estimates)
        return f"{middle:8.3f}{worst:8.3f}{estimate:10.3f}{np.median(self.seconds):9.2f}{self.refused:5d}"


def photograph(frame: SimulatedFrame, sigma: float | None, seed: int) -> Mosaic:
    """A mosaic of the frame. sigma: None = by a real sensor."""
    random = np.random.default_rng(seed)
    if sigma is None:
        return simulate_sensor(frame.rgb, PATTERN, CALIBRATION, frame.exposure, random).in_scene_units()
    return simulate_additive(frame.rgb, PATTERN, CALIBRATION, sigma, random)


def measured(frames: list[SimulatedFrame], sigma: float | None, local: FloatArray | None = None) -> Figures:
    """Align the frames to the first. local: what their motion has besides."""
    mosaics = [photograph(frame, sigma, seed) for seed, frame in enumerate(frames)]
    limit = 0.98 * CALIBRATION.full_scale if sigma is None else np.inf
    views = [View(recover_luminance(mosaic, BEST.luminance), mosaic.calibration.noise, limit) for mosaic in mosaics]
    align(views[0], views[0])  # compiles
    figures = Figures([], [], [], 0)
    refused = 0
    for frame, view in zip(frames[1:], views[1:], strict=True):
        begin = time.process_time()
        try:
            found = align(views[0], view)
        except InputError:
            refused += 1
            continue
        figures.seconds.append(time.process_time() - begin)
        figures.estimates.append(found.error)
        true = replace(frame.motion, local=local)
        places = [motion.places(slice(None), mosaics[0].shape) for motion in (found.motion, true)]
        figures.errors.append(float(np.median(np.hypot(places[0][0] - places[1][0], places[0][1] - places[1][1]))))
    return replace(figures, refused=refused)


def with_parallax(frames: list[SimulatedFrame], local: FloatArray) -> list[SimulatedFrame]:
    """The first frame, and what it shows after each motion with local shifts besides.

    Interpolated from the first frame, which its pixels have sampled already: its finest detail is not what a sensor would see.
    """
    from scipy.ndimage import map_coordinates

    rgb = frames[0].rgb
    shape = rgb.shape[0], rgb.shape[1]
    y, x = np.indices(shape).astype(np.float32)
    shifted = [frames[0]]
    for frame in frames[1:]:
        back = np.stack(replace(frame.motion, local=local).back(y, x, shape))
        planes = [map_coordinates(rgb[..., channel], back, order=5, mode="mirror") for channel in range(rgb.shape[2])]
        shifted.append(replace(frame, rgb=np.stack(planes, axis=-1).astype(np.float32)))
    return shifted


def cases(rgb: FloatArray, count: int, pixel: int, sigmas: list[float]) -> Iterator[tuple[str, Figures]]:
    """The figures of a scene, by what they are of."""
    plain = SimulatedBurst(count, PIXELS, DEGREES)
    bracket = (0.0, *((-STOPS, STOPS) * count)[: count - 1])
    still, moving, exposures = (
        list(burst_frames(rgb, burst, np.random.default_rng(1), pixel))
        for burst in (plain, replace(plain, moving=True), replace(plain, stops=bracket))
    )
    local = np.zeros((2, SMOOTH + 1, 2), np.float32)
    local[:, :, 1] = 0.5 * np.tanh((SMOOTH / 2 - np.arange(SMOOTH + 1)) / 2)
    for sigma in sigmas:
        yield f"sigma {sigma:g}", measured(still, sigma)
        yield f"sigma {sigma:g}, moving thing", measured(moving, sigma)
        yield f"sigma {sigma:g}, parallax", measured(with_parallax(still, local), sigma, local)
    yield f"exposures {STOPS:g} stops apart", measured(exposures, None)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0, 0.03])
    parser.add_argument("--frames", type=int, default=8, metavar="N")
    parser.add_argument(
        "--reduce", type=int, default=2, metavar="PIXELS", help="pixels of the scene, each way, that are one of the sensor"
    )
    options = parser.parse_args()
    scenes = options.scenes or [str(path) for folder in ("raw", "linear") for path in sorted((DATA / folder).iterdir())]
    print(f"{'':58}{'error':>8}{'worst':>8}{'estimate':>10}{'seconds':>9}{'refused':>9}")
    collected: dict[str, list[tuple[float, str]]] = {}
    for scene in scenes:
        loaded = load_scene(scene, linear=True)
        for what, figures in cases(loaded.rgb, options.frames, options.reduce, options.sigma):
            print(f"{loaded.name:26}{what:32}{figures}", flush=True)
            collected.setdefault(what, []).append((float(np.median(figures.errors or [np.inf])), loaded.name))
    for what, errors in collected.items():
        figures_of_all = [error for error, _ in errors]
        print(f"{'all: median, worst scene':26}{what:32}{np.median(figures_of_all):8.3f}{max(errors)[0]:8.3f}  {max(errors)[1]}")


if __name__ == "__main__":
    main()
