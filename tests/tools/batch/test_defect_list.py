"""Lists of defective pixels: what a file may look like, and what a wrong one is told."""

import os
from pathlib import Path

import numpy as np
import pytest

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.errors import InputError
from tests.tools.command import assert_refused, names, run
from tools.batch.defect_list import read_defects, with_defects


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "defects.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("text", ["3,4\n10,0\n", "3 4\r\n\r\n10\t0", "# row, column\n3, 4  # hot\n10;0"])
def test_every_form_gives_the_same_places(tmp_path: Path, text: str) -> None:
    assert read_defects(written(tmp_path, text)) == ((3, 4), (10, 0))
    assert read_defects(written(tmp_path, "# none\n")) == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3\n", "line 1 is '3'"),
        ("1,2\n3,x\n", "line 2 is '3,x'"),
        ("-1,2\n", "line 1 is '-1,2'"),
        ("9999999999,2\n", "line 1"),
        (b"\xff\xfe\x00", "is not a text in UTF-8"),
    ],
)
def test_a_wrong_list_is_refused_by_name(tmp_path: Path, text: str | bytes, said: str) -> None:
    with pytest.raises(InputError, match=f"defects.txt: .*{said}"):
        read_defects(written(tmp_path, text))
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe or a device"):
        read_defects(tmp_path / "pipe")


def test_places_add_to_those_known() -> None:
    known = SensorCalibration(defects=((1, 1), (5, 6)))
    mosaic = Mosaic(np.zeros((12, 13), np.float32), CfaPattern.bayer(), known)
    assert with_defects(mosaic, ((2, 3), (1, 1))).calibration.defects == ((1, 1), (2, 3), (5, 6))
    for place, words in (((2, 13), "row 2, column 13, the shot 12 rows and 13 columns"), ((12, 2), "row 12, column 2")):
        with pytest.raises(InputError, match=words):
            with_defects(mosaic, (place,))


def test_the_command_mends_what_is_listed(tmp_path: Path, out: Path) -> None:
    """Two hot pixels beside each other, which nothing finds unlisted."""
    scene = np.full((36, 42, 3), 0.3, np.float32)
    scene[15, 21:23] = 1.0
    np.save(tmp_path / "scene.npy", scene)
    run("simulate", tmp_path / "scene.npy", "-o", out, code=0)
    pictures = []
    for options in ((), ("--defects", written(tmp_path, "15,21\n15,22\n"))):
        run("render", out / "scene.dng", "-o", out, "-f", "npy", "--overwrite", *options, code=0)
        pictures.append(np.load(out / "scene.npy"))
    assert pictures[0][15, 21].sum() > 2.5
    assert np.abs(pictures[1] - 0.3).max() < 0.01


def test_the_command_refuses_a_list_that_cannot_be_meant(tmp_path: Path, out: Path) -> None:
    run("simulate", "builtin:24x24", "-o", tmp_path, code=0)
    shot = tmp_path / "builtin-24x24.dng"
    far = written(tmp_path, "3,40\n")
    assert_refused(run("render", shot, "-o", out, "--defects", far), "belongs to another sensor", name=str(shot))
    assert names(out) == set()
