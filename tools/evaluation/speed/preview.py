"""The camera's preview in a process of its own: from a cold start to the hundredth frame."""

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from tools.host.isolated import memory_now, peak_memory, run_isolated

if TYPE_CHECKING:
    from .material import Material


@dataclass(frozen=True)
class PreviewTiming:
    """Pictures of one shot at one scale; seconds and bytes.

    imported: until the camera's software is there; first: from then to the first picture, the graph's loading included.
    middle, slowest: the median and the 99 % quantile of the frames after it. grown: by how much the process was larger at its peak
    than with the shot alone; leaked: how much more it holds after all frames than after the first.
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
    """Of the same shot at each scale."""
    import numpy as np

    from shared import write_dng

    with TemporaryDirectory(prefix="panchroma-bench-") as folder:
        shot = Path(folder) / "shot.dng"
        write_dng(shot, material.shot, np.zeros((8, 8, 3), np.uint8))
        return [run_isolated(_measure, str(shot), scale, frames, threads) for scale in scales]


def _measure(shot: str, scale: int, frames: int, threads: int) -> PreviewTiming:
    """In the new process, which has not even NumPy yet."""
    start = time.perf_counter()
    from device import Preview
    from shared import read_dng

    imported = time.perf_counter() - start
    import numpy as np

    mosaic = read_dng(shot)
    before = memory_now()
    start = time.perf_counter()
    preview = Preview.for_mosaic(mosaic, scale, threads=threads)
    preview.run(mosaic)
    first = time.perf_counter() - start
    held, seconds = memory_now(), []
    for _ in range(frames):
        start = time.perf_counter()
        preview.run(mosaic)
        seconds.append(time.perf_counter() - start)
    middle, slowest = np.quantile(seconds, (0.5, 0.99)).tolist()
    grown, leaked = peak_memory() - before, memory_now() - held
    return PreviewTiming(scale, mosaic.samples.size, imported, first, middle, slowest, grown, leaked)
