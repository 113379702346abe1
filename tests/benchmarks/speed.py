"""How fast is it, here? Time the renderer, the preview, the files, and LibRaw on a Bayer mosaic of
the same size.

    python -m tests.benchmarks.speed [--megapixels N ...] [--rounds 9] [--frames 100] [-j THREADS]

Speeds are for arrays in memory, and from a DNG to a 16-bit TIFF on the disk without the start of
the program; `panchroma render -v` shows those of the stages. Everything runs in turns, once per
round, after a round that does not count; a ratio is the median of the rounds' ratios: load that
slows a whole round down cancels. --frames: previews of 12 megapixels; -j: threads, of LibRaw too.
With several sizes: how time and memory grow, from a DNG to a TIFF, each size in a process of its
own.
"""

import multiprocessing
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from panchroma.shared import FloatArray, Mosaic, SensorCalibration, read_dng, write_dng
from panchroma.shared.dng import encode_dng
from panchroma.shared.processors import processors
from panchroma.tools.batch.parallel import THREAD_VARIABLES
from panchroma.tools.evaluation.rivals.libraw import develop, encode_bayer_dng, encode_codes
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive
from tests.bayer import bayer_mosaic
from tests.benchmarks.harness import PATTERN, Work, alternate, memory, options

_PRESETS = "paper", "best"
_SIGMA, _BITS = 0.01, 12
# whole periods and whole Bayer quads fit, so that the pattern continues where copies meet
_STEP = 12
# rows, columns drawn, and repeated, because drawing takes longer than rendering
_DRAWN = 792, 1200
_PREVIEW_MEGAPIXELS, _SCALES = 12.0, (1, 3)


@cache
def scene() -> FloatArray:
    return builtin_scene(*reversed(_DRAWN)).rgb


def repeated(codes: NDArray[np.uint16], megapixels: float) -> NDArray[np.uint16]:
    """Copies side by side, of about so many megapixels, 3 : 2."""
    columns = max(24, round((megapixels * 1.5e6) ** 0.5 / _STEP) * _STEP)
    rows = max(24, round(columns / 1.5 / _STEP) * _STEP)
    height, width = codes.shape
    return np.tile(codes, (-(-rows // height), -(-columns // width)))[:rows, :columns]


def sparse(megapixels: float) -> Mosaic:
    """The sparse-colour shot of the scene as the sensor gives it, in codes."""
    camera, random = SensorCalibration.of_bits(_BITS), np.random.default_rng(0)
    taken = simulate_additive(scene(), PATTERN, camera, _SIGMA, random)
    return Mosaic(repeated(taken.codes, megapixels), PATTERN, taken.calibration)


def bayer(megapixels: float) -> NDArray[np.uint16]:
    """16-bit codes of a Bayer sensor from the same scene with the same noise."""
    codes = encode_codes(bayer_mosaic(scene(), _SIGMA, np.random.default_rng(0)))[0]
    return repeated(codes, megapixels)


def speeds(megapixels: float, rounds: int, folder: Path) -> None:
    """Time everything in turns on one frame: presets, files, and LibRaw, for which bringing the
    frame into the form that it takes is not timed.
    """
    from panchroma.offline import PRESETS, render

    shot, saved, picture = sparse(megapixels), folder / "shot.dng", np.zeros((8, 8, 3), np.uint8)
    write_dng(saved, shot, picture)
    data, mosaic = encode_dng(shot, picture), shot.in_scene_units()
    dng = encode_bayer_dng(bayer(megapixels))
    works: dict[str, Work] = {}
    for name in _PRESETS:
        works[name] = partial(render, mosaic, PRESETS[name])
        works[f"{name}, DNG to 16-bit TIFF"] = partial(render_file, saved, name)
    works["DNG, writing"] = partial(encode_dng, shot, picture)
    works["DNG, reading"] = lambda: read_dng(BytesIO(data))
    others = {f"LibRaw, {name}": partial(develop, dng, name) for name in ("PPG", "DCB")}
    seconds = alternate(works | others, rounds)
    pixels = shot.samples.size
    print(f"\n{pixels / 1e6:.1f} megapixels, {rounds} rounds")
    print(f"{'MP/s':<34}    least   median     most")
    for name, times in seconds.items():
        cells = [f"{pixels / 1e6 / time:8.2f}" for time in (max(times), median(times), min(times))]
        for preset in _PRESETS if name in others else ():
            ratio = median(map(float.__truediv__, times, seconds[preset]))
            cells.append(f"{preset} is {ratio:.2f} x")
        print(f"{name:<34}", *cells)


def render_file(shot: Path, preset: str) -> None:
    """Render a DNG to a TIFF of 16 bits beside it."""
    from panchroma.offline import PRESETS, render_bands, threads
    from panchroma.tools.io.development import Development
    from panchroma.tools.io.kind import PictureKind, write_picture

    mosaic, kind = read_dng(shot), PictureKind.of("tif")
    development = Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata)
    bands = render_bands(mosaic, PRESETS[preset])
    write_picture(shot.with_suffix(".tif"), bands, development, overwrite=True, threads=threads())


def growth(shot: Path, preset: str, rounds: int, threads: int) -> str:
    """In a new process: time and memory from a DNG to a TIFF, medians of several runs."""
    from panchroma.offline import use_threads

    use_threads(threads)
    pixels = read_dng(shot).samples.size
    seconds = alternate({preset: partial(render_file, shot, preset)}, rounds)[preset]
    speed, peak = median(seconds) / pixels * 1e6, memory("VmHWM") / 2**20
    return f"{preset}, {pixels / 1e6:.1f} MP: {speed:.3f} s/MP, peak memory {peak:.0f} MB"


def preview(shot: Path, scale: int, frames: int, threads: int) -> str:
    """In a new process: from the first to the last of many frames."""
    from panchroma.device import Preview

    script = "import time; start = time.perf_counter(); from panchroma.device import Preview; "
    command = [sys.executable, "-c", script + "print(time.perf_counter() - start)"]
    imported = float(subprocess.run(command, capture_output=True, check=True).stdout)
    mosaic = read_dng(shot)
    before, start = memory("VmRSS"), time.perf_counter()
    maker = Preview.for_mosaic(mosaic, scale, threads=threads)
    maker.run(mosaic)
    first = time.perf_counter() - start
    seconds = alternate({"preview": partial(maker.run, mosaic)}, frames)["preview"]
    middle, slowest = np.quantile(seconds, (0.5, 0.99))
    grown = (memory("VmHWM") - before) / 2**20
    return (
        f"preview 1 : {scale}, {mosaic.samples.size / 1e6:.1f} MP: median {1e3 * middle:.0f} ms, "
        f"99 % {1e3 * slowest:.0f} ms, import {1e3 * imported:.0f} ms, first {1e3 * first:.0f} ms, "
        f"memory +{grown:.0f} MB"
    )


def isolated(function: Callable[..., str], *arguments: object) -> None:
    """Print what the function returns in a process of its own."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        print(pool.submit(function, *arguments).result(), flush=True)


def main() -> None:
    """Measure and print."""
    arguments = options(__doc__, megapixels=[3.2], rounds=9, frames=100, threads=processors())
    sizes, used = arguments.megapixels, arguments.threads
    # libraries read them when they are loaded
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(used)))
    host = f"{platform.platform()}, {processors()} cores, {used} threads"
    print(f"{host}, load {os.getloadavg()[0]:.1f}; `panchroma doctor` shows the versions")
    with TemporaryDirectory(prefix="panchroma-speed-") as folder:
        shot, picture = Path(folder) / "shot.dng", np.zeros((8, 8, 3), np.uint8)
        if len(sizes) == 1:
            speeds(sizes[0], arguments.rounds, Path(folder))
            large = sparse(min(_PREVIEW_MEGAPIXELS, 4 * sizes[0]))
            write_dng(shot, large, picture, overwrite=True)
            for scale in _SCALES:
                isolated(preview, shot, scale, arguments.frames, used)
            return
        for preset in _PRESETS:
            for megapixels in sizes:
                write_dng(shot, sparse(megapixels), picture, overwrite=True)
                isolated(growth, shot, preset, arguments.rounds, used)


if __name__ == "__main__":
    main()
