"""`render --resume`: what is current stays as it is, what is ours and is not is made anew, and what
is a user's is never lost.
"""

import os
import shutil
from pathlib import Path
from unittest.mock import Mock

import pytest

from panchroma.shared import read_dng
from panchroma.tools.batch import order as attempt
from panchroma.tools.batch.journal import NAME, digest
from tests.tools.batch.examples import save_shot
from tests.tools.command import Outcome, assert_refused, contents, results, run


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    """A folder of three shots, one of them in a folder below it."""
    for seed, name in enumerate(("a.dng", "b.dng", "sub/c.dng")):
        save_shot(tmp_path / "shots" / name, seed)
    return tmp_path / "shots"


def render(shots: Path, out: Path, *options: str) -> Outcome:
    return run("render", shots, "-o", out, "--json", *options)


def current(outcome: Outcome) -> set[str]:
    """Names of the pictures that were there already; fails when a record is not ok."""
    assert all(record["ok"] for record in outcome.records), outcome.err
    return {Path(record["output"]).name for record in outcome.records if record.get("current")}


def test_a_folder_is_rendered_and_then_current(shots: Path, out: Path) -> None:
    before = contents(shots)
    (out / "sub").mkdir()
    # of killed processes
    for name in (".a.tif.01234567.panchroma.part", "sub/.c.tif.01234567.panchroma.lock"):
        (out / name).touch()
    outcome = render(shots, out)
    assert (outcome.code, current(outcome)) == (0, set())
    assert set(contents(out)) == {"a.tif", "b.tif", "sub/c.tif", NAME}
    made = contents(out)
    again = render(shots, out, "--resume")
    assert (again.code, current(again)) == (0, {"a.tif", "b.tif", "c.tif"})
    assert "3 up to date" in again.err
    assert contents(out) == made
    assert contents(shots) == before
    assert render(shots, out).code == 1  # without --resume nothing that exists is accepted
    assert contents(out) == made


def test_a_limit_holds_in_every_process(
    shots: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PANCHROMA_MAX_PIXELS", "220")
    outcome = render(shots, out, "--jobs", "2")
    assert (outcome.code, outcome.err.count("the limit is 220")) == (1, 3), outcome.err


def test_a_shot_that_has_changed_is_rendered_anew_and_a_touched_one_is_not(
    shots: Path, out: Path
) -> None:
    render(shots, out)
    for seed in (8, 9):
        (shots / "a.dng").unlink()
        save_shot(shots / "a.dng", seed)
        os.utime(shots / "b.dng")
        assert current(render(shots, out, "--resume")) == {"b.tif", "c.tif"}
    # the old a.tif was ours to the byte: no copy of it
    assert results(out) == {"a.tif", "b.tif", "sub"}


@pytest.mark.parametrize("damage", ["torn", "retouched", "empty"])
def test_one_that_has_changed_is_made_anew_and_what_it_was_is_kept(
    shots: Path, out: Path, damage: str
) -> None:
    render(shots, out)
    made = contents(out)
    old = {"torn": made["a.tif"][:99], "retouched": made["a.tif"] + b"!", "empty": b""}[damage]
    for name in ("a.tif.bak", "a.tif.bak2"):  # twice: the first copy is not replaced by the second
        (out / "a.tif").write_bytes(old + name.encode())
        outcome = render(shots, out, "--resume")
        assert (outcome.code, current(outcome)) == (0, {"b.tif", "c.tif"})
        assert f"a.tif: has changed since it was made; it is kept as {name}" in outcome.err
        assert (out / "a.tif").read_bytes() == made["a.tif"]
    for name in ("a.tif.bak", "a.tif.bak2"):
        assert (out / name).read_bytes() == old + name.encode()


def test_a_file_that_no_render_made_stays(shots: Path, out: Path) -> None:
    (out / "a.tif").write_text("mine")
    words = "exists already, and no render noted that it made it"
    assert_refused(render(shots, out, "--resume"), words, name=str(out / "a.tif"))
    assert (out / "a.tif").read_text() == "mine"
    assert results(out) == {"a.tif", "b.tif", "sub"}
    assert render(shots, out, "--resume", "--overwrite").code == 0
    assert (out / "a.tif").read_bytes()[:4] == b"II*\0"
    assert results(out) == {"a.tif", "b.tif", "sub"}


def test_a_run_cut_off_between_journal_and_picture_goes_on(
    shots: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the one moment when a line is there and its file is not, and again when the file it
    replaces still is.
    """
    cut = Mock(side_effect=KeyboardInterrupt)
    with monkeypatch.context() as patched:
        patched.setattr(os, "link", cut)
        assert render(shots, out).code == 130
    assert results(out) == set()
    assert current(render(shots, out, "--resume")) == set()
    old = contents(out)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", cut)
        assert render(shots, out, "--resume", "--exposure", "1").code == 130
    assert contents(out) | {NAME: b""} == old | {NAME: b""}
    assert current(render(shots, out, "--resume", "--exposure", "1")) == set()
    assert set(contents(out)) == set(old)  # no copies: what was replaced was ours


def test_a_picture_of_another_shot_of_the_same_name_is_not_replaced(
    shots: Path, out: Path, tmp_path: Path
) -> None:
    render(shots, out)
    made = contents(out)
    save_shot(tmp_path / "more" / "a.dng", 7)
    outcome = run("render", tmp_path / "more", "-o", out, "--resume")
    assert_refused(outcome, f"is the picture of {shots / 'a.dng'}", name=str(out / "a.tif"))
    assert contents(out) == made
    shots.rename(tmp_path / "moved")  # but a folder of shots may move, and that of the pictures
    out = out.rename(tmp_path / "pictures")
    assert current(render(tmp_path / "moved", out, "--resume")) == {"a.tif", "b.tif", "c.tif"}
    outcome = render(tmp_path / "moved", out, "--resume", "--exposure", "1")
    assert (outcome.code, current(outcome)) == (0, set())


def test_a_shot_that_changes_while_it_is_read_is_refused(
    shots: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def late(path: str, max_pixels: int) -> object:
        mosaic = read_dng(path, max_pixels=max_pixels)
        Path(path).write_bytes(Path(path).read_bytes() + b"!")
        return mosaic

    monkeypatch.setattr("panchroma.tools.batch.order.read_dng", late)
    outcome = run("render", shots / "a.dng", "-o", out)
    assert_refused(outcome, "has changed while it was read", name=str(shots / "a.dng"))
    assert results(out) == set()


def read_files(monkeypatch: pytest.MonkeyPatch, shots: Path, out: Path) -> list[str]:
    """Names of the files that --resume reads to find that all pictures are current."""
    read: list[str] = []
    with monkeypatch.context() as patched:

        def noted(path: Path | str) -> str | None:
            read.append(Path(path).name)
            return digest(path)

        patched.setattr(attempt, "digest", noted)
        assert current(render(shots, out, "--resume")) == {"a.tif", "b.tif", "c.tif"}
    return sorted(read)


def test_what_has_its_size_and_times_is_not_read(
    shots: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    render(shots, out)
    for _ in range(2):
        assert read_files(monkeypatch, shots, out) == []
    os.utime(shots / "a.dng")
    (out / "c.link").hardlink_to(out / "sub" / "c.tif")
    assert read_files(monkeypatch, shots, out) == ["a.dng", "a.tif", "c.dng", "c.tif"]
    assert read_files(monkeypatch, shots, out) == []


def test_a_copied_archive_is_read_once_and_nothing_is_rendered(
    shots: Path, out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    render(shots, out)
    for folder in (shots, out):
        shutil.copytree(folder, tmp_path / "disk" / folder.name)  # with the times of modification
    copies = tmp_path / "disk" / "shots", tmp_path / "disk" / "out"
    dry = render(*copies, "--resume", "--dry-run")
    assert current(dry) == {"a.tif", "b.tif", "c.tif"}
    every = sorted(f"{name}.{ending}" for name in "abc" for ending in ("dng", "tif"))
    assert read_files(monkeypatch, *copies) == every
    assert read_files(monkeypatch, *copies) == []


def edited_in_place(path: Path, place: int) -> None:
    """Change a byte and set the time of modification back, as `exiftool -P` and rsync do."""
    before = path.stat()
    with path.open("r+b") as file:
        file.seek(place)
        (byte,) = file.read(1)
        file.seek(place)
        file.write(bytes([byte ^ 255]))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    after = path.stat()
    assert (after.st_size, after.st_mtime_ns) == (before.st_size, before.st_mtime_ns)


@pytest.mark.parametrize("how", ["rewritten", "replaced"])
def test_a_shot_that_was_edited_with_its_size_and_time_is_rendered_anew(
    shots: Path, out: Path, tmp_path: Path, how: str
) -> None:
    path, other = shots / "a.dng", tmp_path / "other.dng"
    save_shot(other, 9)
    whole = max(path.stat().st_size, other.stat().st_size)
    for shot in (path, other):  # of one size
        shot.write_bytes(shot.read_bytes().ljust(whole, b"\0"))
    render(shots, out)
    old, status = (out / "a.tif").read_bytes(), path.stat()
    if how == "replaced":
        other.replace(path)
    else:
        path.write_bytes(other.read_bytes())
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert path.stat().st_mtime_ns == status.st_mtime_ns
    assert current(render(shots, out, "--resume")) == {"b.tif", "c.tif"}
    assert (out / "a.tif").read_bytes() != old


def test_a_picture_that_was_edited_with_its_size_and_time_is_kept_as_a_copy(
    shots: Path, out: Path
) -> None:
    render(shots, out)
    made = (out / "a.tif").read_bytes()
    edited_in_place(out / "a.tif", len(made) // 2)
    edited = (out / "a.tif").read_bytes()
    outcome = render(shots, out, "--resume")
    assert current(outcome) == {"b.tif", "c.tif"}
    assert "a.tif: has changed since it was made; it is kept as a.tif.bak" in outcome.err
    assert (out / "a.tif").read_bytes() == made
    assert (out / "a.tif.bak").read_bytes() == edited


def test_a_frame_of_a_burst_that_was_edited_with_its_size_and_time_counts(
    shots: Path, out: Path
) -> None:
    burst = (str(shots / "a.dng"), str(shots / "b.dng"), "-o", str(out), "--json", "--resume")
    run("burst", *burst, code=0)
    assert current(run("burst", *burst, code=0)) == {"a.tif"}
    size = (shots / "b.dng").stat().st_size
    edited_in_place(shots / "b.dng", size - 1)
    outcome = run("burst", *burst)
    assert not any(record.get("current") for record in outcome.records)
