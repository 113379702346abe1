"""`evaluate --resume` keeps a result only while all it depends on is the same."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from panchroma.tools.evaluation import cameras as method_module
from panchroma.tools.evaluation import study as study_module
from tests.data import ROOT
from tests.tools.command import SCRIPT, run
from tests.tools.evaluation.examples import small_scene
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads

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
