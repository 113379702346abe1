"""Measure alignment: python -m tests.benchmarks.alignment [SCENE...] [--sigma 0 0.03] [--frames 8]
[--reduce 2]

For each scene and noise, of a simulated burst (motion up to 3 pixels and 0.3 degrees): the median
over the pixels of a frame of the distance between the true and the found place, its median and its
worst over the frames, and what alignment itself estimates. Also: with exposures two stops apart (a
real sensor's noise and clipping instead of sigma); with parallax, the left half shifted by one
pixel more than the right. --reduce: pixels of the scene, each way, that are one of the sensor.

Without scenes: the test photographs (PANCHROMA_TEST_DATA).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from panchroma.offline import BEST
from panchroma.offline.burst import Motion, in_frame, in_reference
from panchroma.offline.burst.align import Alignment, View, align
from panchroma.offline.stages.luminance import recover_luminance
from panchroma.shared import FloatArray, Mosaic, SensorCalibration
from panchroma.tools.simulation.load import load_scene
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from panchroma.tools.simulation.simulated_camera import SimulatedBurst, SimulatedFrame, burst_frames
from tests.benchmarks.harness import PATTERN, options, photographs, resampled

CALIBRATION = SensorCalibration.of_bits(12, headroom=False)
PIXELS, DEGREES = 3.0, 0.3
STOPS = 2.0
SMOOTH = 24  # nodes across the frame, over which parallax goes from one side to the other


Figures = list[tuple[float, float]]
"""Of the frames of a burst that were not refused: median error of each, and the estimated error,
pixels.
"""


def photograph(frame: SimulatedFrame, sigma: float | None, seed: int) -> Mosaic:
    """A mosaic of the frame. sigma: None = by a real sensor."""
    random = np.random.default_rng(seed)
    if sigma is None:
        taken = simulate_sensor(frame.rgb, PATTERN, CALIBRATION, frame.exposure, random)
        return taken.in_scene_units()
    return simulate_additive(frame.rgb, PATTERN, CALIBRATION, sigma, random)


def measured(
    frames: list[SimulatedFrame], sigma: float | None, local: FloatArray | None = None
) -> Figures:
    """Align the frames to the first. local: what their motion has besides."""
    mosaics = [photograph(frame, sigma, seed) for seed, frame in enumerate(frames)]
    limit = 0.98 * CALIBRATION.full_scale if sigma is None else np.inf
    views = [
        View(recover_luminance(mosaic, BEST.luminance), mosaic.calibration.noise, limit)
        for mosaic in mosaics
    ]
    y, x = np.indices(mosaics[0].shape)
    figures = []
    for frame, view in zip(frames[1:], views[1:], strict=True):
        alignment = align(views[0], view)
        if isinstance(alignment, Alignment):
            found, true = (
                in_frame(motion, y, x, mosaics[0].shape)
                for motion in (alignment.motion, Motion(*frame.motion, local))
            )
            figures.append((float(np.median(np.hypot(*(found - true)))), alignment.error))
    return figures


def with_parallax(frames: list[SimulatedFrame], local: FloatArray) -> list[SimulatedFrame]:
    """The first frame, and what it shows after each motion with local shifts besides.

    Interpolated from the first frame, which its pixels have sampled already: its finest detail is
    not what a sensor would see.
    """
    rgb = frames[0].rgb
    shape = rgb.shape[0], rgb.shape[1]
    y, x = np.indices(shape).astype(np.float32)
    shifted = [frames[0]]
    for frame in frames[1:]:
        back = in_reference(Motion(*frame.motion, local), y, x, shape)
        shifted.append(replace(frame, rgb=resampled(rgb, back, 5)))
    return shifted


def cases(
    rgb: FloatArray, count: int, pixel: int, sigmas: list[float]
) -> Iterator[tuple[str, Figures]]:
    """The figures of a scene, by what they are of."""
    bracket = (0.0, *((-STOPS, STOPS) * count)[: count - 1])
    still, exposures = (
        list(burst_frames(rgb, burst, np.random.default_rng(1), pixel))
        for burst in (SimulatedBurst(count, PIXELS, DEGREES, stops) for stops in ((), bracket))
    )
    local = np.zeros((2, SMOOTH + 1, 2), np.float32)
    local[:, :, 1] = 0.5 * np.tanh((SMOOTH / 2 - np.arange(SMOOTH + 1)) / 2)
    for sigma in sigmas:
        yield f"sigma {sigma:g}", measured(still, sigma)
        yield f"sigma {sigma:g}, parallax", measured(with_parallax(still, local), sigma, local)
    yield f"exposures {STOPS:g} stops apart", measured(exposures, None)


def main() -> None:
    """Print the tables."""
    arguments = options(__doc__, "*", sigma=[0.0, 0.03], frames=8, reduce=2)
    count = arguments.frames
    print(f"{'':58}{'error':>8}{'worst':>8}{'estimate':>10}{'refused':>9}")
    for scene in arguments.scenes or photographs():
        loaded = load_scene(str(scene), linear=True)
        for what, figures in cases(loaded.rgb, count, arguments.reduce, arguments.sigma):
            middle, estimate = np.median(figures or [(np.inf, np.inf)], axis=0)
            worst, refused = max(figures, default=(np.inf,))[0], count - 1 - len(figures)
            line = f"{loaded.name:26}{what:32}{middle:8.3f}{worst:8.3f}{estimate:10.3f}"
            print(f"{line}{refused:9d}", flush=True)


if __name__ == "__main__":
    main()
