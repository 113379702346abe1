"""Lists of defective pixels: what a file may look like, and what a wrong one is told."""

import os
from pathlib import Path

import numpy as np
import pytest

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.errors import InputError
from tests.tools.command import assert_refused, names, run
from tools.rendering.defect_list import read_defects, with_defects


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "defects.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        "3,4\n10,0\n",
        "3 4\r\n\r\n10\t0",
        "# row, column\n3, 4  # hot\n10;0",
        "[[3, 4], [10, 0]]",
        '{"schema": 1, "defects": [[3, 4], [10, 0]]}',
    ],
)
def test_every_form_gives_the_same_places(tmp_path: Path, text: str) -> None:
    assert read_defects(written(tmp_path, text)) == ((3, 4), (10, 0))


def test_an_empty_list_is_a_list(tmp_path: Path) -> None:
    assert read_defects(written(tmp_path, "# none\n")) == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3\n", "line 1 is '3'"),
        ("1,2\n3,x\n", "line 2 is '3,x'"),
        ("-1,2\n", "line 1 is '-1,2'"),
        ("1.5,2\n", "line 1"),
        ("9999999999,2\n", "line 1"),
        ("[[1, 2]", "is not JSON"),
        ("[[1, 2.5]]", r"\[1, 2.5\] is not \[row, column\]"),
        ("[[1, -2]]", "no"),
        ("[[true, 2]]", "no"),
        ("[3, 4]", "3 is no"),
        ('{"bad": []}', "expected lines"),
        (b"\xff\xfe\x00", "is not a text in UTF-8"),
    ],
)
def test_a_wrong_list_is_refused_by_name(tmp_path: Path, text: str | bytes, said: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=f"defects.txt: .*{said}"):
        read_defects(path)


def test_places_add_to_those_known() -> None:
    known = SensorCalibration(defects=((1, 1),))
    mosaic = Mosaic(np.zeros((12, 13), np.float32), CfaPattern.bayer(), known)
    assert with_defects(mosaic, ((2, 3), (1, 1))).calibration.defects == ((1, 1), (2, 3))
    with pytest.raises(InputError, match="row 2, column 13, the shot 12 rows and 13 columns"):
        with_defects(mosaic, ((2, 13),))


def test_the_command_mends_what_is_listed(tmp_path: Path, out: Path) -> None:
    """Two hot pixels beside each other, which nothing finds unlisted."""
    scene = np.full((36, 42, 3), 0.3, np.float32)
    scene[15, 21:23] = 1.0
    np.save(tmp_path / "scene.npy", scene)
    assert run("simulate", tmp_path / "scene.npy", "-o", out).code == 0
    shot = out / "scene.dng"
    kind = ("-f", "npy", "--overwrite")
    assert run("render", shot, "-o", out, *kind).code == 0
    hurt = np.load(out / "scene.npy")
    listed = written(tmp_path, "15,21\n15,22\n")
    assert run("render", shot, "-o", out, *kind, "--defects", listed).code == 0
    mended = np.load(out / "scene.npy")
    assert hurt[15, 21].sum() > 2.5
    assert np.abs(mended - 0.3).max() < 0.01


def test_the_command_refuses_a_list_that_cannot_be_meant(tmp_path: Path, out: Path) -> None:
    assert run("simulate", "builtin:24x24", "-o", tmp_path).code == 0
    shot = tmp_path / "builtin-24x24.dng"
    far = written(tmp_path, "3,40\n")
    assert_refused(run("render", shot, "-o", out, "--defects", far), "belongs to another sensor", name=str(shot))
    paper = run("render", shot, "-o", out, "--defects", far, "--preset", "paper")
    assert paper.code == 2
    assert "--defects needs --preset best" in paper.err
    assert names(out) == set()


def test_what_never_ends_or_is_no_list_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "long").open("wb") as file:
        file.truncate(24 << 20)
    (tmp_path / "digits").write_text("[[" + "9" * 5000 + ", 1]]")
    (tmp_path / "far").write_text("[[10000000000, 1]]")
    for name, said in (
        ("pipe", "pipe or a device"),
        ("long", "is larger than"),
        ("digits", "a number of 5000 digits"),
        ("far", "whole numbers"),
    ):
        with pytest.raises(InputError, match=said):
            read_defects(tmp_path / name)
    with pytest.raises(InputError, match="pipe or a device"):
        read_defects("/dev/zero")
