"""What the benchmarks share: options, scenes, shots, the frame on which speed is measured, rounds, and the tables of lens faults.

It does not load the renderer, whose libraries read the number of threads when they are loaded.
"""

import argparse
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from tests.bayer import bayer_mosaic
from tests.data import DATA
from tools.evaluation.rivals.integers import Levels
from tools.simulation.drawn.builtin import builtin_scene
from tools.simulation.load import load_scene
from tools.simulation.sensor import simulate_additive

if TYPE_CHECKING:
    from offline import RenderSettings

PATTERN = CfaPattern.bayer(6)
SEED = 3
Sample = TypeVar("Sample", bound=np.generic)
_SIGMA, _BITS = 0.01, 12
_STEP = 12  # whole periods and whole Bayer quads fit, so that the pattern continues where pieces meet
_PIECE = 792, 1200  # rows, columns drawn; larger frames repeat them, because drawing takes longer than rendering
Corners = tuple[float, float]
"""The two figures of a lens, as `lens_shading` takes them."""
Pictures = Callable[[Mapping[str, FloatArray], float, Corners, "RenderSettings"], Iterator[tuple[str, str, FloatArray]]]
"""Of scenes (H, W, 3) by their source, a sigma, a lens and settings: source, name of what is compared, and its picture."""
Work = Callable[[], object]


def options(text: str | None, number: str = "", **usual: Any) -> argparse.Namespace:
    """Read the command line.

    text: of the help.
    number: of scenes, which come first, as `nargs`; "" = the benchmark takes none.
    usual: of each option its default, of that type, a list for several; or what `add_argument` takes.
    """
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    if number:
        parser.add_argument("scenes", nargs=number, metavar="SCENE")
    for name, value in usual.items():
        several = isinstance(value, list)
        kind = {"default": value, "type": type(value[0] if several else value)} | ({"nargs": "+"} if several else {})
        short = {"output": ["-o"], "threads": ["-j"]}.get(name, [])
        parser.add_argument(*short, f"--{name.replace('_', '-')}", **(value if isinstance(value, dict) else kind))
    return parser.parse_args()


def photographs() -> list[Path]:
    """The test photographs: camera RAWs and linear pictures."""
    return [path for folder in ("linear", "raw") for path in sorted((DATA / folder).iterdir())]


def middle(rgb: FloatArray, side: int) -> FloatArray:
    """The middle of a scene, `side` pixels high and wide at most."""
    top, left = (max(size - side, 0) // 2 for size in rgb.shape[:2])
    return np.ascontiguousarray(rgb[top : top + side, left : left + side])


def photographed(rgb: FloatArray, sigma: float, seed: int = SEED, **lens: Any) -> Mosaic:
    """A shot of a scene as it is in a file. lens: `shading` of the sensor's calibration."""
    taken = simulate_additive(rgb, PATTERN, SensorCalibration.of_bits(16, **lens), sigma, np.random.default_rng(seed))
    return Mosaic(taken.codes, PATTERN, taken.calibration)


@dataclass(frozen=True)
class Frame:
    """The built-in scene as both cameras see it, in every form that is measured. shape: (rows, columns), multiples of 12."""

    shape: tuple[int, int]

    @classmethod
    def of(cls, megapixels: float) -> "Frame":
        """A frame of about so many, 3 : 2."""
        columns = max(24, round((megapixels * 1.5e6) ** 0.5 / _STEP) * _STEP)
        return cls((max(24, round(megapixels * 1e6 / columns / _STEP) * _STEP), columns))

    @cached_property
    def shot(self) -> Mosaic:
        """The sparse-colour shot as the sensor gives it, in codes."""
        return Mosaic(self._repeated(self._taken.codes), self._taken.pattern, self._taken.calibration)

    @cached_property
    def mosaic(self) -> Mosaic:
        """The sparse-colour shot in scene units."""
        return Mosaic(self._repeated(self._taken.signal), self._taken.pattern, self._taken.calibration)

    @cached_property
    def bayer(self) -> FloatArray:
        """Samples of a Bayer sensor from the same scene with the same noise, scene units."""
        return self._repeated(bayer_mosaic(self._rgb, _SIGMA, np.random.default_rng(0)))

    @cached_property
    def bayer_codes(self) -> NDArray[np.uint16]:
        """The samples `bayer` as 16-bit codes."""
        return Levels.around(self.bayer).encode(self.bayer)

    @cached_property
    def _rgb(self) -> FloatArray:
        rows, columns = (min(size, most) for size, most in zip(self.shape, _PIECE, strict=True))
        return builtin_scene(columns, rows).rgb

    @cached_property
    def _taken(self) -> Mosaic:
        return simulate_additive(self._rgb, PATTERN, SensorCalibration.of_bits(_BITS), _SIGMA, np.random.default_rng(0))

    def _repeated(self, piece: NDArray[Sample]) -> NDArray[Sample]:
        times = tuple(-(-size // drawn) for size, drawn in zip(self.shape, piece.shape, strict=True))
        return np.tile(piece, times)[: self.shape[0], : self.shape[1]]


def alternate(works: Mapping[str, Work], rounds: int, clock: Callable[[], float] = time.perf_counter) -> dict[str, list[float]]:
    """Seconds of each function in each round, after one that does not count.

    Every other round runs backwards, so that none always follows the same one.
    """
    found: dict[str, list[float]] = {name: [] for name in works}
    order = list(works.items())
    for number in range(rounds + 1):
        for name, work in order:
            start = clock()
            result = work()
            seconds = clock() - start
            del result  # freeing its memory is not timed
            if number:
                found[name].append(seconds)
        order.reverse()
    return found


def compare(text: str | None, title: str, lens: Corners, pictures: Pictures, figures: Callable[..., list[float]]) -> None:
    """Read the command line, and print a table for each noise: figures of each scene, their means, and what comes back.

    text: of the help.
    title: names of the figures.
    lens: the usual one.
    pictures: what is compared; "no lens" and "unknown" are the best and the worst that can be expected.
    figures: of a picture and the truth, both (H, W, 3).
    """
    from offline import PRESETS

    two, presets = {"nargs": 2, "type": float, "default": lens}, {"choices": ("best", "paper"), "default": "best"}
    given = options(text, "+", sigma=[0.0, 0.01], lens=two, preset=presets)
    scenes = {source: load_scene(source).rgb for source in given.scenes}
    for sigma in given.sigma:
        print(f"sigma {sigma:g}: {title}")
        rows: dict[str, list[list[float]]] = {}
        for source, name, picture in pictures(scenes, sigma, given.lens, PRESETS[given.preset]):
            rows.setdefault(name, []).append(figures(picture, scenes[source]))
            print_line(f"{Path(source).name}, {name}", rows[name][-1])
        means = {name: np.mean(found, axis=0) for name, found in rows.items()}
        for name, mean in means.items():
            print_line(f"mean of {len(scenes)} scenes, {name}", mean)
            if name not in ("no lens", "unknown"):
                back = (mean - means["unknown"]) / (means["no lens"] - means["unknown"])
                print_line("    comes back, %", 100 * back)


def print_line(name: str, row: Iterable[float]) -> None:
    """Print figures as a row of a table."""
    print(f"  {name:40}" + "".join(f"{figure:8.2f}" for figure in row), flush=True)
