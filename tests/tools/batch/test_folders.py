"""Which files a command finds in folders: the same for all commands."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from panchroma.tools.batch.folders import DNGS, Source, search
from panchroma.tools.evaluation.scene_sets import expand
from tests.tools.command import contents, run
from tests.tools.io.files import write_dng


def touch(top: Path, *names: str) -> None:
    for name in names:
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).touch()


def test_files_come_as_given_and_folders_in_order_with_all_below_them(tmp_path: Path) -> None:
    touch(tmp_path, "in/b.dng", "in/A.DNG", "in/sub/c.d.dng", "lone/z.dng")
    found = search([str(tmp_path / "lone/z.dng"), str(tmp_path / "in"), "missing.dng"], DNGS)
    assert (found.failures, found.left_out) == ([], [])
    assert found.sources == [
        Source(f"{tmp_path}/lone/z.dng"),
        Source(f"{tmp_path}/in/A.DNG", Path("A.DNG")),
        Source(f"{tmp_path}/in/b.dng", Path("b.dng")),
        Source(f"{tmp_path}/in/sub/c.d.dng", Path("sub/c.d.dng")),
        Source("missing.dng"),
    ]


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    touch(tmp_path, "a.dng", *(f"{letter}.txt" for letter in "bcdef"), ".hidden.dng", ".git/x.dng", "out/y.dng", ".journal.jsonl")
    (tmp_path / "loop").symlink_to(tmp_path)
    found = search([str(tmp_path)], DNGS, output=tmp_path / "out")
    assert [source.name for source in found.sources] == [f"{tmp_path}/a.dng"]
    assert found.left_out == [
        f"{tmp_path}: left out .hidden.dng, b.txt, c.txt and 3 more files; 1 hidden folder; 1 result folder; 1 linked folder"
    ]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_folder_that_cannot_be_read_has_failed(tmp_path: Path) -> None:
    touch(tmp_path, "a.dng", "closed/b.dng")
    (tmp_path / "closed").chmod(0)
    found = search([str(tmp_path)], DNGS)
    (tmp_path / "closed").chmod(0o700)
    assert [source.name for source in found.sources] == [f"{tmp_path}/a.dng"]
    assert found.failures == [(f"{tmp_path}/closed", "cannot be read (Permission denied)")]


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    """Shots in a folder and below, a linear DNG, which is none, and a text."""
    folder = tmp_path / "shots"
    for place in (folder, folder / "sub"):
        place.mkdir()
        run("simulate", "builtin:36x24", "-o", place, code=0)
    run("render", folder / "builtin-36x24.dng", "-o", tmp_path, "-f", "dng", "--preset", "paper", code=0)
    (tmp_path / "builtin-36x24.dng").rename(folder / "linear.dng")
    (folder / "notes.txt").write_text("no shot")
    return folder


@pytest.mark.parametrize("command", [("preview",), ("render", "--preset", "paper"), ("inspect",)])
def test_commands_take_a_folder_of_shots_alike(shots: Path, out: Path, command: tuple[str, ...]) -> None:
    output = () if command == ("inspect",) else ("-o", out)
    outcome = run(*command, shots, *output, "--json", code=0)
    assert f"{shots}: left out notes.txt" in outcome.err
    assert "linear.dng: not a mosaic of Panchroma" in outcome.err
    assert {(Path(each["source"]).relative_to(shots).as_posix(), each.get("foreign", False)) for each in outcome.records} == {
        ("builtin-36x24.dng", False),
        ("sub/builtin-36x24.dng", False),
        ("linear.dng", True),
    }
    if output:
        made = {Path(name).with_suffix("").as_posix() for name in contents(out) if not name.startswith(".")}
        assert made == {"builtin-36x24", "sub/builtin-36x24"}
    # A file that the user names has to be a shot.
    run(*command, shots / "linear.dng", *output, code=1)


def test_beside_a_camera_raw_a_picture_is_left_out_with_one_note_for_all_unless_it_is_named(tmp_path: Path, out: Path) -> None:
    folder = tmp_path / "photographs"
    folder.mkdir()
    for number in range(5):
        write_dng(folder / f"DSC_{number}.NEF", np.full((108, 108), 300 + number, np.uint16))
        Image.new("RGB", (54, 54), (number, 9, 9)).save(folder / f"DSC_{number}.JPG")
    Image.new("RGB", (54, 54)).save(folder / "DSC_0_edited.tif")
    note = f"{folder}: left out DSC_0.JPG, DSC_1.JPG, DSC_2.JPG and 2 more files beside a camera RAW of the same name"
    stems = {"DSC_0_edited", *(f"DSC_{number}" for number in range(5))}
    outcome = run("simulate", folder, "-o", out, "--truth", code=0)
    assert outcome.err.count("JPG") == 3
    assert note in outcome.err
    assert set(contents(out)) == {f"{stem}.{ending}" for stem in stems for ending in ("dng", "truth.tif", "truth.png")}
    assert {Path(name).name for name in expand([str(folder)], out)[0]} == {
        "DSC_0_edited.tif",
        *(f"DSC_{number}.NEF" for number in range(5)),
    }
    assert expand([str(folder)], out)[1] == [note]
    assert expand([str(folder), str(folder / "DSC_1.JPG")], out)[0][-1] == str(folder / "DSC_1.JPG")
    run("simulate", folder / "DSC_1.JPG", "-o", out / "named", code=0)
    # What simulate has written is no scene, also where it lies beside its scenes.
    run("simulate", folder, "-o", folder, "--truth", code=0)
    assert {Path(name).suffix for name in expand([str(folder)], out)[0]} == {".NEF", ".tif"}
    inspected = run("inspect", folder, "--json", code=0).records
    assert [Path(record["source"]).name for record in inspected] == sorted(f"{stem}.dng" for stem in stems)
