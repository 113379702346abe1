"""`render --resume`: what is current stays as it is, what is ours and is not is made anew, and what
is a user's is never lost.

The journal: what was written is read, by others too, a cut-off line costs nothing but itself;
and what its keys depend on.
"""

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from time import sleep
from typing import Any
from unittest.mock import Mock

import pytest

from panchroma import offline
from panchroma.shared import Camera, CfaPattern, OutputError, SensorCalibration, Shading, read_dng
from panchroma.shared.calibration import NoiseModel
from panchroma.shared.writing import write_durably
from panchroma.tools.batch import order as attempt
from panchroma.tools.batch.burst_files import BurstOrder
from panchroma.tools.batch.chosen_white import WhiteBalance
from panchroma.tools.batch.jobs import Job, planned
from panchroma.tools.batch.journal import NAME, Entry, Journal, digest, output_lock
from panchroma.tools.batch.order import Order, Run
from panchroma.tools.batch.progress import StageProgress
from panchroma.tools.io.kind import PictureKind
from tests.tools.batch.examples import save_shot
from tests.tools.command import Outcome, assert_refused, contents, results, run
from tests.walking import one_field_changed

# --- resume ---------------------------------------------------------------------------------------


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
    assert "the limit of 220;" in run("evaluate builtin:60x60 -o", out, code=1).err
    refused = run("calibrate", shots, "-o", out / "camera.json", code=1)
    assert "the limit is 220" in refused.err


def test_a_changed_shot_is_rendered_anew_and_a_touched_one_is_not(shots: Path, out: Path) -> None:
    render(shots, out)
    for seed in (8, 9):
        (shots / "a.dng").unlink()
        save_shot(shots / "a.dng", seed)
        os.utime(shots / "b.dng")
        assert current(render(shots, out, "--resume", "--dry-run")) == {"b.tif", "c.tif"}
        assert current(render(shots, out, "--resume")) == {"b.tif", "c.tif"}
    # the old a.tif was ours to the byte: no copy of it
    assert results(out) == {"a.tif", "b.tif", "sub"}


def edited_in_place(path: Path) -> None:
    """Change the last byte and set the time of modification back, as `exiftool -P` and rsync do."""
    before, data = path.stat(), path.read_bytes()
    path.write_bytes(data[:-1] + bytes([data[-1] ^ 255]))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert path.stat().st_mtime_ns == before.st_mtime_ns


@pytest.mark.usefixtures("links")
def test_a_changed_picture_is_made_anew_and_the_old_kept(shots: Path, out: Path) -> None:
    """Twice: the second copy replaces neither the first one nor a link to nowhere."""
    render(shots, out)
    (out / "a.tif.bak2").symlink_to("nowhere")
    made, copies = (out / "a.tif").read_bytes(), []
    for name in ("a.tif.bak", "a.tif.bak3"):
        edited_in_place(out / "a.tif")
        copies.append((out / "a.tif").read_bytes())
        outcome = render(shots, out, "--resume")
        assert (outcome.code, current(outcome)) == (0, {"b.tif", "c.tif"})
        assert f"a.tif: has changed since it was made; it is kept as {name}" in outcome.err
        assert (out / "a.tif").read_bytes() == made
    assert [(out / name).read_bytes() for name in ("a.tif.bak", "a.tif.bak3")] == copies
    assert (out / "a.tif.bak2").is_symlink()


def test_a_shot_that_was_edited_with_its_size_and_time_counts(
    shots: Path, out: Path, tmp_path: Path
) -> None:
    with (shots / "b.dng").open("ab") as file:
        file.write(b"\0")  # belongs to no sample
    burst = ("burst", shots / "a.dng", shots / "b.dng", "-o", tmp_path / "one", "--json --resume")
    render(shots, out)
    run(*burst, code=0)
    assert current(run(*burst, code=0)) == {"a.tif"}
    edited_in_place(shots / "b.dng")
    assert current(render(shots, out, "--resume")) == {"a.tif", "c.tif"}
    assert current(run(*burst, code=0)) == set()


def test_a_file_that_no_render_made_stays(shots: Path, out: Path) -> None:
    (out / "a.tif").write_text("mine")
    words = "exists already, and no run noted that it made it"
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


def test_what_a_process_has_made_before_it_was_killed_is_no_failure(shots: Path, out: Path) -> None:
    """Another process of the same run is given its shot."""
    order = Order(**WHOLE | {"folder": out, "camera": None, "white": WhiteBalance()})
    job = Job(str(shots / "a.dng"), (out / "a.jpg",))
    outcomes = [attempt.attempt(order, 2**40, 1, job, StageProgress()) for _ in range(2)]
    found = [(made.state, made.facts.get("current")) for made in outcomes]
    assert found == [("made", None), ("made", True)]


def test_a_picture_of_another_shot_of_the_same_name_is_not_replaced(
    shots: Path, out: Path, tmp_path: Path
) -> None:
    render(shots, out)
    made = contents(out)
    save_shot(tmp_path / "more" / "a.dng", 7)
    outcome = run("render", tmp_path / "more", "-o", out, "--resume")
    assert_refused(outcome, f"is the result of {shots / 'a.dng'}", name=str(out / "a.tif"))
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


# --- journal --------------------------------------------------------------------------------------


def entry(output: str = "a.tif", digest: str = "d") -> Entry:
    return Entry(output, digest, "k", "r", "a.dng", "i")


def test_what_is_appended_is_found_by_all_who_hold_it(tmp_path: Path) -> None:
    one, other = Journal(tmp_path), Journal(tmp_path)
    assert one.of("a.tif") == []
    assert not (tmp_path / NAME).exists()
    other.append(entry())
    assert one.of("a.tif") == [entry()]
    other.append(entry(digest="e"))
    one.append(entry("sub/\udce9 x.tif"))
    assert one.of("a.tif") == [entry(), entry(digest="e")]
    assert other.of("sub/\udce9 x.tif") == [entry("sub/\udce9 x.tif")]


@pytest.mark.parametrize("kept", [1, 40, -1])
def test_a_torn_line_is_no_entry_and_spoils_none(tmp_path: Path, kept: int) -> None:
    path = tmp_path / NAME
    reader = Journal(tmp_path)
    for name in ("a.tif", "b.tif"):
        Journal(tmp_path).append(entry(name))
    first, second = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + second[:kept])
    assert reader.of("b.tif") == []
    Journal(tmp_path).append(entry("c.tif"))
    there = [bool(reader.of(name)) for name in ("a.tif", "b.tif", "c.tif")]
    assert there == [True, kept == -1, True]


@pytest.mark.parametrize(
    "line",
    [b"[1]", b"{}", b'{"format": 2}', b"\xff\0", b"[" * 9999, b'{"format": 1, "output": 3}', b""],
)
def test_lines_of_others_are_not_believed(tmp_path: Path, line: bytes) -> None:
    (tmp_path / NAME).write_bytes(line + b"\n")
    journal = Journal(tmp_path)
    journal.append(entry())
    assert journal.of("a.tif") == [entry()]


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_a_link_in_the_place_of_the_journal_changes_no_original(
    tmp_path: Path, link: Callable[[Path, Path], None]
) -> None:
    original = tmp_path / "shot.dng"
    original.write_bytes(b"a photograph")
    link(tmp_path / NAME, original)
    with pytest.raises(OutputError, match=r"remove it|replace it by a copy"):
        Journal(tmp_path).append(entry())
    assert original.read_bytes() == b"a photograph"


def test_a_link_in_the_place_of_a_lock_makes_nothing(tmp_path: Path) -> None:
    with output_lock(tmp_path / "a.tif"):
        (lock,) = tmp_path.iterdir()
    lock.symlink_to("elsewhere")
    with pytest.raises(OSError, match="remove it"), output_lock(tmp_path / "a.tif"):
        pass
    assert not (tmp_path / "elsewhere").exists()


def test_a_digest_is_that_of_every_byte(tmp_path: Path) -> None:
    (tmp_path / "one").write_bytes(b"12")
    assert digest(tmp_path / "one") == hashlib.sha256(b"12").hexdigest()
    for path in (tmp_path, tmp_path / "none", "/dev/zero", "x" * 300, "nul\0"):
        assert digest(path) is None


def test_never_two_makers_whoever_removes_the_lock_file(tmp_path: Path) -> None:
    """Waiters who get the lock on a file that has been removed meanwhile have a lock on nothing;
    one that a dead process left is taken over.
    """
    inside, turns, output = list[int](), list[int](), tmp_path / ("x" * 250)
    with output_lock(output):
        (left,) = tmp_path.iterdir()
    left.touch()

    def work(maker: int) -> None:
        for _ in range(100):
            with output_lock(output):
                inside.append(maker)
                turns.append(len(inside))
                inside.pop()

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(4)))
    assert turns == [1] * 400
    assert list(tmp_path.iterdir()) == []


def test_two_that_make_files_share_a_folder(out: Path) -> None:
    """Each finds what the other has made."""

    def work(job: Job, listener: StageProgress, keep: attempt.Keep) -> Any:
        sleep(0.1)
        write_durably(job.output, b"made", **keep(job.output))
        return planned(job)

    def made(name: str) -> str:
        run = Run(folder=out, run=name, made_by="", resume=True)
        job = Job("builtin:24x18", (out / "sub" / "a.dng",))
        return attempt.kept(run, work, job, StageProgress()).state

    with ThreadPoolExecutor(2) as pool:
        assert set(pool.map(made, "12")) == {"planned", "current"}
    assert results(out / "sub") == {"a.dng"}


def test_a_line_that_no_render_has_written_ends_the_reading(tmp_path: Path) -> None:
    with (tmp_path / NAME).open("wb") as file:
        file.truncate(3 << 30)
    with pytest.raises(OSError, match="65536 bytes or more"):
        Journal(tmp_path).of("a.tif")


# --- keys ----------------------------------------------------------------------------------------

EVEN = Shading((((1.0,) * 4,) * 4,) * 4, (13, 17), 35, 0.01)
CALIBRATION = SensorCalibration.of_bits(12, noise=NoiseModel.gaussian(0.01, 4), shading=EVEN)
CAMERA = Camera(CALIBRATION, CfaPattern.bayer(), {"shading": {"frames": 4}}, (13, 17))
KIND, BALANCE = PictureKind("jpg", 8, "srgb", 90), WhiteBalance("", (1.0, 2.0, 1.0))
WHOLE: dict[str, Any] = {"folder": Path("out"), "preset": "best", "exposure": 0.5, "run": "1"}
WHOLE |= {"kind": KIND, "camera": CAMERA, "white": BALANCE}
ORDERS = [Order(**WHOLE), BurstOrder(**WHOLE, reference=1, shifts=((0.0, 0.0), (1.0, 0.0)))]
# In which nothing of a picture shows.
LIMITS = {"folder", "run", "resume", "overwrite", "dry_run", "made_by", "outputs"}
NO_MATTER = {Order: LIMITS | {"max_pixels"}, BurstOrder: LIMITS}


def key_of(order: Order) -> str:
    return order.key(Path(order.folder) / "a.jpg", "")


@pytest.mark.parametrize("order", ORDERS)
def test_every_field_that_changes_a_picture_changes_its_key(
    order: Order, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(offline.PRESETS, "changed", offline.PAPER)  # whose name it is
    keys = {name: _key_in(order.folder, other) for name, other in one_field_changed(order)}
    assert {"camera.measured", "kind.quality", "white.kind"} <= keys.keys()
    whole = key_of(order)
    same = {name for name, key in keys.items() if key == whole}
    assert same == NO_MATTER[type(order)] == order.no_matter
    # no two of them are the same either
    assert len({*keys.values()} - {whole}) == len(keys) - len(same)


def _key_in(folder: Path, order: Order) -> str:
    """The key of an order, wherever its folder is."""
    object.__setattr__(order, "folder", folder)
    return key_of(order)


def test_every_setting_of_the_render_changes_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = {key_of(Order(**WHOLE))}
    settings = dict(one_field_changed(offline.BEST))
    names = {field.name for field in fields(offline.BEST)}
    assert names == {name.partition(".")[0] for name in settings}
    for other in settings.values():
        monkeypatch.setitem(offline.PRESETS, "best", other)
        keys.add(key_of(Order(**WHOLE)))
    monkeypatch.setattr("panchroma.offline.version.ALGORITHM", -1)
    keys.add(key_of(Order(**WHOLE)))
    assert len(keys) == len(settings) + 2
