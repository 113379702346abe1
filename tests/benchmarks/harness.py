"""What benchmarks and campaigns share: options, scenes, rounds, memory.

It does not load the renderer, whose libraries read the number of threads when they are loaded.
"""

import argparse
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.ndimage import map_coordinates

from panchroma.shared import CfaPattern, DoubleArray, FloatArray
from panchroma.tools.evaluation.metrics import BORDER, MEDIAN, quality, whole_psnr
from tests.data import DATA

PATTERN = CfaPattern.bayer(6)
SEED = 3
Work = Callable[[], object]


def options(text: str | None, scenes: str = "", **usual: Any) -> argparse.Namespace:
    """Read the command line.

    text: of the help. scenes: how many come first, as `nargs`; "" = there are none. usual: of each
    option its default, of that type, a list for several; or what `add_argument` takes.
    """
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=text, formatter_class=form)
    if scenes:
        parser.add_argument("scenes", nargs=scenes, metavar="SCENE")
    for name, value in usual.items():
        kind: dict[str, Any] = {"default": value, "type": type(value)}
        if isinstance(value, list):
            kind = {"default": value, "type": type(value[0]), "nargs": "+"}
        short = ["-j"] if name in ("jobs", "threads") else []
        chosen = value if isinstance(value, dict) else kind
        parser.add_argument(*short, f"--{name.replace('_', '-')}", **chosen)
    return parser.parse_args()


def photographs() -> list[Path]:
    """The test photographs: camera RAWs and linear pictures."""
    return [path for folder in ("linear", "raw") for path in sorted((DATA / folder).iterdir())]


def middle(rgb: FloatArray, side: int) -> FloatArray:
    """The middle of a scene, `side` pixels high and wide at most."""
    top, left = (max(size - side, 0) // 2 for size in rgb.shape[:2])
    return np.ascontiguousarray(rgb[top : top + side, left : left + side])


def psnrs(picture: FloatArray, truth: FloatArray) -> list[float]:
    """Median and 10 % quantile of all 10 x 10 patches of RGB, and the whole picture, dB."""
    patches = quality(picture, truth)[0]
    return [patches[MEDIAN], patches[0], whole_psnr(picture, truth, BORDER)[0]]


def resampled(rgb: FloatArray, at: FloatArray | DoubleArray, order: Literal[3, 5]) -> FloatArray:
    """A picture (H, W, 3) at the places (2, H, W), by splines."""
    planes = [
        map_coordinates(plane, at, order=order, mode="mirror") for plane in np.moveaxis(rgb, -1, 0)
    ]
    return np.stack(planes, axis=-1).astype(np.float32)


def alternate(works: Mapping[str, Work], rounds: int) -> dict[str, list[float]]:
    """Seconds of each function in each round, after one that does not count.

    Every other round runs backwards, so that none always follows the same one.
    """
    seconds: dict[str, list[float]] = {name: [] for name in works}
    order = list(works.items())
    for number in range(rounds + 1):
        for name, work in order:
            start = time.perf_counter()
            result = work()
            end = time.perf_counter()
            del result  # freeing its memory is not timed
            if number:
                seconds[name].append(end - start)
        order.reverse()
    return seconds


def memory(figure: str) -> int:
    """Bytes of this process: VmHWM, its peak; VmRSS; or VmData, what it has asked for. Not from
    getrusage: a new process inherits its parent's peak there.
    """
    lines = Path("/proc/self/status").read_text("ascii").splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{figure}:"))
