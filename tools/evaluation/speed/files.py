"""Time and memory from a shot on the disk to a picture on the disk, by size, each in an isolated process."""

import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from offline import render_bands, use_threads
from shared import Mosaic, read_dng
from shared.arrays import FloatArray
from tools.host.isolated import peak_memory, run_isolated
from tools.pictures.band_writer import write_picture_bands
from tools.pictures.writer import PictureKind

from ..presets import PRESETS

if TYPE_CHECKING:
    from .material import Material

_TOGETHER = 25.0  # megapixels rendered for each size at least, so that small ones are not left to chance
_MOST_RUNS = 7
_WARM = (60, 90)  # rows, columns of the piece that is rendered first


@dataclass(frozen=True)
class FileTiming:
    """Time and memory from one DNG to one TIFF of 16 bits.

    pixels: of the shot.
    rendering: seconds, without reading and writing; median of several runs.
    whole: seconds; median of several runs.
    peak: bytes of the process with its libraries.
    """

    pixels: int
    rendering: float
    whole: float
    peak: int


def measure_files(material: "Material", preset: str, threads: int) -> FileTiming:
    """Save the shot and render it in a new process. Raises OutputError when there is no room for the files."""
    with material.saved_shot() as shot:
        return run_isolated(_measure, shot, preset, threads)


def _measure(shot: Path, preset: str, threads: int) -> FileTiming:
    """In the new process: measure until enough megapixels have been rendered."""
    use_threads(threads)
    kind = PictureKind.of("tif")

    def run(mosaic: Mosaic) -> float:
        seconds: list[float] = []
        bands = _timed(render_bands(mosaic, PRESETS[preset]), seconds)
        calibration, metadata, picture = mosaic.calibration, mosaic.metadata, shot.with_suffix(".tif")
        write_picture_bands(picture, bands, mosaic.shape, kind, calibration=calibration, metadata=metadata, overwrite=True)
        return sum(seconds)

    mosaic = read_dng(shot)
    pixels = mosaic.samples.size
    # A small piece first: kernels are loaded when they are first called.
    run(Mosaic(mosaic.samples[: _WARM[0], : _WARM[1]], mosaic.pattern, mosaic.calibration, mosaic.metadata))
    del mosaic  # so that the peak of memory holds one shot, not two
    whole: list[float] = []
    rendering: list[float] = []
    while not whole or (len(whole) < _MOST_RUNS and pixels * len(whole) < _TOGETHER * 1e6):
        start = time.perf_counter()
        mosaic = read_dng(shot)
        rendering.append(run(mosaic))
        whole.append(time.perf_counter() - start)
    return FileTiming(pixels, statistics.median(rendering), statistics.median(whole), peak_memory())


def _timed(bands: Iterator[FloatArray], seconds: list[float]) -> Iterator[FloatArray]:
    """Pass bands on, and append to `seconds` how long each took to make."""
    start = time.perf_counter()
    for band in bands:
        seconds.append(time.perf_counter() - start)
        yield band
        start = time.perf_counter()
    seconds.append(time.perf_counter() - start)
