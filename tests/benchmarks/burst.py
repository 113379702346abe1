"""Measure bursts: python -m tests.benchmarks.burst [SCENE...] [--sigma 0 0.01 0.03] [--frames 8]

Scenes reduced 2 x 2 are photographed by hand: frames up to 3 pixels and 0.3 degrees away from the
first, which is the reference and the truth. For each noise: PSNR (dB) of RGB, luminance and
chrominance, each as median and 10 % quantile of all 10 x 10 patches and of the whole picture, mean
over the scenes. The rows:

best             `best` of the reference alone burst            all frames, aligned and merged pixel
shift      nine frames 2 pixels apart, whose motion is known bayer            the best Bayer rival
of one frame: DLMMSE, with noise BM3D before it bayer burst      the same frames through a Bayer
sensor, merged by the same alignment (tests/benchmarks/bayer_burst.py)

Also how far the motion that was found is from the true one (median of all pixels of all frames),
which frames were left out, and the time of a burst, compared with that of one render on the same
machine. Without scenes: those test photographs (PANCHROMA_TEST_DATA) that have at least 300 pixels
a side when reduced. The rivals need the package `bm3d`, and minutes.
"""

import time
import zlib
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np

from panchroma.offline import BEST, render
from panchroma.offline.burst import MergedBurst, Motion, merge_burst, render_burst_bands
from panchroma.shared import DoubleArray, FloatArray, Mosaic, SensorCalibration
from panchroma.tools.evaluation.cameras import CameraPair
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.evaluation.metrics import BORDER, quality, whole_psnr
from panchroma.tools.io.versions import package_version
from panchroma.tools.simulation.load import load_scene
from panchroma.tools.simulation.protocols import PaperProtocol
from panchroma.tools.simulation.sensor import simulate_additive
from panchroma.tools.simulation.simulated_camera import SimulatedBurst, burst_frames
from tests.bayer import bayer_mosaic
from tests.benchmarks.alignment import DEGREES, PIXELS, alignment_error
from tests.benchmarks.bayer_burst import render_bayer_burst
from tests.benchmarks.harness import PATTERN, options, photographs

REDUCED, LEAST = 2, 300
# of pixel shift, down and right, pixels, the reference first
STEPS = list(product((0, -2, 2), repeat=2))
MEASURES = "median", "10 %", "whole"
PLANES = "RGB", "luminance", "chrominance"
DIFFERENCES = ("burst", "best"), ("burst", "bayer burst")


@dataclass(frozen=True)
class Series:
    """A scene and how it was photographed.

    light: float32 (H, W, 3) of each frame, scene units; the first is the reference.
    motions: the true ones.
    shifted: frames of an exact pixel shift by STEPS, with the same reference.
    neutral: what white reads.
    """

    name: str
    light: list[FloatArray]
    motions: list[Motion]
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
            [Motion(*frame.motion) for frame in frames],
            [
                sensor[top - down : top - down + rows, left - across : left - across + columns]
                for down, across in STEPS
            ],
            scene.neutral,
        )


@dataclass
class Found:
    """What was measured at one noise; a list has one entry per scene.

    figures: of each row, (plane, measure).
    """

    figures: dict[str, list[DoubleArray]] = field(default_factory=lambda: defaultdict(list))
    ratios: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def add(self, row: str, picture: FloatArray, truth: FloatArray) -> None:
        self.figures[row].append(measured(picture, truth))


def measured(picture: FloatArray, truth: FloatArray) -> DoubleArray:
    """The MEASURES (axis 1) of the PLANES (axis 0) of a picture, dB."""
    patches, psnrs = quality(picture, truth), whole_psnr(picture, truth, BORDER)
    return np.array(
        [(plane[2], plane[0], psnr) for plane, psnr in zip(patches, psnrs, strict=True)]
    )


def shots(light: list[FloatArray], sigma: float) -> list[Mosaic]:
    """The frames through the sparse-colour sensor."""
    camera = SensorCalibration()
    return [
        simulate_additive(frame, PATTERN, camera, sigma, np.random.default_rng([0, n]))
        for n, frame in enumerate(light)
    ]


def merged_picture(
    frames: list[Mosaic], motions: list[Motion] | None = None
) -> tuple[FloatArray, MergedBurst]:
    """The picture of a burst, and how it was merged."""
    merged = merge_burst(frames, BEST, reference=0, motions=motions)
    return np.concatenate(list(render_burst_bands(merged, BEST))), merged


def measure(series: Series, sigma: float, found: Found) -> None:
    """Add the figures of our rows."""
    truth, frames = series.light[0], shots(series.light, sigma)
    started = time.perf_counter()
    found.add("best", render(frames[0], BEST).rgb, truth)
    rendered = time.perf_counter()
    picture, merged = merged_picture(frames)
    found.ratios.append((time.perf_counter() - rendered) / (rendered - started))
    found.add("burst", picture, truth)
    steps = [Motion((float(down), float(across))) for down, across in STEPS]
    found.add("pixel shift", merged_picture(shots(series.shifted, sigma), steps)[0], truth)
    found.left_out += [
        f"{series.name}, frame {n + 1}: {frame.reason}"
        for n, frame in enumerate(merged.frames)
        if not frame.used
    ]
    motions = [frame.motion for frame in merged.frames[1:]]
    found.errors.append(alignment_error(motions, series.motions[1:], frames[0].shape))


def measure_rivals(series: Series, sigma: float, found: Found) -> None:
    """Add the figures of the rivals."""
    truth, name = series.light[0], "bm3d+dlmmse-wb" if sigma else "dlmmse-wb"
    cameras = CameraPair(PaperProtocol(sigma), 0, truth, PATTERN, series.neutral)
    found.add("bayer", methods()[name].render(cameras), truth)
    mosaics = [
        bayer_mosaic(light, sigma, np.random.default_rng([0, n]))
        for n, light in enumerate(series.light)
    ]
    found.add("bayer burst", render_bayer_burst(mosaics, sigma, series.neutral), truth)


def report(found: Found, sigma: float, names: list[str], count: int) -> None:
    """Print the table of one noise."""
    print(f"\nsigma {sigma:g}, {count} frames, {len(names)} scenes, dB")
    print(" " * 40 + "".join(f"{plane:>27}" for plane in PLANES))
    print(" " * 40 + "".join(f"   {''.join(f'{name:>8}' for name in MEASURES)}" for _ in PLANES))
    for row, figures in found.figures.items():
        line(row, np.mean(figures, axis=0))
    for ours, theirs in DIFFERENCES:
        if theirs in found.figures:
            margins = np.subtract(found.figures[ours], found.figures[theirs])
            for name, margin in zip(names, margins, strict=True):
                line(f"  {name}: {ours} - {theirs}", margin, "+")
    errors = np.array(found.errors)
    print(f"alignment error: median {np.median(errors):.3f} pixels, worst scene {errors.max():.3f}")
    print(f"time: {np.median(found.ratios):.1f} x one render")
    for frame in found.left_out:
        print(f"left out: {frame}")


def line(title: str, values: DoubleArray, sign: str = "") -> None:
    """Print the PLANES and MEASURES of a row."""
    cells = ("".join(f"{value:{sign}8.2f}" for value in plane) for plane in values)
    print(f"{title:40}   {'   '.join(cells)}", flush=True)


def main() -> None:
    """Print a table for each noise."""
    given = options(__doc__, "*", sigma=[0.0, 0.01, 0.03], frames=8)
    sources = map(Path, given.scenes or photographs())
    scenes = [series for source in sources if (series := Series.of(source, given.frames))]
    if not scenes:
        remedy = "set PANCHROMA_TEST_DATA, or name some"
        raise SystemExit(f"no scene of {2 * LEAST} pixels a side or more; {remedy}")
    merged_picture(shots(scenes[0].light[:2], 0.01))  # what is compiled now is not timed
    for sigma in given.sigma:
        found = Found()
        for series in scenes:
            measure(series, sigma, found)
            if package_version("bm3d"):
                measure_rivals(series, sigma, found)
        report(found, sigma, [series.name for series in scenes], given.frames)


if __name__ == "__main__":
    main()
