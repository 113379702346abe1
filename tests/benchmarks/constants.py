"""Halve and double every number that changes a picture: python -m tests.benchmarks.constants SCENE... [-o constants.json]

The numbers are the settings of the preset `best`, and the module-level names in `offline` that stand for a number or for several.
Each is halved and doubled, by itself, in a copy of the package. Pictures of the middle of all scenes are rendered with it, in the
CASES below, and compared with those of the package as it is. The table shows the change of PSNR (mean over a half of the scenes)
in the case where it is largest: constants may be chosen on the first half of the scenes, and have to hold on the other half.

--markdown FILE prints the table of an earlier run's FILE. --only TEXT measures names that contain TEXT. -j N: threads.
"""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import shift

from offline import BEST, PAPER, RenderSettings, render, use_threads
from offline.burst import merge_burst, render_burst_bands
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from tests.benchmarks.harness import PATTERN, middle, options
from tests.data import ROOT
from tools.evaluation.metrics import BORDER, psnr, quality
from tools.simulation.load import load_scene
from tools.simulation.sensor import simulate_additive, simulate_sensor

SIDE = 168  # pixels: a whole number of periods, and large enough for a burst to align
FACTORS = (0.5, 2.0)
FIGURES = "median", "10 %", "whole"
_SETTING = "settings"
_NAME = re.compile(r"_?[A-Z][A-Z0-9_]*")
_OF_BURSTS = {"numerics/interpolation.py"}
_LEFT_OUT = {"memory.py", "ahead.py", "compile.py", "version.py"}  # about memory and compilation, not about pictures
_REFUSED = "refused"
_MOTIONS = (0.0, 0.0), (1.25, 2.5), (2.0, -1.75), (-2.4, 1.1)  # pixels


@dataclass(frozen=True)
class Number:
    """A number that may change pictures.

    file: the module, relative to `offline`; `_SETTING` for a setting.
    name: of the constant, or `stage.name` of the setting.
    value: as it is written.
    line: with which that ends in the module's text; 0 for a setting.
    """

    file: str
    name: str
    value: str
    line: int = 0

    @property
    def title(self) -> str:
        """Its name in tables."""
        return f"{self.file.removesuffix('.py').replace('/', '.')}.{self.name}"


def numbers() -> list[Number]:
    """Every setting and constant of `offline` that is a number, or several."""
    found = []
    for part in fields(BEST):
        for name, value in vars(getattr(BEST, part.name)).items():
            if scaled(value, 2.0) is not None:
                found.append(Number(_SETTING, f"{part.name}.{name}", str(value)))
    for path in sorted((ROOT / "offline").rglob("*.py")):
        if path.name not in _LEFT_OUT:
            found += constants_of(path.read_text(encoding="utf-8"), path.relative_to(ROOT / "offline").as_posix())
    return found


def constants_of(text: str, file: str) -> Iterator[Number]:
    """The numbers that a module's text gives names in capitals."""
    for node in ast.parse(text).body:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)) if len(names) == len(values):
                pairs = list(zip(names, values, strict=True))
            case ast.Assign(targets=[name], value=value) | ast.AnnAssign(target=name, value=ast.expr() as value):
                pairs = [(name, value)]
            case _:
                continue
        for name, value in pairs:
            if isinstance(name, ast.Name) and _NAME.fullmatch(name.id) and _is_number(value):
                yield Number(file, name.id, ast.get_source_segment(text, value) or "", node.end_lineno or 0)


def _is_number(node: ast.expr) -> bool:
    """Whether an expression consists of numbers alone."""
    names = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
    names |= {each.attr for each in ast.walk(node) if isinstance(each, ast.Attribute)}
    return names <= {"np", "float32"} and scaled(eval(ast.unparse(node), {"np": np}), 2.0) is not None


def scaled(value: Any, factor: float) -> Any:
    """A number, or each of several, times a factor; whole numbers stay whole. None for anything else."""
    match value:
        case bool():
            return None
        case int():
            return round(value * factor) if value != 1 or factor > 1 else 1
        case float() | np.floating():
            return value * type(value)(factor)
        case tuple() if value and all(scaled(each, factor) is not None for each in value):
            parts = [scaled(each, factor) for each in value]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return None


def changed(text: str, number: Number, factor: float) -> str:
    """A module's text with one of its constants times a factor."""
    new = repr(scaled(eval(number.value, {"np": np}), factor))  # numbers alone, as `_is_number` has seen
    lines = text.splitlines()
    return "\n".join([*lines[: number.line], f"{number.name} = {new}", *lines[number.line :], ""])


def with_setting(settings: RenderSettings, name: str, factor: float) -> RenderSettings:
    """Settings with one of them, `stage.name`, times a factor."""
    part, _, field = name.partition(".")
    stage = getattr(settings, part)
    return replace(settings, **{part: replace(stage, **{field: scaled(getattr(stage, field), factor)})})


# What is rendered: from the scene, the settings and a source of noise to the picture and what it should be.


def _shot(scene: FloatArray, sigma: float, rng: np.random.Generator, *, known: bool = True, letters: str = "") -> Mosaic:
    pattern = CfaPattern.of_letters(letters) if letters else PATTERN
    taken = simulate_additive(scene, pattern, SensorCalibration(), sigma, rng)
    return taken if known else replace(taken, calibration=replace(taken.calibration, noise=None))


def _bright(scene: FloatArray, settings: RenderSettings, rng: np.random.Generator) -> FloatArray:
    taken = simulate_sensor(scene, PATTERN, SensorCalibration.of_bits(12, headroom=False), 2.0, rng)
    return np.float32(0.5) * render(taken, settings).rgb


def _defective(scene: FloatArray, settings: RenderSettings, rng: np.random.Generator) -> FloatArray:
    taken = _shot(scene, 0.01, rng)
    samples, hot = taken.samples.copy(), rng.random(taken.shape) < 1e-3
    samples[hot] = rng.uniform(0, 3, int(hot.sum()))
    return render(replace(taken, samples=samples), settings).rgb


def _burst(scene: FloatArray, settings: RenderSettings, rng: np.random.Generator) -> FloatArray:
    moved = (shift(scene, (*motion, 0.0), mode="mirror").astype(np.float32) for motion in _MOTIONS)
    merged = merge_burst([_shot(each, 0.02, rng) for each in moved], settings, reference=0)
    return np.concatenate(list(render_burst_bands(merged, settings)))


CASES: dict[str, Callable[[FloatArray, RenderSettings, np.random.Generator], FloatArray]] = {
    "clean": lambda scene, settings, rng: render(_shot(scene, 0.0, rng), settings).rgb,
    "0.01": lambda scene, settings, rng: render(_shot(scene, 0.01, rng), settings).rgb,
    "0.03": lambda scene, settings, rng: render(_shot(scene, 0.03, rng), settings).rgb,
    "unknown": lambda scene, settings, rng: render(_shot(scene, 0.02, rng, known=False), settings).rgb,
    "bright": _bright,
    "defects": _defective,
    "scattered": lambda scene, settings, rng: render(_shot(scene, 0.01, rng, letters="WBWG/BWGW/WGWR/GWRW"), settings).rgb,
    "paper": lambda scene, _, rng: render(_shot(scene, 0.01, rng), PAPER).rgb,
    "burst": _burst,
}
"""clean, 0.01, 0.03: noise of this standard deviation, and the model of it. unknown: 0.02, without a model. bright: exposed by a
stop too much, as a sensor does. defects: 0.01, and one sample in a thousand reads anything.
scattered: 0.01, Kodak's pattern. paper: 0.01, the preset `paper`. burst: four frames at 0.02, for what no single frame needs."""


def measure(scenes: Path, name: str, factor: float, only: list[str]) -> None:
    """In a process of its own: print the FIGURES and a digest of each case and scene, as JSON."""
    use_threads(1)
    settings = with_setting(BEST, name, factor) if name else BEST
    found: dict[str, list[list[Any]]] = {case: [] for case in only}
    with np.load(scenes) as file:
        for scene in (file[each] for each in file):
            for case in only:
                picture = CASES[case](scene, settings, np.random.default_rng(6))
                levels = quality(picture, scene).rgb
                digest = sha256(picture.tobytes()).hexdigest()
                found[case].append([levels[2], levels[0], psnr(picture, scene, BORDER), digest])
    print(json.dumps(found))


class Trial:
    """Measures the package with a number changed."""

    def __init__(self, folder: Path, scenes: list[FloatArray]) -> None:
        self._folder = folder
        self._first, self._all = folder / "first.npz", folder / "all.npz"
        np.savez(self._first, scenes[0])
        np.savez(self._all, *scenes)
        self.whole: dict[str, list[list[Any]]] = json.loads(self._run(ROOT, self._all, "", 1.0, list(CASES)))

    def of(self, number: Number, factor: float) -> dict[str, list[list[float]]] | str:
        """Case -> change of FIGURES of each scene, of cases whose picture of the first scene changes; or why there is none."""
        name = number.name if number.file == _SETTING else ""
        with tempfile.TemporaryDirectory(dir=self._folder) as folder:
            tree = ROOT if name else Path(folder)
            if not name:  # what is compiled stays valid but for the kernels that this number is in
                shutil.copytree(ROOT / "offline", tree / "offline")
                path = tree / "offline" / number.file
                path.write_text(changed(path.read_text(encoding="utf-8"), number, factor), encoding="utf-8")
            single = bool(name) or not (number.file.startswith("burst/") or number.file in _OF_BURSTS)
            tried = [case for case in CASES if (case == "burst") != single]
            try:
                first = json.loads(self._run(tree, self._first, name, factor, tried))
                cases = [case for case in tried if first[case][0] != self.whole[case][0]]
                found = json.loads(self._run(tree, self._all, name, factor, cases)) if cases else {}
            except subprocess.CalledProcessError as error:
                return f"{_REFUSED}: {error.stderr.strip().splitlines()[-1]}"
        figures = {case: [[scene[:3] for scene in each] for each in (found[case], self.whole[case])] for case in found}
        return {case: np.subtract(changed, whole).tolist() for case, (changed, whole) in figures.items()}

    def _run(self, tree: Path, scenes: Path, name: str, factor: float, cases: list[str]) -> str:
        code = (
            f"import offline; assert offline.__file__.startswith({str(tree)!r})\n"
            f"from tests.benchmarks.constants import *; measure(Path({str(scenes)!r}), {name!r}, {factor}, {cases})"
        )
        path, command = {**os.environ, "PYTHONPATH": str(ROOT)}, [sys.executable, "-c", code]
        # In `tree`, whose `offline` comes before any other.
        return subprocess.run(command, env=path, cwd=tree, capture_output=True, text=True, check=True).stdout


def shown(changes: dict[str, list[list[float]]] | str) -> str:
    """The case that changes most, and its mean changes in the first half of the scenes and in the other one, dB."""
    if isinstance(changes, str):
        return _REFUSED
    if not changes:
        return "="
    case = max(changes, key=lambda each: np.abs(np.mean(changes[each], axis=0)).max())
    table = np.array(changes[case])
    halves = [table[::2].mean(axis=0), table[1::2].mean(axis=0)]
    return f"{case} " + " ".join("/".join(f"{value:+.2f}" for value in half) for half in halves)


def markdown(kept: dict[str, Any]) -> str:
    """The table for people: settings first, then modules. Cells without spaces, for a page that is counted in words."""
    lines = ["|number|is|halved|doubled|", "|-|-|-|-|"]
    for title, (value, *changes) in kept.items():
        cells = [shown(each).replace(" ", ", ") for each in changes]
        lines.append(f"|`{title}`|{value}|{'|'.join(cells)}|")
    return "\n".join(lines)


def main() -> None:
    """Measure, print a line for each number, and keep the figures."""
    arguments = options(__doc__, "*", output=Path("constants.json"), only="", threads=1, markdown={"type": Path})
    if arguments.markdown:
        print(markdown(json.loads(arguments.markdown.read_text())))
        return
    wanted = [each for each in numbers() if arguments.only in each.title]
    kept: dict[str, Any] = json.loads(arguments.output.read_text()) if arguments.output.exists() else {}
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(arguments.threads) as pool:
        trial = Trial(Path(folder), [middle(load_scene(scene).rgb, SIDE) for scene in arguments.scenes])
        tasks = {each.title: (each, [pool.submit(trial.of, each, factor) for factor in FACTORS]) for each in wanted}
        for title, (number, results) in tasks.items():
            changes = [each.result() for each in results]
            print(f"{title:42} {number.value:24} {shown(changes[0]):44} {shown(changes[1])}", flush=True)
            kept[title] = [number.value, *changes]
            arguments.output.write_text(json.dumps(kept))


if __name__ == "__main__":
    main()
