"""How fast is it, here? Time the renderer and its stages, the preview, the files, and LibRaw on a
Bayer mosaic of the same size.

    python -m tests.benchmarks.speed [--megapixels N ...] [--rounds 9] [--frames 100] [-j THREADS]

Speeds are for arrays in memory, and from a DNG to a 16-bit TIFF on the disk without the start of
the program. Everything runs in turns, once per round, after a round that does not count; a ratio is
the median of the rounds' ratios: load that slows a whole round down cancels. --frames: previews of
12 megapixels; -j: threads, of LibRaw too. With several sizes: how time and memory grow, from a DNG
to a TIFF, each size in a process of its own.
"""

import math
import multiprocessing
import os
import platform
import subprocess
import sys
import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

from panchroma.shared import read_dng, write_dng
from panchroma.shared.dng import encode_dng
from panchroma.shared.processors import processors
from panchroma.shared.progress import Progress
from panchroma.tools.batch.parallel import THREAD_VARIABLES
from panchroma.tools.io.versions import package_version, program_version
from tests.benchmarks.harness import Frame, Work, alternate, options

_PRESETS = "paper", "best"

_PREVIEW_MEGAPIXELS, _SCALES = 12.0, (1, 3)
# megapixels rendered for each size at least, so that small ones are not left to chance
_TOGETHER, _MOST_RUNS = 25.0, 7
_PACKAGES = ("numpy", "numba", "imagecodecs", "onnxruntime", "rawpy")


class StageClock(Progress):
    """A progress listener that measures how long each stage of a rendering takes, or each substep
    of a stage that has them.
    """

    def __init__(self) -> None:
        self.seconds = defaultdict[str, list[float]](list)
        self._marks: list[tuple[str, float]] = []  # what begins when
        self._bare = False  # what began last is a stage without substeps so far

    def stage(self, name: str, steps: int) -> None:
        """A stage begins; the stage before it has ended."""
        self._marks.append((name, time.perf_counter()))
        self._bare = True

    def substep(self, name: str) -> None:
        """A substep begins; its times in all steps are added up. The first one includes the
        beginning of its stage.
        """
        self._marks.append((name, self._marks.pop()[1] if self._bare else time.perf_counter()))
        self._bare = False

    def run(self, work: Work) -> None:
        """Call `work`, a rendering that reports to this listener."""
        self._marks = []
        work()
        run = defaultdict[str, float](float)
        for (name, start), (_, end) in pairwise([*self._marks, ("", time.perf_counter())]):
            run[name] += end - start
        for name, seconds in run.items():
            self.seconds[name].append(seconds)


def rivals(frame: Frame) -> dict[str, Work]:
    """LibRaw's; bringing the frame into the form that they take is not timed."""
    from panchroma.tools.evaluation.rivals.libraw import develop, encode_bayer_dng

    dng = encode_bayer_dng(frame.bayer_codes)
    return {f"LibRaw, {name}": partial(develop, dng, name) for name in ("PPG", "DCB")}


def speeds(frame: Frame, rounds: int, folder: Path) -> None:
    """Time everything in turns on one frame: presets and their stages, files, and rivals."""
    from panchroma.offline import PRESETS, render, render_bands

    def by_bands(settings: object) -> None:
        deque(render_bands(frame.mosaic, settings), maxlen=0)  # type: ignore[arg-type]

    saved, picture = folder / "shot.dng", np.zeros((8, 8, 3), np.uint8)
    write_dng(saved, frame.shot, picture)
    data = encode_dng(frame.shot, picture)
    clocks, works = {name: StageClock() for name in _PRESETS}, dict[str, Work]()
    for name in _PRESETS:
        settings, clock = PRESETS[name], clocks[name]
        works[name] = partial(clock.run, partial(render, frame.mosaic, settings, clock))
        works[f"{name}, band by band"] = partial(by_bands, settings)
        works[f"{name}, DNG to 16-bit TIFF"] = partial(render_file, saved, name)
    works |= {
        "DNG, writing": partial(encode_dng, frame.shot, picture),
        "DNG, reading": partial(read_dng, BytesIO(data)),
    }
    others = rivals(frame)
    seconds = alternate(works | others, rounds)
    pixels = frame.mosaic.samples.size

    def line(name: str, times: Sequence[float]) -> None:
        cells = [f"{pixels / 1e6 / time:8.2f}" for time in (max(times), median(times), min(times))]
        for preset in _PRESETS if name in others else ():
            ratio = median(map(float.__truediv__, times, seconds[preset]))
            cells.append(f"{preset} is {ratio:.2f} x")
        print(f"{name:<34}", *cells)

    print(f"\n{pixels / 1e6:.1f} megapixels, {rounds} rounds")
    print(f"{'MP/s':<34}    least   median     most")
    for name, times in seconds.items():
        line(name, times)
        for stage, substeps in clocks[name].seconds.items() if name in clocks else ():
            line(f"  {stage}", substeps[-rounds:])


def render_file(shot: Path, preset: str) -> None:
    """Render a DNG to a TIFF of 16 bits beside it."""
    from panchroma.offline import PRESETS, render_bands, threads
    from panchroma.tools.io.development import Development
    from panchroma.tools.io.kind import PictureKind, write_picture

    mosaic, kind = read_dng(shot), PictureKind.of("tif")
    development = Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata)
    bands = render_bands(mosaic, PRESETS[preset])
    write_picture(shot.with_suffix(".tif"), bands, development, overwrite=True, threads=threads())


def growth(shot: Path, preset: str, threads: int) -> str:
    """In a new process: time and memory from a DNG to a TIFF, medians of several runs."""
    from panchroma.offline import PRESETS, render_bands, use_threads

    use_threads(threads)
    pixels = read_dng(shot).samples.size
    works = {
        "render": lambda: deque(render_bands(read_dng(shot), PRESETS[preset]), maxlen=0),
        "file to file": lambda: render_file(shot, preset),
    }
    seconds = alternate(works, min(_MOST_RUNS, math.ceil(_TOGETHER * 1e6 / pixels)))
    speeds = [f"{name} {median(seconds[name]) / pixels * 1e6:.3f} s/MP" for name in works]
    peak = f"peak memory {_memory('VmHWM') / 2**20:.0f} MB"
    return f"{preset}, {pixels / 1e6:.1f} MP: {', '.join([*speeds, peak])}"


def preview(shot: Path, scale: int, frames: int, threads: int) -> str:
    """In a new process: from the first to the last of many frames."""
    from panchroma.device import Preview

    script = "import time; start = time.perf_counter(); from panchroma.device import Preview; "
    command = [sys.executable, "-c", script + "print(time.perf_counter() - start)"]
    imported = float(subprocess.run(command, capture_output=True, check=True).stdout)
    mosaic = read_dng(shot)
    before, start = _memory("VmRSS"), time.perf_counter()
    maker = Preview.for_mosaic(mosaic, scale, threads=threads)
    maker.run(mosaic)
    first, held = time.perf_counter() - start, _memory("VmRSS")
    seconds = alternate({"preview": partial(maker.run, mosaic)}, frames)["preview"]
    middle, slowest = np.quantile(seconds, (0.5, 0.99))
    grown, leaked = (_memory("VmHWM") - before) / 2**20, (_memory("VmRSS") - held) / 2**20
    return (
        f"preview 1 : {scale}, {mosaic.samples.size / 1e6:.1f} MP: median {1e3 * middle:.0f} ms, "
        f"99 % {1e3 * slowest:.0f} ms, import {1e3 * imported:.0f} ms, first {1e3 * first:.0f} ms, "
        f"memory +{grown:.0f} MB, {leaked:+.1f} MB after all"
    )


def _memory(figure: str) -> int:
    """Bytes of this process: VmHWM, its peak, or VmRSS. Not from getrusage: a new process inherits
    its parent's peak there.
    """
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{figure}:"))


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
    versions = ", ".join(f"{name} {package_version(name)}" for name in _PACKAGES)
    load = f"load {os.getloadavg()[0]:.1f}"
    print(f"{platform.platform()}, {processors()} cores, {used} threads, {load}")
    print(f"Panchroma {program_version()}, Python {platform.python_version()}, {versions}")
    with TemporaryDirectory(prefix="panchroma-speed-") as folder:
        shot, picture = Path(folder) / "shot.dng", np.zeros((8, 8, 3), np.uint8)
        if len(sizes) == 1:
            speeds(Frame.of(sizes[0]), arguments.rounds, Path(folder))
            large = Frame.of(min(_PREVIEW_MEGAPIXELS, 4 * sizes[0])).shot
            write_dng(shot, large, picture, overwrite=True)
            for scale in _SCALES:
                isolated(preview, shot, scale, arguments.frames, used)
            return
        for preset in ("paper", "best"):
            for megapixels in sizes:
                write_dng(shot, Frame.of(megapixels).shot, picture, overwrite=True)
                isolated(growth, shot, preset, used)


if __name__ == "__main__":
    main()
