"""What the benchmarks share: options, scenes, shots, the frame on which speed is measured, rounds.

It does not load the renderer, whose libraries read the number of threads when they are loaded.
"""

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from panchroma.shared import CfaPattern, FloatArray, Mosaic, SensorCalibration
from panchroma.tools.evaluation.rivals.libraw import encode_codes
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive
from tests.bayer import bayer_mosaic
from tests.data import DATA

PATTERN = CfaPattern.bayer(6)
SEED = 3
Sample = TypeVar("Sample", bound=np.generic)
_SIGMA, _BITS = 0.01, 12
# whole periods and whole Bayer quads fit, so that the pattern continues where pieces meet
_STEP = 12
# rows, columns drawn; larger frames repeat them, because drawing takes longer than rendering
_PIECE = 792, 1200
Work = Callable[[], object]


def options(text: str | None, number: str = "", **usual: Any) -> argparse.Namespace:
    """Read the command line.

    text: of the help. number: of scenes, which come first, as `nargs`; "" = the benchmark takes
    none. usual: of each option its default, of that type, a list for several; or what
    `add_argument` takes.
    """
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=text, formatter_class=form)
    if number:
        parser.add_argument("scenes", nargs=number, metavar="SCENE")
    for name, value in usual.items():
        kind = {"default": value, "type": type(value)}
        if isinstance(value, list):
            kind = {"default": value, "type": type(value[0]), "nargs": "+"}
        short = {"output": ["-o"], "threads": ["-j"]}.get(name, [])
        flags = (*short, f"--{name.replace('_', '-')}")
        parser.add_argument(*flags, **(value if isinstance(value, dict) else kind))
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
    taken = simulate_additive(
        rgb, PATTERN, SensorCalibration.of_bits(16, **lens), sigma, np.random.default_rng(seed)
    )
    return Mosaic(taken.codes, PATTERN, taken.calibration)


@dataclass(frozen=True)
class Frame:
    """The built-in scene as both cameras see it, in every form that is measured. shape: (rows,
    columns), multiples of 12.
    """

    shape: tuple[int, int]

    @classmethod
    def of(cls, megapixels: float) -> "Frame":
        """A frame of about so many, 3 : 2."""
        columns = max(24, round((megapixels * 1.5e6) ** 0.5 / _STEP) * _STEP)
        return cls((max(24, round(megapixels * 1e6 / columns / _STEP) * _STEP), columns))

    @cached_property
    def shot(self) -> Mosaic:
        """The sparse-colour shot as the sensor gives it, in codes."""
        return Mosaic(self._repeated(self._taken.codes), PATTERN, self._taken.calibration)

    @cached_property
    def mosaic(self) -> Mosaic:
        """The sparse-colour shot in scene units."""
        return Mosaic(self._repeated(self._taken.signal), PATTERN, self._taken.calibration)

    @cached_property
    def bayer(self) -> FloatArray:
        """Samples of a Bayer sensor from the same scene with the same noise, scene units."""
        return self._repeated(bayer_mosaic(self._rgb, _SIGMA, np.random.default_rng(0)))

    @cached_property
    def bayer_codes(self) -> NDArray[np.uint16]:
        """The samples `bayer` as 16-bit codes."""
        return encode_codes(self.bayer)[0]

    @cached_property
    def _rgb(self) -> FloatArray:
        rows, columns = (min(size, most) for size, most in zip(self.shape, _PIECE, strict=True))
        return builtin_scene(columns, rows).rgb

    @cached_property
    def _taken(self) -> Mosaic:
        camera, random = SensorCalibration.of_bits(_BITS), np.random.default_rng(0)
        return simulate_additive(self._rgb, PATTERN, camera, _SIGMA, random)

    def _repeated(self, piece: NDArray[Sample]) -> NDArray[Sample]:
        (rows, columns), (height, width) = self.shape, piece.shape
        return np.tile(piece, (-(-rows // height), -(-columns // width)))[:rows, :columns]


def alternate(
    works: Mapping[str, Work], rounds: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, list[float]]:
    """Seconds of each function in each round, after one that does not count.

    Every other round runs backwards, so that none always follows the same one.
    """
    seconds: dict[str, list[float]] = {name: [] for name in works}
    order = list(works.items())
    for number in range(rounds + 1):
        for name, work in order:
            start = clock()
            result = work()
            end = clock()
            del result  # freeing its memory is not timed
            if number:
                seconds[name].append(end - start)
        order.reverse()
    return seconds
