"""Time and memory from a shot on the disk to a picture on the disk, by size, each in an isolated process."""

import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from offline import RenderSettings, render_bands, threads, use_threads
from shared import Mosaic, read_dng
from shared.arrays import FloatArray
from tests.benchmarks.speed.isolated import memory, run_isolated
from tools.evaluation.presets import PRESETS
from tools.pictures.band_writer import write_picture_bands
from tools.pictures.writer import PictureKind

if TYPE_CHECKING:
    from .material import Material

_TOGETHER = 25.0  # megapixels rendered for each size at least, so that small ones are not left to chance
_MOST_RUNS = 7
_WARM = (60, 90)  # rows, columns of the piece that is rendered first


@dataclass(frozen=True)
class FileTiming:
    """Time and memory from one DNG to one TIFF of 16 bits.

    pixels: of the shot.
    rendering: seconds in which bands were made, while those before were written; median of several runs.
    whole: seconds; median of several runs.
    peak: bytes of the process with its libraries.
    """

    pixels: int
    rendering: float
    whole: float
    peak: int


def measure_files(material: "Material", preset: str, count: int) -> FileTiming:
    """Save the shot and render it in a new process, by `count` threads. Raises OutputError when there is no room for the files."""
    with material.saved_shot() as shot:
        return run_isolated(_measure, shot, preset, count)


def _measure(shot: Path, preset: str, count: int) -> FileTiming:
    """In the new process: measure until enough megapixels have been rendered."""
    use_threads(count)
    settings = PRESETS[preset]
    mosaic = read_dng(shot)
    pixels = mosaic.samples.size
    # A small piece first: kernels are loaded when they are first called.
    _write(shot, Mosaic(mosaic.samples[: _WARM[0], : _WARM[1]], mosaic.pattern, mosaic.calibration, mosaic.metadata), settings)
    del mosaic  # so that the peak of memory holds one shot, not two
    whole: list[float] = []
    rendering: list[float] = []
    while not whole or (len(whole) < _MOST_RUNS and pixels * len(whole) < _TOGETHER * 1e6):
        start = time.perf_counter()
        rendering.append(render_file(shot, settings))
        whole.append(time.perf_counter() - start)
    return FileTiming(pixels, statistics.median(rendering), statistics.median(whole), memory("VmHWM"))


def render_file(shot: Path, settings: RenderSettings) -> float:
    """Render a DNG to a TIFF of 16 bits beside it, in this process; returns the seconds in which bands were made."""
    return _write(shot, read_dng(shot), settings)


def _write(shot: Path, mosaic: Mosaic, settings: RenderSettings) -> float:
    seconds: list[float] = []
    bands, kind = _timed(render_bands(mosaic, settings), seconds), PictureKind.of("tif")
    known: dict[str, Any] = {"calibration": mosaic.calibration, "metadata": mosaic.metadata}
    write_picture_bands(shot.with_suffix(".tif"), bands, mosaic.shape, kind, **known, overwrite=True, threads=threads())
    return sum(seconds)


def _timed(bands: Iterator[FloatArray], seconds: list[float]) -> Iterator[FloatArray]:
    """Pass bands on, and append to `seconds` how long each took to make."""
    start = time.perf_counter()
    for band in bands:
        seconds.append(time.perf_counter() - start)
        yield band
        start = time.perf_counter()
    seconds.append(time.perf_counter() - start)
