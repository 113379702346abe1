"""Measure bursts: python -m tests.benchmarks.burst [SCENE...] [--sigma 0 0.01 0.03] [--frames 8]

Scenes reduced 2 x 2 are photographed by hand: frames up to 3 pixels and 0.3 degrees away from the
first, which is the reference and the truth. For each noise: PSNR (dB) of RGB, as median and 10 %
quantile of all 10 x 10 patches and of the whole picture, means over the scenes, and which frames
were left out. The rows:

    best            `best` of the reference alone
    burst           all frames, aligned and merged
    pixel shift     nine frames 2 pixels apart, whose motion is known
    bayer           the best Bayer rival of one frame: DLMMSE, with noise BM3D before it
    bayer burst     the same frames through a Bayer sensor, merged by the same alignment
                    (tests/benchmarks/bayer_burst.py)

`tests.benchmarks.alignment` measures how far the motion that was found is from the true one.
Without scenes: those test photographs (PANCHROMA_TEST_DATA) that have at least 300 pixels a side
when reduced. The rivals need the package `bm3d`, and minutes.
"""

import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from panchroma.offline import BEST, render
from panchroma.offline.burst import Motion, merge_burst, render_burst_bands
from panchroma.shared import FloatArray, Mosaic, SensorCalibration
from panchroma.tools.evaluation.cameras import CameraPair
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.io.versions import package_version
from panchroma.tools.simulation.load import load_scene
from panchroma.tools.simulation.protocols import PaperProtocol
from panchroma.tools.simulation.sensor import simulate_additive
from panchroma.tools.simulation.simulated_camera import SimulatedBurst, burst_frames
from tests.bayer import bayer_mosaic
from tests.benchmarks.alignment import DEGREES, PIXELS
from tests.benchmarks.bayer_burst import render_bayer_burst
from tests.benchmarks.harness import PATTERN, options, photographs, psnrs

REDUCED, LEAST = 2, 300
# of pixel shift, down and right, pixels, the reference first
STEPS = list(product((0, -2, 2), repeat=2))


@dataclass(frozen=True)
class Series:
    """A scene and how it was photographed.

    light: float32 (H, W, 3) of each frame, scene units; the first is the reference.
    shifted: frames of an exact pixel shift by STEPS, with the same reference.
    neutral: what white reads.
    """

    name: str
    light: list[FloatArray]
    shifted: list[FloatArray]
    neutral: tuple[float, ...] | None

    @classmethod
    def of(cls, source: Path, count: int) -> "Series | None":
        """Frames of a scene; None if it is too small."""
        scene = load_scene(str(source))
        if min(scene.rgb.shape[:2]) // REDUCED < LEAST:
            return None
        # the same for a scene whichever others there are
        rng = np.random.default_rng(zlib.crc32(source.name.encode()))
        frames = list(burst_frames(scene.rgb, SimulatedBurst(count, PIXELS, DEGREES), rng, REDUCED))
        sensor = next(burst_frames(scene.rgb, SimulatedBurst(1), rng, REDUCED)).rgb
        rows, columns = frames[0].rgb.shape[:2]
        top, left = (sensor.shape[0] - rows) // 2, (sensor.shape[1] - columns) // 2
        return cls(
            source.stem,
            [frame.rgb for frame in frames],
            [
                sensor[top - down : top - down + rows, left - across : left - across + columns]
                for down, across in STEPS
            ],
            scene.neutral,
        )


def shots(light: list[FloatArray], sigma: float) -> list[Mosaic]:
    """The frames through the sparse-colour sensor."""
    camera = SensorCalibration()
    return [
        simulate_additive(frame, PATTERN, camera, sigma, np.random.default_rng([0, n]))
        for n, frame in enumerate(light)
    ]


def merged_picture(
    name: str, frames: list[Mosaic], motions: list[Motion] | None = None
) -> FloatArray:
    """The picture of a burst; tells which of its frames are left out."""
    merged = merge_burst(frames, BEST, reference=0, motions=motions)
    for number, frame in enumerate(merged.frames, 1):
        if not frame.used:
            print(f"{name}, frame {number} is left out: {frame.reason}")
    return np.concatenate(list(render_burst_bands(merged, BEST)))


def pictures(series: Series, sigma: float) -> Iterator[tuple[str, FloatArray]]:
    """Name and picture of each row."""
    frames = shots(series.light, sigma)
    steps = [Motion((float(down), float(across))) for down, across in STEPS]
    yield "best", render(frames[0], BEST).rgb
    yield "burst", merged_picture(series.name, frames)
    yield "pixel shift", merged_picture(series.name, shots(series.shifted, sigma), steps)
    if not package_version("bm3d"):
        return
    rival = methods()["bm3d+dlmmse-wb" if sigma else "dlmmse-wb"]
    cameras = CameraPair(PaperProtocol(sigma), 0, series.light[0], PATTERN, series.neutral)
    yield "bayer", rival.render(cameras)
    mosaics = [
        bayer_mosaic(light, sigma, np.random.default_rng([0, n]))
        for n, light in enumerate(series.light)
    ]
    yield "bayer burst", render_bayer_burst(mosaics, sigma, series.neutral)


def main() -> None:
    """Print a table for each noise."""
    given = options(__doc__, "*", sigma=[0.0, 0.01, 0.03], frames=8)
    sources = map(Path, given.scenes or photographs())
    scenes = [series for source in sources if (series := Series.of(source, given.frames))]
    if not scenes:
        missing = f"no scene of {2 * LEAST} pixels a side or more"
        raise SystemExit(f"{missing}; set PANCHROMA_TEST_DATA, or name some")
    for sigma in given.sigma:
        rows: dict[str, list[list[float]]] = defaultdict(list)
        for series in scenes:
            for row, picture in pictures(series, sigma):
                rows[row].append(psnrs(picture, series.light[0]))
        print(f"\nsigma {sigma:g}, {given.frames} frames, {len(scenes)} scenes, dB")
        print(f"{'':12}  median    10 %   whole")
        for row, figures in rows.items():
            means = np.mean(figures, axis=0)
            print(f"{row:12}{''.join(f'{mean:8.2f}' for mean in means)}", flush=True)


if __name__ == "__main__":
    main()
