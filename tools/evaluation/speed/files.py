"""A shot on the disk rendered to a picture on the disk, in a process of its own: how time and memory grow with its size."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from tools.host.isolated import peak_memory, run_isolated

if TYPE_CHECKING:
    from shared.arrays import FloatArray

    from .material import Material

_TOGETHER = 25.0  # megapixels that are rendered for each size at least, so that small ones are not left to chance
_MOST_RUNS = 7
_WARM = (60, 90)


@dataclass(frozen=True)
class FileTiming:
    """From one DNG to one TIFF of 16 bits: seconds, the median of several runs, and bytes.

    rendering: of `whole`, without reading and writing; peak: of the process, with its libraries.
    """

    pixels: int
    rendering: float
    whole: float
    peak: int


def measure_files(material: "Material", preset: str, threads: int) -> FileTiming:
    """Write the shot of this size, and render it in a new process. Raises OutputError when there is no room for the files."""
    import numpy as np

    from shared import write_dng
    from shared.errors import OutputError

    try:
        with TemporaryDirectory(prefix="panchroma-bench-") as folder:
            shot = Path(folder) / "shot.dng"
            write_dng(shot, material.shot, np.zeros((8, 8, 3), np.uint8))
            return run_isolated(_measure, str(shot), preset, threads)
    except OSError as error:
        raise OutputError(f"no room for temporary files ({error.strerror or error}); set TMPDIR to another folder") from error


def _measure(shot: str, preset: str, threads: int) -> FileTiming:
    """In the new process."""
    import statistics

    from offline import use_threads
    from shared import Mosaic, read_dng
    from tools.pictures.band_writer import write_picture_bands
    from tools.pictures.writer import PictureKind

    from .presets import presets

    use_threads(threads)
    settings = presets()[preset]
    kind = PictureKind.of("tif")

    def run(mosaic: Mosaic) -> float:
        from offline import render_bands

        clock = _Clock(render_bands(mosaic, settings))
        picture = Path(shot).with_suffix(".tif")
        calibration, metadata = mosaic.calibration, mosaic.metadata
        write_picture_bands(picture, clock, mosaic.shape, kind, calibration=calibration, metadata=metadata, overwrite=True)
        return clock.seconds

    whole: list[float] = []
    rendering: list[float] = []
    pixels = 0
    while not whole or (len(whole) < _MOST_RUNS and pixels * len(whole) < _TOGETHER * 1e6):
        start = time.perf_counter()
        mosaic = read_dng(shot)
        if not pixels:  # a small piece first: kernels are loaded when they are first called
            read = time.perf_counter() - start
            pixels = mosaic.shape[0] * mosaic.shape[1]
            small = mosaic.samples[: _WARM[0], : _WARM[1]]
            run(Mosaic(small, mosaic.pattern, mosaic.calibration, mosaic.metadata))
            start = time.perf_counter() - read
        rendering.append(run(mosaic))
        whole.append(time.perf_counter() - start)
    return FileTiming(pixels, statistics.median(rendering), statistics.median(whole), peak_memory())


class _Clock:
    """Hands bands on, and adds up how long they were in the making."""

    def __init__(self, bands: "Iterator[FloatArray]") -> None:
        self._bands = bands
        self.seconds = 0.0

    def __iter__(self) -> "Iterator[FloatArray]":
        while True:
            start = time.perf_counter()
            band = next(self._bands, None)
            self.seconds += time.perf_counter() - start
            if band is None:
                return
            yield band
