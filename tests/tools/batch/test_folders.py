"""Which files a command finds in folders: the same for all commands."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from panchroma.tools.batch.folders import DNGS, Source, search
from panchroma.tools.evaluation.scene_sets import expand
from tests.tools.batch.examples import save_shot
from tests.tools.command import assert_refused, contents, run
from tests.tools.io.examples import picture_dng
from tests.tools.io.files import write_dng


def touch(top: Path, *names: str) -> None:
    for name in names:
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).touch()


def test_files_come_as_given_and_folders_in_order_with_all_below_them(tmp_path: Path) -> None:
    touch(tmp_path, "in/b.dng", "in/A.DNG", "in/sub/c.d.dng", "lone/z.dng")
    found = search([str(tmp_path / "lone/z.dng"), str(tmp_path / "in"), "missing.dng"], DNGS)
    assert (found.failures, found.left_out) == ([], [])
    below = [
        Source(f"{tmp_path}/in/{name}", Path(name)) for name in ("A.DNG", "b.dng", "sub/c.d.dng")
    ]
    assert found.sources == [Source(f"{tmp_path}/lone/z.dng"), *below, Source("missing.dng")]


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    texts = (f"{letter}.txt" for letter in "bcdef")
    touch(tmp_path, "a.dng", *texts, ".hidden.dng", ".git/x.dng", "out/y.dng", ".journal.jsonl")
    (tmp_path / "loop").symlink_to(tmp_path)
    found = search([str(tmp_path)], DNGS, output=tmp_path / "out")
    assert [source.name for source in found.sources] == [f"{tmp_path}/a.dng"]
    files, *folders = found.left_out[0].split("; ")
    assert files == f"{tmp_path}: left out .hidden.dng, b.txt, c.txt and 3 more files"
    assert set(folders) == {"1 hidden folder", "1 result folder", "1 linked folder"}


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
    for name in ("a.dng", "sub/a.dng"):
        save_shot(folder / name)
    (folder / "linear.dng").write_bytes(picture_dng(np.zeros((4, 4, 3), np.float32)))
    (folder / "notes.txt").write_text("no shot")
    return folder


@pytest.mark.parametrize("command", [("preview",), ("render", "--preset", "paper"), ("inspect",)])
def test_commands_take_a_folder_of_shots_alike(
    shots: Path, out: Path, command: tuple[str, ...]
) -> None:
    output = () if command == ("inspect",) else ("-o", out)
    outcome = run(*command, shots, *output, "--json", code=0)
    assert f"{shots}: left out notes.txt" in outcome.err
    assert "linear.dng: not a mosaic of Panchroma" in outcome.err
    foreign = {
        Path(each["source"]).relative_to(shots).as_posix(): "foreign" in each
        for each in outcome.records
    }
    assert foreign == {"a.dng": False, "sub/a.dng": False, "linear.dng": True}
    if output:
        made = {
            Path(name).with_suffix("").as_posix()
            for name in contents(out)
            if not name.startswith(".")
        }
        assert made == {"a", "sub/a"}
    # A file that the user names has to be a shot.
    named = run(*command, shots / "linear.dng", *output)
    assert_refused(named, "not a mosaic of Panchroma", name=str(shots / "linear.dng"))


def test_beside_a_camera_raw_a_picture_is_left_out_with_one_note_for_all_unless_it_is_named(
    tmp_path: Path, out: Path
) -> None:
    folder = tmp_path / "photographs"
    folder.mkdir()
    for number in range(5):
        write_dng(folder / f"DSC_{number}.NEF", np.full((108, 108), 300 + number, np.uint16))
        Image.new("RGB", (54, 54), (number, 9, 9)).save(folder / f"DSC_{number}.JPG")
    Image.new("RGB", (54, 54)).save(folder / "DSC_0_edited.tif")
    note = (
        f"{folder}: left out DSC_0.JPG, DSC_1.JPG, DSC_2.JPG and 2 more files beside a "
        "camera RAW of the same name"
    )
    stems = {"DSC_0_edited", *(f"DSC_{number}" for number in range(5))}
    outcome = run("simulate", folder, "-o", out, "--truth", code=0)
    assert outcome.err.count("JPG") == 3
    assert note in outcome.err
    assert set(contents(out)) == {
        f"{stem}.{ending}" for stem in stems for ending in ("dng", "truth.tif", "truth.png")
    }
    scenes, notes = expand([str(folder)], out)
    assert {Path(name).name for name in scenes} == {
        f"{stem}.NEF" for stem in stems if stem[-1] != "d"
    } | {"DSC_0_edited.tif"}
    assert notes == [note]
    assert expand([str(folder), str(folder / "DSC_1.JPG")], out)[0][-1] == str(folder / "DSC_1.JPG")
    run("simulate", folder / "DSC_1.JPG", "-o", out / "named", code=0)
    # What simulate has written is no scene, also where it lies beside its scenes.
    run("simulate", folder, "-o", folder, "--truth", code=0)
    assert {Path(name).suffix for name in expand([str(folder)], out)[0]} == {".NEF", ".tif"}
    inspected = run("inspect", folder, "--json", code=0).records
    assert [Path(record["source"]).name for record in inspected] == sorted(
        f"{stem}.dng" for stem in stems
    )
