"""Which files a command finds in folders: the same for all commands.

Which shots are one burst.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from panchroma.shared.errors import InputError
from panchroma.tools.batch.burst_files import series, series_stem
from panchroma.tools.batch.folders import DNGS, Source, search
from panchroma.tools.batch.journal import NAME as JOURNAL
from panchroma.tools.evaluation.scene_sets import expand
from tests.tools.batch.examples import save_shot
from tests.tools.command import assert_refused, contents, run
from tests.tools.io.examples import picture_dng

# --- folders --------------------------------------------------------------------------------------


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
    remark, others = result.left_out
    files, *folders = remark.split("; ")
    assert files == f"{tmp_path}: left out .hidden.dng, b.txt, c.txt and 3 more files"
    assert set(folders) == {"1 result folder", "1 linked folder"}
    where = f"{tmp_path}/.git, hidden or of other programs"
    assert others == f"left out 1 file in {where}; name such a folder to take its files"


OF_OTHERS = (
    *("@eaDir/b.dng", "@tmp", "#recycle", "#snapshot/daily", "@Recycle", "$RECYCLE.BIN/S-1-5"),
    *("$Recycle.Bin", "__MACOSX", "lost+found", "System Volume Information", "~snapshot"),
    *(".Trash", ".Trash-1000/files", ".thumbnails", ".snapshot", ".AppleDouble", ".stversions"),
    *(".sync", ".picasaoriginals", "picasaoriginals", "CaptureOne/Cache"),
    *("Trip Previews.lrdata/0", "Photos Library.photoslibrary"),
)


@pytest.mark.parametrize("place", ["", "2019/", "@home/#1/"])
@pytest.mark.parametrize("folder", OF_OTHERS)
def test_thumbnails_and_deleted_files_are_taken_only_from_a_folder_that_is_named(
    tmp_path: Path, folder: str, place: str
) -> None:
    touch(tmp_path, f"{place}a.dng", *(f"{place}{folder}/{name}.DNG" for name in "bc"))
    touch(tmp_path, f"{place}.fine/d.txt")  # of which nothing is left out
    result = search([str(tmp_path)], DNGS)
    assert [source.name for source in result.sources] == [f"{tmp_path}/{place}a.dng"]
    (remark,) = result.left_out
    top = Path(folder).parts[0]
    assert remark.startswith(f"left out 2 files in {tmp_path}/{place}{top}, hidden or of other")
    named = search([f"{tmp_path}/{place}{folder}"], DNGS)
    assert [Path(source.name).name for source in named.sources] == ["b.DNG", "c.DNG"]
    assert named.left_out == []


def test_one_remark_counts_what_is_left_out_in_all_folders(tmp_path: Path) -> None:
    thumbnails = (f"{top}/@eaDir/{top}{number}.dng" for top in "ab" for number in (1, 2))
    touch(tmp_path, "a/1.dng", "b/2.dng", *thumbnails)
    touch(tmp_path, *(f"b/.snapshot/{number}.dng" for number in range(2000)))
    (tmp_path / "a/.link").symlink_to(tmp_path / "b")
    result = search([f"{tmp_path}/a", f"{tmp_path}/b"], DNGS)
    places = ", ".join(f"{tmp_path}/{place}" for place in ("a/@eaDir", "b/.snapshot"))
    linked, others = result.left_out
    assert linked == f"{tmp_path}/a: left out 1 linked folder"
    assert others.startswith(f"left out 1000 or more files in {places}, hidden")


def test_a_file_counts_once_however_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    touch(tmp_path, "in/x.dng", "in/sub/y.dng")
    (tmp_path / "in/latest.dng").symlink_to("x.dng")
    (tmp_path / "in/a-link.dng").symlink_to("sub/y.dng")
    (tmp_path / "there").symlink_to("in")
    (tmp_path / "in/hard.dng").hardlink_to(tmp_path / "in/x.dng")
    monkeypatch.chdir(tmp_path / "in")
    x = ["x.dng", "./x.dng", f"{tmp_path}/there/x.dng", "latest.dng", "sub/../x.dng", "x.dng"]
    assert search(x, DNGS).sources == [Source("x.dng")]
    found = [Source(f"../in/{name}", Path(name)) for name in ("hard.dng", "x.dng", "a-link.dng")]
    assert search(["../in", *x, ".", "../there/sub"], DNGS).sources == found
    named = search(["sub/y.dng", "../in", "none.dng", "none.dng"], DNGS).sources
    assert named == [Source("sub/y.dng"), *found[:2], Source("none.dng")]


@pytest.mark.parametrize("other", ["SHOT \u00c9.dng", "shot e\u0301.DNG"])
def test_a_disk_may_take_other_names_for_the_same(
    tmp_path: Path, other: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hard link stands for the other name that such a disk takes for the file's."""
    name = "shot \u00e9.dng"
    touch(tmp_path, name)
    (tmp_path / other).hardlink_to(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert search([name, other], DNGS).sources == [Source(name)]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_folder_that_cannot_be_read_has_failed_unless_it_is_the_systems(tmp_path: Path) -> None:
    touch(tmp_path, "a.dng", "closed/b.dng", "lost+found/c.dng")
    closed = [tmp_path / name for name in ("closed", "lost+found")]
    for folder in closed:
        folder.chmod(0)
    result = search([str(tmp_path)], DNGS)
    for folder in closed:
        folder.chmod(0o700)
    assert [source.name for source in result.sources] == [f"{tmp_path}/a.dng"]
    assert result.failures == [(f"{tmp_path}/closed", "cannot be read (Permission denied)")]
    assert result.left_out == []


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
    found = (("a", False), ("linear", True), ("sub/a", False))
    assert sorted(sources) == [(f"{shots}/{name}.dng", foreign) for name, foreign in found]
    if ending:
        assert {f"a.{ending}", f"sub/a.{ending}"} == contents(out).keys() - {JOURNAL}
    # A file that the user names has to be a shot.
    named = run(command, shots / "linear.dng", *output)
    assert_refused(named, "not a mosaic of Panchroma", name=str(shots / "linear.dng"))


def test_beside_a_camera_raw_a_picture_is_left_out_with_one_note_for_all_unless_it_is_named(
    tmp_path: Path, out: Path
) -> None:
    pairs = (f"DSC_{number}.{ending}" for number in range(4) for ending in ("NEF", "JPG"))
    touch(tmp_path, *pairs, "DSC_0_edited.tif")
    left_out = "DSC_0.JPG, DSC_1.JPG, DSC_2.JPG and 1 more files"
    note = f"{tmp_path}: left out {left_out} beside a camera RAW of the same name"
    assert note in run("simulate", tmp_path, "-o", out, code=1).err
    scenes, (remark,) = expand([str(tmp_path), str(tmp_path / "DSC_1.JPG")], out)
    assert remark.startswith(note)
    raws = {f"DSC_{number}.NEF" for number in range(4)}
    assert {Path(name).name for name in scenes} == raws | {"DSC_0_edited.tif", "DSC_1.JPG"}


# --- burst files ----------------------------------------------------------------------------------


def sources_in(folder: Path, *names: str) -> list[Source]:
    touch(folder, *names)
    return search([str(folder)], DNGS).sources


def test_a_folder_s_frames_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = ("rose-2.dng", "rose-10.dng", "rose-1.DNG", "rose.truth.tif", "rose.motion.json")
    ordered = [str(tmp_path / name) for name in ("rose-1.DNG", "rose-2.dng", "rose-10.dng")]
    assert series(sources_in(tmp_path, *names)) == ordered


def test_files_that_are_named_are_taken_as_they_are() -> None:
    names = ["b.dng", "a-7.dng", "c/a-1.dng"]
    assert series(list(map(Source, names))) == names


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("a-1.dng a-2.dng dark.dng", "of 2: {0}/a-1.dng, {0}/dark.dng; name the files of one"),
        ("a-2.dng a-1.dng more/a-1.dng", "of 2: {0}/a-1.dng, {0}/more/a-1.dng; name"),
        ("a.dng b.dng c.dng d.dng e.dng f.dng", "of 6: .*, {0}/d.dng; name"),
    ],
)
def test_what_is_not_one_burst_is_named(tmp_path: Path, names: str, words: str) -> None:
    with pytest.raises(InputError, match=words.format(tmp_path)):
        series(sources_in(tmp_path, *names.split()))


@pytest.mark.parametrize(
    ("names", "stem"),
    [
        ("in/a-1.dng in/a-2.dng", "a"),
        ("b/a-7.dng c/a-1.dng", "a"),
        ("a-1.dng b.dng", "a-1"),
        ("b.dng a-1.dng", "b"),
        ("a-b-01.dng a-b-10.dng", "a-b"),
    ],
)
def test_a_picture_is_called_by_what_its_frames_have_in_common(names: str, stem: str) -> None:
    assert series_stem(names.split()) == stem
