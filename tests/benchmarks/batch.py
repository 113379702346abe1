"""Measure the overhead and the scaling of `render` on many shots: python -m tests.benchmarks.batch
[FIGURE]...

small    1,000 small shots in one command with one process, and again with --resume. workers
throughput of 1 and 2 processes of one thread each, shots of 1 MP. plan     processor time, bytes in
and bytes out of one shot of 24 MP, extrapolated to a million shots.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from panchroma.shared import Mosaic, SensorCalibration, write_dng
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive
from tests.benchmarks.harness import PATTERN
from tests.tools.command import start

SMALL, COUNT = (300, 200), 1000
MEGAPIXEL = (1200, 800)
MILLION, LARGE = 1_000_000, 24.0  # shots, megapixels of each


def save_shots(folder: Path, count: int, size: tuple[int, int]) -> None:
    """Save shots of the built-in scene that differ in their noise, unless they are there."""
    if folder.exists():
        return
    folder.mkdir()
    scene, calibration = builtin_scene(*size), SensorCalibration.of_bits(12)
    for seed in range(count):
        random = np.random.default_rng(seed)
        taken = simulate_additive(scene.rgb, PATTERN, calibration, 0.01, random)
        shot = Mosaic(taken.codes, PATTERN, taken.calibration)
        write_dng(folder / f"{seed:04}.dng", shot, np.zeros((8, 8, 3), np.uint8))


def seconds(*arguments: str | Path) -> tuple[float, float]:
    """(wall-clock seconds, processor seconds) of one command, whose processes have one thread."""
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PANCHROMA_THREADS": "1"}
    words = ("render", *arguments, "--json")
    process = start(*words, stderr=subprocess.DEVNULL, env=environment)
    output, _ = process.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode or not all(json.loads(line)["ok"] for line in output.splitlines()):
        sys.exit(f"failed: {' '.join(map(str, arguments))}")
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begun, used


def fresh(top: Path, name: str) -> Path:
    (top / name).mkdir()
    return top / name


def small(top: Path) -> None:
    """Measure one process."""
    save_shots(top / "small", COUNT, SMALL)
    options = (top / "small", "-o", fresh(top, "whole"), "-j", "1")
    (wall, used), (again, _) = seconds(*options), seconds(*options, "--resume")
    print(
        f"{COUNT} shots of {SMALL[0]} x {SMALL[1]}: {wall:.1f} s ({used:.1f} s of a processor); "
        f"all up to date: {again:.1f} s"
    )


def workers(top: Path, count: int = 24) -> None:
    """Measure processes of this machine."""
    save_shots(top / "large", count, MEGAPIXEL)
    megapixels = count * MEGAPIXEL[0] * MEGAPIXEL[1] / 1e6
    taken = {
        number: seconds(top / "large", "-o", fresh(top, f"p{number}"), "-j", str(number))
        for number in (1, 2)
    }
    rates = ", ".join(
        f"{number}: {wall:.1f} s ({used:.1f} s of processors), {megapixels / wall:.2f} MP/s"
        for number, (wall, used) in taken.items()
    )
    print(
        f"{count} shots of {MEGAPIXEL[0]} x {MEGAPIXEL[1]}, processes of one thread: {rates}; "
        f"{taken[1][0] / taken[2][0]:.2f} x"
    )


def plan(top: Path) -> None:
    """Extrapolate from one shot of 24 MP to a million."""
    save_shots(top / "full", 1, (6000, 4000))
    out = fresh(top, "planned")
    _, used = seconds(top / "full", "-o", out, "-j", "1")
    paths = top / "full" / "0000.dng", out / "0000.tif"
    size_in, size_out = (path.stat().st_size for path in paths)
    hours, cores = MILLION * used / 3600, 64
    rate = MILLION * (size_in + size_out) / (hours / 10 / cores * 3600) / 1e9
    print(
        f"a shot of {LARGE:g} MP, one thread: {used:.1f} s of a processor, {size_in / 1e6:.0f} "
        f"MB in, {size_out / 1e6:.0f} MB out\n"
        f"a million: {hours:,.0f} core hours, {MILLION * size_in / 1e12:.0f} TB in, "
        f"{MILLION * size_out / 1e12:.0f} TB out; 10 machines of {cores} cores: "
        f"{hours / 10 / cores:,.1f} hours at {rate:.1f} GB/s of storage in all"
    )


MEASURED = {"small": small, "workers": workers, "plan": plan}


def main() -> None:
    """Print the chosen figures, by default all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "figures", nargs="*", choices=MEASURED, metavar="FIGURE", help=f"of {', '.join(MEASURED)}"
    )
    for name in parser.parse_args().figures or MEASURED:
        with tempfile.TemporaryDirectory() as folder:
            MEASURED[name](Path(folder))


if __name__ == "__main__":
    main()
