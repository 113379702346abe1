"""`panchroma demo`: the whole chain in one go, on a scene small enough for a test.

The page on bringing up a camera is true: its commands, run one after the other in an empty
folder, print what it says.
"""

import re
import shlex
import shutil
import signal
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from panchroma.shared import read_dng
from panchroma.tools.commands import demo
from panchroma.tools.evaluation.metrics import MEDIAN, quality
from tests.data import ROOT
from tests.python import finished
from tests.tools.command import PROGRAM, Outcome, ended, names, run, start

# --- demo -----------------------------------------------------------------------------------------

WIDTH, HEIGHT = 210, 140
SIZES: dict[str, Any] = {"_WIDTH": WIDTH, "_HEIGHT": HEIGHT, "_DRAWN": (300, 240), "_FRAMES": 4}
PLACES = {
    "_OVERVIEW": (20, 30),
    "_CROPS": {"star": (70, 100), "leaves": (10, 20)},
    "_BURST_CROPS": {"leaves": (10, 20)},
}


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The demo on a small frame, begun in an empty folder."""
    for name, value in (SIZES | PLACES).items():
        monkeypatch.setattr(demo, name, value)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def pixels(path: Path) -> Any:
    with Image.open(path) as image:
        return np.asarray(image).astype(int)


def table(outcome: Outcome) -> dict[str, list[float]]:
    """Method -> RGB, luminance and chrominance."""
    lines = outcome.out.splitlines()[2:-1]  # without head and list of files
    return {line[:18].strip(): list(map(float, line[18:].split())) for line in lines}


def test_the_demo_tells_the_truth_about_its_files(small: Path) -> None:
    outcome = run("demo", "-o", "results", code=0)
    folder = small / "results"
    # before any compilation
    assert outcome.err.startswith("the camera's own preview is ready: results/preview.jpg")
    assert names(folder) == set(outcome.out.splitlines()[-1].removeprefix("results: ").split(", "))
    truth, rendered = tifffile.imread(folder / "truth.tif"), tifffile.imread(folder / "render.tif")
    assert truth.shape == rendered.shape == (HEIGHT, WIDTH, 3)
    figures = table(outcome)
    medians = quality(rendered, truth)[:, MEDIAN]
    assert figures["Panchroma, best"] == pytest.approx(medians, abs=0.05)
    assert "at sigma 0.01" in outcome.out
    # What the demo is there to show: full-resolution luminance.
    assert figures["Panchroma, paper"][1] > figures["Bayer, bilinear"][1] + 3

    assert read_dng(folder / "shot.dng").calibration.noise.read == (0.01,) * 4
    shown, preview = pixels(folder / "render.png"), pixels(folder / "preview.jpg")
    assert shown.shape == preview.shape == truth.shape
    assert np.abs(shown - preview).mean() < 25  # the same picture
    for name in ("overview.png", "comparison.png"):
        assert min(pixels(folder / name).shape[:2]) > 500


def test_a_burst_has_more_colour_than_one_frame(small: Path) -> None:
    outcome = run("demo", "--burst", "-o", "results", code=0)
    folder = small / "results"
    frames = {f"frame-{number}.dng" for number in range(1, 5)}
    pictures = {"frame.png", "burst.png", "burst.tif", "truth.tif", "comparison.png"}
    assert names(folder) == frames | pictures
    truth, merged = tifffile.imread(folder / "truth.tif"), tifffile.imread(folder / "burst.tif")
    figures, medians = table(outcome), quality(merged, truth)[:, MEDIAN]
    assert figures["Burst of 4 frames"] == pytest.approx(medians, abs=0.05)
    assert all(np.subtract(figures["Burst of 4 frames"], figures["One frame"]) > 0)
    assert pixels(folder / "burst.png").shape == pixels(folder / "frame.png").shape == truth.shape
    assert len({read_dng(folder / name).samples.tobytes() for name in frames}) == 4


# --- bring up -------------------------------------------------------------------------------------

PAGE = (ROOT / "device" / "bring_up.md").read_text()
# on smaller frames, for the sake of time
SMALL = PAGE.replace("600x400", "300x200").replace("600 x 400", "300 x 200")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", SMALL, re.DOTALL)
UNIT = next(block for kind, block in BLOCKS if kind == "ini")


def test_the_commands_print_what_the_page_says(tmp_path: Path) -> None:
    program = f'#!/bin/sh\nPYTHONPATH={ROOT}/tools/notebook exec {shlex.join(PROGRAM)} "$@"\n'
    (tmp_path / "panchroma").write_text(program)
    (tmp_path / "panchroma").chmod(0o755)
    steps = "\n".join(f"{block}\necho ---\n" for kind, block in BLOCKS if kind == "sh")
    script = f"set -euo pipefail\nPATH={tmp_path}:$PATH\nmkdir empty; cd empty\n{steps}"
    done = finished("bash", "-c", script, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    printed = iter(done.stdout.split("---\n"))
    for (kind, _), (after, expected) in pairwise(BLOCKS):
        said = next(printed) if kind == "sh" else ""
        if kind == "sh" and not after:
            for line in expected.splitlines():
                assert line in said, said
    shot = read_dng(next((tmp_path / "empty" / "shots").glob("*.dng")))
    assert shot.pattern.letters_from() == ("WRWG", "BWGW", "WGWB", "GWRW")


@pytest.mark.skipif(
    not shutil.which("systemd-analyze"),
    reason="the unit file: systemd is not installed: apt-get install systemd",
)
def test_the_unit_is_one_that_systemd_takes(tmp_path: Path) -> None:
    unit = tmp_path / "panchroma.service"
    unit.write_text(UNIT.replace("/opt/panchroma/.venv/bin/panchroma", sys.executable))
    done = finished("systemd-analyze", "verify", unit)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_the_service_ends_with_0_and_has_saved_shots(tmp_path: Path) -> None:
    (command,) = re.findall(r"^ExecStart=(.*)$", UNIT, re.MULTILINE)
    (tmp_path / "camera.json").write_text('{"schema": 1, "gamma": [1, 1, 1]}')
    for here, there in (
        ("genicam:ID", "builtin:64x48@50"),
        ("/srv/shots", f"{tmp_path}/shots"),
        ("/etc/panchroma", str(tmp_path)),
    ):
        command = command.replace(here, there)
    with start(*command.split()[1:]) as process:
        assert read_dng(process.stdout.readline().split(": ")[0]).shape == (48, 64)
        ended(process, signal.SIGTERM, code=0)
