"""Time and memory of the camera's preview in an isolated process, from a cold start to the hundredth frame.

Nothing heavy is imported here, because the new process imports this module before its clock starts.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tests.benchmarks.speed.isolated import memory, run_isolated

if TYPE_CHECKING:
    from .material import Material


@dataclass(frozen=True)
class PreviewTiming:
    """Time and memory of the previews of one shot at one scale.

    scale: pixels of the sensor per pixel of the picture, each way.
    pixels: of the sensor.
    imported: seconds until the camera's software is loaded.
    first: seconds from then to the first picture, loading the graph included.
    middle, slowest: seconds per later picture, median and 99 % quantile.
    grown: bytes of the process at its peak above those with the shot alone.
    leaked: bytes after all pictures above those after the first.
    """

    scale: int
    pixels: int
    imported: float
    first: float
    middle: float
    slowest: float
    grown: int
    leaked: int


def measure_preview(material: "Material", scales: tuple[int, ...], frames: int, threads: int) -> list[PreviewTiming]:
    """Timings of the same shot at each scale. Raises OutputError when there is no room for its file."""
    with material.saved_shot() as shot:
        return [run_isolated(_measure, shot, scale, frames, threads) for scale in scales]


def _measure(shot: Path, scale: int, frames: int, threads: int) -> PreviewTiming:
    """In the new process, which has not loaded even NumPy yet."""
    start = time.perf_counter()
    from device import Preview
    from shared import read_dng

    imported = time.perf_counter() - start
    import numpy as np

    mosaic = read_dng(shot)
    before = memory("VmRSS")
    start = time.perf_counter()
    preview = Preview.for_mosaic(mosaic, scale, threads=threads)
    preview.run(mosaic)
    first = time.perf_counter() - start
    held, seconds = memory("VmRSS"), []
    for _ in range(frames):
        start = time.perf_counter()
        preview.run(mosaic)
        seconds.append(time.perf_counter() - start)
    middle, slowest = np.quantile(seconds, (0.5, 0.99)).tolist()
    grown, leaked = memory("VmHWM") - before, memory("VmRSS") - held
    return PreviewTiming(scale, mosaic.samples.size, imported, first, middle, slowest, grown, leaked)
