import errno
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta, timezone
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from panchroma.device.capture.shots import ShotFolder
from panchroma.shared import ByteArray, Mosaic, OutputError, read_dng, writing
from tests.shared.dng.examples import mosaic, preview, same

TAKEN = datetime(2026, 3, 9, 7, 5, 1, 20900, tzinfo=UTC)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def save(shots: ShotFolder, taken: datetime = TAKEN) -> Path:
    return shots.save(mosaic(), preview(), taken)


def test_a_shot_is_named_by_its_time_and_a_counter_that_survives_a_restart(tmp_path: Path) -> None:
    first = save(ShotFolder(tmp_path))
    assert first == tmp_path / "20260309T070501.020Z-000001.dng"
    assert same(read_dng(first), mosaic())
    there = save(ShotFolder(tmp_path), TAKEN.astimezone(timezone(timedelta(hours=9))))
    assert there.name == "20260309T070501.020Z-000002.dng"
    (tmp_path / "20260309T070501.020Z-000090.dng.txt").touch()  # not a shot
    (tmp_path / "90.dng").touch()
    early = save(ShotFolder(tmp_path), datetime(1970, 1, 1, tzinfo=UTC))
    assert early.name == "19700101T000000.000Z-000003.dng"
    (tmp_path / "20260309T070501.020Z-1000000.dng").touch()
    assert save(ShotFolder(tmp_path)).name.endswith("Z-1000001.dng")


def burst(shots: ShotFolder, count: int, meanwhile: Callable[[], object] = bool) -> list[Path]:
    """Save a burst; meanwhile: called while its last frame is made."""

    def frames() -> Iterator[tuple[Mosaic, ByteArray]]:
        for number in range(count):
            if number == count - 1:
                meanwhile()
            yield mosaic(), preview()

    return shots.burst(frames, count, TAKEN)


def test_bursts_of_two_cameras_have_one_name_and_one_count_each(tmp_path: Path) -> None:
    one, other = ShotFolder(tmp_path), ShotFolder(tmp_path)
    others: list[Path] = []

    def once() -> None:  # the other takes the name while the first one's frames are written
        if not others:
            others.extend(burst(other, 10))

    saved = [path.name for path in burst(one, 10, once)]
    for shot, paths in ((1, [path.name for path in others]), (2, saved)):
        stem = f"20260309T070501.020Z-00000{shot}"
        assert paths == [f"{stem}-{number:02}.dng" for number in range(1, 11)]
    assert names(tmp_path) == sorted([*saved, *(path.name for path in others)])
    assert save(ShotFolder(tmp_path)).name == "20260309T070501.020Z-000003.dng"


def test_a_later_frame_of_a_burst_replaces_no_file(tmp_path: Path) -> None:
    shots, precious = ShotFolder(tmp_path), tmp_path / "20260309T070501.020Z-000001-2.dng"
    saved = burst(shots, 2, lambda: precious.write_text("precious"))
    assert precious.read_text() == "precious"
    assert names(tmp_path) == sorted([precious.name, *(path.name for path in saved)])
    assert same(read_dng(saved[1]), mosaic())


@pytest.mark.parametrize("call", range(12))
def test_a_disk_that_is_full_at_any_moment_leaves_nothing_of_a_burst(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: int
) -> None:
    """Where files are written, and where they get their names, too: some file systems find room
    only then.
    """
    calls, real = count(), {name: getattr(os, name) for name in ("fsync", "link")}

    def full(name: str, *arguments: Any) -> None:
        if next(calls) == call:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real[name](*arguments)

    for name in real:
        monkeypatch.setattr(os, name, partial(full, name))
    monkeypatch.setattr(writing, "sync_folder", bool)
    with suppress(OutputError):  # without hard links files are renamed
        burst(ShotFolder(tmp_path), 4)
    assert len(names(tmp_path)) in (0, 4)


@pytest.mark.parametrize("links", range(4))
def test_a_burst_that_has_its_first_frame_is_whole_after_the_program_was_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: int
) -> None:
    def link(*arguments: Any) -> None:
        if next(made) == links:
            os._exit(9)
        real(*arguments)

    made, real = count(), os.link
    if not (child := os.fork()):
        monkeypatch.setattr(os, "link", link)
        burst(ShotFolder(tmp_path), 4)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    writing.sweep(tmp_path)
    stem = "20260309T070501.020Z-000001"
    assert names(tmp_path) == [f"{stem}-{number}.dng" for number in range(5 - links, 5)]


def test_a_folder_that_is_not_there_is_told_before_a_shot(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=re.escape(str(tmp_path / "missing"))):
        ShotFolder(tmp_path / "missing")
