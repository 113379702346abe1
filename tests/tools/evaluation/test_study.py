"""`evaluate --resume` keeps a result only while all it depends on is the same."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from panchroma.offline import PAPER, render
from panchroma.shared import SensorCalibration
from panchroma.shared.errors import ConvergenceError, InputError
from panchroma.shared.pattern import CfaPattern
from panchroma.tools.evaluation import cameras as method_module
from panchroma.tools.evaluation import methods as registry
from panchroma.tools.evaluation import study as module
from panchroma.tools.evaluation import study as study_module
from panchroma.tools.evaluation.evaluation_page import WORST, Crop, render_exhibit
from panchroma.tools.evaluation.figures import Place
from panchroma.tools.evaluation.metrics import PLANES, QUANTILES, patch_psnr, quality, whole_psnr
from panchroma.tools.evaluation.rivals.bilinear import demosaic_bilinear
from panchroma.tools.evaluation.study import (
    FOLDER,
    Case,
    Study,
    collect,
    missing_cases,
    name_case,
    source_digest,
    work,
)
from panchroma.tools.simulation.protocols import PaperProtocol, SensorProtocol
from panchroma.tools.simulation.sensor import simulate_additive
from tests.bayer import bayer_mosaic
from tests.data import ROOT
from tests.tools.command import SCRIPT, run
from tests.tools.evaluation.examples import alone, measured, small_scene, study_of
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads
from tests.walking import CHANGED, one_field_changed

# --- study ----------------------------------------------------------------------------------------

NOISY = PaperProtocol(0.03)


def works(study: Study, folder: Path, cases: list[Case]) -> list[str]:
    return [line for case in cases for line in work(study, folder, case)]


def test_figures_are_those_of_simulating_rendering_and_measuring_by_hand(tmp_path: Path) -> None:
    figures = measured(study_of(tmp_path), tmp_path)
    maps, pattern, camera = [], CfaPattern.bayer(6), SensorCalibration()
    for seed in range(2):
        truth = small_scene(78, 90 + 12 * seed, seed)
        bayer = demosaic_bilinear(bayer_mosaic(truth, 0.03, np.random.default_rng(0)))
        mosaic = simulate_additive(truth, pattern, camera, 0.03, np.random.default_rng(0))
        sparse = render(mosaic, PAPER).rgb
        for name, picture in (("bilinear", bayer), ("paper", sparse)):
            (measures,) = (
                measures
                for case, measures in figures.results.items()
                if (case.scene.name, case.level, case.method) == (f"scene{seed}", NOISY, name)
            )
            assert measures.quality == quality(picture, truth)
            assert measures.psnr == whole_psnr(picture, truth, 15)
        maps.append(patch_psnr(sparse, truth))
    values = figures.of(Place(figures.groups[0], NOISY), "paper").values
    for name, planes in zip(PLANES, zip(*maps, strict=True), strict=True):
        expected = np.quantile(np.concatenate([plane.ravel() for plane in planes]), QUANTILES)
        pooled = [values[f"{name}_q{round(100 * quantile)}"] for quantile in QUANTILES]
        assert pooled == pytest.approx(expected, abs=0.01)


def test_finished_results_are_not_made_again(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    todo, there = missing_cases(study, tmp_path)
    assert (len(todo), there) == (12, 0)
    assert works(study, tmp_path, todo[:5]) == []  # and here it is interrupted
    todo, there = missing_cases(study, tmp_path)
    assert (len(todo), there) == (7, 5)
    assert works(study, tmp_path, todo) == []
    assert missing_cases(study, tmp_path) == ([], 12)
    assert len(missing_cases(study, tmp_path, anew=True)[0]) == 12
    for path in (tmp_path / FOLDER).iterdir():  # equal scenes are measured once
        path.unlink()
    twice = replace(study, scenes=(study.scenes[0], replace(study.scenes[0], name="again")))
    assert len(missing_cases(twice, tmp_path)[0]) == 6


def test_everything_that_changes_a_result_changes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = study_of(tmp_path, methods=("paper",), count=1)
    scene, method, tile = study.scenes[0], registry.methods()["dlmmse-wb"], study.tile

    def name_of(**changes: Any) -> str:
        facts = {"scene": scene, "level": NOISY, "method": method, "tile": tile, "seed": 0}
        return name_case(**(facts | changes)).name  # type: ignore[arg-type]

    # Without noise any seed is the same, and so is a pattern under another name.
    quiet, same = PaperProtocol(0.0), replace(tile, name="mine")
    assert name_of(level=quiet, tile=same, seed=1) == name_of(level=quiet)
    other: dict[str, str] = {"seed": name_of(seed=1)}
    for level in (PaperProtocol(0.02), SensorProtocol(0.03)):
        other[str(level)] = name_of(level=level)
    for name, pattern in one_field_changed(tile.pattern):
        other[f"pattern.{name}"] = name_of(tile=replace(tile, pattern=pattern))
    for name in ("digest", "neutral"):
        other[name] = name_of(scene=replace(scene, **{name: CHANGED}))  # type: ignore[arg-type]
    changes = {"name": "dcb", "version": "2", "balanced": False, "packages": ("rawpy",)}
    for name, change in changes.items():
        other[name] = name_of(method=replace(method, **{name: change}))  # type: ignore[arg-type]
    for package in ("numba", "numpy", "onnxruntime", "scipy"):
        with monkeypatch.context() as changed:
            versions = lambda name, package=package: f"9 {name == package}"  # noqa: E731
            changed.setattr("panchroma.tools.evaluation.cameras.package_version", versions)
            other[package] = name_of()
    with monkeypatch.context() as changed:
        changed.setattr(module, "source_digest", lambda: CHANGED)
        other["source"] = name_of()
    assert {"pattern.tile", "pattern.origin", "pattern.channels"} <= other.keys()
    assert len({name_of(), *other.values()}) == len(other) + 1


def test_a_picture_that_changes_once_listed_is_one_line_and_nothing_is_kept(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    todo = missing_cases(study, tmp_path)[0]
    assert works(study, tmp_path, todo[:1]) == []
    path = Path(study.scenes[0].source)
    before = path.read_bytes()
    np.save(path, small_scene(78, 90, 7))
    # a picture is listed as it is now
    assert study_of(tmp_path).scenes[0].digest != study.scenes[0].digest
    study.reading.scene(study.scenes[1])  # what was read of the first one is forgotten
    line = f"{path}: the picture has changed since the evaluation began; run it again"
    assert alone().measure(study, tmp_path, todo[1:]) == [line]
    assert len(collect(study, tmp_path)) == 1 + 6  # what was measured before is right
    with pytest.raises(InputError, match=r"scene0\.npy: the picture has changed"):
        render_exhibit(study, Crop(study.scenes[0], NOISY, WORST, ("paper",), 15, 15, 48, 60))
    path.write_bytes(before)  # a worker that has seen the other one takes it up again
    assert works(study, tmp_path, missing_cases(study, tmp_path)[0]) == []
    path.unlink()
    study.reading.scene(study.scenes[1])
    (line,) = alone().measure(study, tmp_path, todo)
    assert line.startswith(f"{path}: there is no such file")


def test_a_network_that_changes_is_one_line_and_results_depend_on_its_content_alone(
    tmp_path: Path,
) -> None:
    def written(folder: Path, weight: float, name: str = "mine") -> tuple[str, Study]:
        folder.mkdir(exist_ok=True)
        path = of_quads(folder, [weight, 0, 0, 0, 0], name, order="GRBG", inputs=QUADS)
        (method,) = registry.choose([path])
        return path, study_of(tmp_path, methods=(method.name,), sources=((method.name, path),))

    path, study = written(tmp_path / "one", 1)
    kept = {case.name for case in study.cases()}
    todo = missing_cases(study, tmp_path)[0]
    assert works(study, tmp_path, todo[:1]) == []
    other, changed = written(tmp_path / "one", 0.5)
    registry.find_method.cache_clear()  # as in another process
    assert not kept & {case.name for case in changed.cases()}
    assert changed.methods != study.methods
    (line,) = works(study, tmp_path, todo[1:2])
    assert line == f"{other}: has changed since the evaluation began; run it again"
    assert works(changed, tmp_path, missing_cases(changed, tmp_path)[0][:1]) == []
    elsewhere = written(tmp_path / "two", 1, "renamed")[1]
    assert {case.name for case in elsewhere.cases()} == kept
    assert missing_cases(elsewhere, tmp_path)[1] == 1
    todo = missing_cases(changed, tmp_path)[0]
    for end in (".json", ".onnx"):
        Path(path).with_suffix(end).unlink()
        registry.find_method.cache_clear()
        (line,) = works(changed, tmp_path, todo[:1])
        assert line.startswith(f"{Path(path).with_suffix(end)}: ")


def test_results_of_another_version_are_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker on another machine, or a package that was installed meanwhile."""
    study = study_of(tmp_path, methods=("dcb", "bilinear"))
    todo = missing_cases(study, tmp_path)[0]
    monkeypatch.setattr(
        "panchroma.tools.evaluation.cameras.package_version", lambda name: "another"
    )
    for line, name in zip(alone().measure(study, tmp_path, todo), study.methods, strict=True):
        assert line.startswith(f"{name}: the process that measures has another source of Panchroma")


def test_a_damaged_result_is_made_again(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    before = measured(study, tmp_path)
    for index, path in enumerate(sorted((tmp_path / FOLDER).iterdir())[:3]):
        path.write_bytes([b"", b"junk", path.read_bytes()[:-30]][index])
    todo, there = missing_cases(study, tmp_path)
    assert (len(todo), there) == (3, 9)
    assert measured(study, tmp_path).rows == before.rows


def test_one_failing_method_stops_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failing = Mock(side_effect=ConvergenceError("stopped at 500 iterations"))
    study = study_of(tmp_path, methods=("bilinear", "dlmmse"), count=1)
    todo = missing_cases(study, tmp_path)[0]
    known = registry.methods()
    monkeypatch.setitem(known, "dlmmse", replace(known["dlmmse"], function=failing))
    registry.find_method.cache_clear()
    lines = works(study, tmp_path, todo)
    assert lines[0].endswith("scene0.npy: dlmmse, no noise: stopped at 500 iterations")
    assert (len(lines), len(collect(study, tmp_path))) == (2, 2)
    registry.find_method.cache_clear()


# --- resume ---------------------------------------------------------------------------------------

MINE = "from panchroma.offline import PAPER, render\nGAIN = 1\n\ndef mine(mosaic):\n    return GAIN * render(mosaic, PAPER).rgb\n"
RESULTS = 5  # of the run below


class Folder:
    """An evaluation that is finished."""

    def __init__(self, path: Path, out: Path) -> None:
        self.path, self.out = path, out
        self.options = {"--sigma": "0.01", "--crop": "60", "--jobs": "1"}
        self.flags: list[str] = []
        self.write(0)
        (path / "mine.txt").write_text("RGWW/GBWW/WWWW/WWWW")
        (path / "mine.py").write_text(MINE)
        self.network = of_quads(path, [1, 0, 0, 0, 0], "rival", order="GRBG", inputs=QUADS)

    def write(self, seed: int) -> None:
        codes = np.rint(small_scene(66, 72, seed) * 255).astype(np.uint8)
        Image.fromarray(codes).save(self.path / "scene.png")

    def run(self, *more: str) -> str:
        """What the command says."""
        options = [f"{name}={value}" for name, value in self.options.items()]
        methods = f"--methods=preview,dlmmse-wb,bilinear,{self.path}/mine.py:mine"
        words = (*options, *self.flags, methods, f"--rival={self.network}", *more)
        pattern = f"--pattern={self.path}/mine.txt"
        return run("evaluate", self.path / "scene.png", "-o", self.out, pattern, *words, code=0).out

    def kept(self) -> int:
        """Number of results that the next run would not make again."""
        last = self.run("--resume", "--dry-run").splitlines()[-1]
        assert last.startswith(f"{RESULTS - int(last.split()[4])} results to make")
        return int(last.split()[4])


@pytest.fixture
def finished(tmp_path: Path, out: Path) -> Folder:
    (tmp_path / "in").mkdir()
    folder = Folder(tmp_path / "in", out)
    folder.run()
    assert folder.kept() == RESULTS
    return folder


def option(name: str, value: str) -> Callable[[Folder, pytest.MonkeyPatch], None]:
    return lambda folder, _: folder.options.update({name: value})


def written(name: str, text: str) -> Callable[[Folder, pytest.MonkeyPatch], None]:
    def write(folder: Folder, _: pytest.MonkeyPatch) -> None:
        (folder.path / name).write_text(text)

    return write


def another_light(folder: Folder, _: pytest.MonkeyPatch) -> None:
    del folder.options["--sigma"]
    folder.options["--light"] = "0.25"


def another_network(folder: Folder, _: pytest.MonkeyPatch) -> None:
    of_quads(folder.path, [0.5, 0, 0, 0, 0], "rival", order="GRBG", inputs=QUADS)


def another_description(folder: Folder, _: pytest.MonkeyPatch) -> None:
    of_quads(folder.path, [1, 0, 0, 0, 0], "rival", order="GRBG", inputs=QUADS, gamma=2.2)


def another_package(_: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(method_module, "package_version", lambda name: "0")


def another_source(_: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_module, "source_digest", lambda: "0")


@pytest.mark.parametrize(
    ("change", "kept"),
    [
        (lambda folder, _: folder.write(1), 0),
        (lambda folder, _: folder.flags.append("--linear"), 0),
        (option("--crop", "54"), 0),
        (option("--sigma", "0.02"), 0),
        (another_light, 0),
        (written("mine.txt", "GRWW/BGWW/WWWW/WWWW"), 3),
        (written("mine.py", MINE.replace("1", "2")), 4),
        (written("beside.py", "GAIN = 1"), 4),
        (another_network, 4),
        (another_description, 4),
        (another_package, 0),
        (another_source, 0),
        (option("--jobs", "2"), RESULTS),
        (lambda folder, _: folder.flags.append("--max-memory=8G"), RESULTS),
    ],
    ids=[
        "scene",
        "linear",
        "crop",
        "sigma",
        "light",
        "pattern",
        "function",
        "beside",
        "network",
        "description",
        "packages",
        "source",
        "jobs",
        "memory",
    ],
)
def test_what_a_result_depends_on_is_measured_again(
    finished: Folder,
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[Folder, pytest.MonkeyPatch], None],
    kept: int,
) -> None:
    change(finished, monkeypatch)
    assert finished.kept() == kept


def test_a_function_that_was_edited_has_other_figures(finished: Folder) -> None:
    before = (finished.out / "evaluation.csv").read_text()
    (finished.path / "mine.py").write_text(MINE.replace("GAIN = 1", "GAIN = 3"))
    finished.run("--resume")
    after = (finished.out / "evaluation.csv").read_text()
    rows = [
        {line.split(",")[3].partition("-")[0]: line.split(",")[7] for line in text.splitlines()[1:]}
        for text in (before, after)
    ]
    assert {name for name in rows[0] if rows[0][name] != rows[1][name]} == {"mine.mine"}


def test_the_source_is_all_that_can_be_imported_and_the_networks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_module, "__file__", str(tmp_path / "tools/evaluation/study.py"))

    def digest_with(name: str, data: bytes = b"") -> str:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(data)
        return source_digest.__wrapped__()

    before = digest_with("tools/batch/run.py")
    others = "tests/a.py", "tools/README.md", ".DS_Store", "shared/.DS_Store"
    copies = "tools/batch/._run.py", "tools/batch/run copy.py", "offline/models/._a.onnx"
    for name in (*others, *copies, "offline/models/loss.png", "tools/notebook/panchroma/a.py"):
        assert digest_with(name) == before, name
    network = "offline/models/a.onnx"
    changed = [
        ("tools/batch/run.py", b"1"),
        ("tools/new.py", b""),
        (network, b"1"),
        (network, b"2"),
    ]
    assert len({before, *(digest_with(*change) for change in changed)}) == 1 + len(changed)


@pytest.fixture
def clone(tmp_path: Path) -> Iterator[Path]:
    """A copy of the sources."""
    for name in ("shared", "device", "offline", "tools"):
        shutil.copytree(
            ROOT / name, tmp_path / "clone" / name, True, shutil.ignore_patterns("__pycache__")
        )
    yield tmp_path / "clone"
    shutil.rmtree(tmp_path / "clone")


def test_an_edited_clone_measures_again(clone: Path, tmp_path: Path) -> None:
    def listed(*more: str) -> str:
        words = [
            "evaluate",
            "builtin:60x60",
            "--methods",
            "bilinear,dlmmse",
            "--sigma",
            "0.01",
            "--jobs",
            "1",
            "-o",
        ]
        process = subprocess.run(
            (sys.executable, "-c", SCRIPT, *words, str(tmp_path / "out"), *more),
            env={**os.environ, "PYTHONPATH": str(clone / "tools" / "notebook")},
            capture_output=True,
            text=True,
            check=True,
        )
        return process.stdout.splitlines()[-1]

    listed()
    assert listed("--resume", "--dry-run").startswith("0 results to make, 2 kept")
    for name, now, then in (
        ("tools/evaluation/metrics.py", "BORDER = 15", "BORDER = 16"),
        ("tools/evaluation/rivals/dlmmse.py", "_WINDOW = 9", "_WINDOW = 7"),
        ("tools/simulation/sensor.py", "import numpy as np", "import numpy as np  # other"),
        ("offline/settings.py", "likeness=7.0", "likeness=8.0"),
    ):
        text = (clone / name).read_text()
        assert now in text
        (clone / name).write_text(text.replace(now, then))
        assert listed("--resume", "--dry-run").startswith("2 results to make, 0 kept")
        (clone / name).write_text(text)
    network = min((clone / "offline" / "models").glob("*.onnx"))
    network.write_bytes(network.read_bytes() + b"\0")
    assert listed("--resume", "--dry-run").startswith("2 results to make, 0 kept")
