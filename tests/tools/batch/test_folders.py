"""Which files a command finds in folders: the same for all commands."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from panchroma.tools.batch.folders import DNGS, Source, search
from panchroma.tools.batch.journal import NAME as JOURNAL
from panchroma.tools.evaluation.scene_sets import expand
from tests.tools.batch.examples import save_shot
from tests.tools.command import assert_refused, contents, names, run
from tests.tools.io.examples import picture_dng
from tests.tools.io.files import write_dng


def touch(top: Path, *names: str) -> None:
    for name in names:
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).touch()


def test_files_come_as_given_and_folders_in_order_with_all_below_them(tmp_path: Path) -> None:
    touch(tmp_path, "in/b.dng", "in/A.DNG", "in/sub/c.d.dng", "lone/z.dng")
    result = search([str(tmp_path / "lone/z.dng"), str(tmp_path / "in"), "missing.dng"], DNGS)
    assert (result.failures, result.left_out) == ([], [])
    names = ("A.DNG", "b.dng", "sub/c.d.dng")
    below = [Source(f"{tmp_path}/in/{name}", Path(name)) for name in names]
    assert result.sources == [Source(f"{tmp_path}/lone/z.dng"), *below, Source("missing.dng")]


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    texts = (f"{letter}.txt" for letter in "bcdef")
    touch(tmp_path, "a.dng", *texts, ".hidden.dng", ".git/x.dng", "out/y.dng", ".journal.jsonl")
    (tmp_path / "loop").symlink_to(tmp_path)
    result = search([str(tmp_path)], DNGS, output=tmp_path / "out")
    assert [source.name for source in result.sources] == [f"{tmp_path}/a.dng"]
    files, *folders = result.left_out[0].split("; ")
    assert files == f"{tmp_path}: left out .hidden.dng, b.txt, c.txt and 3 more files"
    assert set(folders) == {"1 hidden folder", "1 result folder", "1 linked folder"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_folder_that_cannot_be_read_has_failed(tmp_path: Path) -> None:
    touch(tmp_path, "a.dng", "closed/b.dng")
    (tmp_path / "closed").chmod(0)
    result = search([str(tmp_path)], DNGS)
    (tmp_path / "closed").chmod(0o700)
    assert [source.name for source in result.sources] == [f"{tmp_path}/a.dng"]
    assert result.failures == [(f"{tmp_path}/closed", "cannot be read (Permission denied)")]


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    """Shots in a folder and below, a linear DNG, which is none, and a text."""
    folder = tmp_path / "shots"
    for name in ("a.dng", "sub/a.dng"):
        save_shot(folder / name)
    (folder / "linear.dng").write_bytes(picture_dng(np.zeros((4, 4, 3), np.float32)))
    (folder / "notes.txt").write_text("no shot")
    return folder


@pytest.mark.parametrize(
    ("command", "ending"), [("preview", "jpg"), ("render --preset paper", "tif"), ("inspect", "")]
)
def test_commands_take_a_folder_of_shots_alike(
    shots: Path, out: Path, command: str, ending: str
) -> None:
    output = ("-o", out) if ending else ()
    outcome = run(command, shots, *output, "--json", code=0)
    assert f"{shots}: left out notes.txt" in outcome.err
    assert "linear.dng: not a mosaic of Panchroma" in outcome.err
    sources = [(record["source"], "foreign" in record) for record in outcome.records]
    assert sorted(sources) == [
        (f"{shots}/a.dng", False),
        (f"{shots}/linear.dng", True),
        (f"{shots}/sub/a.dng", False),
    ]
    if ending:
        assert {f"a.{ending}", f"sub/a.{ending}"} == contents(out).keys() - {JOURNAL}
    # A file that the user names has to be a shot.
    named = run(command, shots / "linear.dng", *output)
    assert_refused(named, "not a mosaic of Panchroma", name=str(shots / "linear.dng"))


def test_beside_a_camera_raw_a_picture_is_left_out_with_one_note_for_all_unless_it_is_named(
    tmp_path: Path, out: Path
) -> None:
    folder = tmp_path / "photographs"
    folder.mkdir()
    for number in range(4):
        write_dng(folder / f"DSC_{number}.NEF", np.full((108, 108), 300 + number, np.uint16))
        Image.new("RGB", (54, 54), (number, 9, 9)).save(folder / f"DSC_{number}.JPG")
    Image.new("RGB", (54, 54)).save(folder / "DSC_0_edited.tif")
    left_out = "DSC_0.JPG, DSC_1.JPG, DSC_2.JPG and 1 more files"
    note = f"{folder}: left out {left_out} beside a camera RAW of the same name"
    raws = {f"DSC_{number}.NEF" for number in range(4)}
    stems = {"DSC_0_edited", *(Path(raw).stem for raw in raws)}
    # What simulate has written is no scene, also where it lies beside its scenes.
    outcome = run("simulate", folder, "-o", folder, "--truth", code=0)
    assert outcome.err.count("JPG") == 3
    assert note in outcome.err
    endings = ("dng", "truth.tif", "truth.png")
    assert {f"{stem}.{ending}" for stem in stems for ending in endings} <= names(folder)
    scenes, _ = expand([str(folder), str(folder / "DSC_1.JPG")], out)
    assert {Path(name).name for name in scenes} == raws | {"DSC_0_edited.tif", "DSC_1.JPG"}
    run("simulate", folder / "DSC_1.JPG", "-o", out, code=0)
