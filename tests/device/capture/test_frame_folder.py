import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from panchroma.device.capture import frame_folder
from panchroma.device.capture.frame_folder import watch_folder
from panchroma.device.capture.frames import FrameLayout, RawFrame
from panchroma.shared.errors import InputError

LAYOUT = FrameLayout(2, 2, "u16")
FRAME = bytes(range(8))


class Clock:
    """A clock that only sleep moves, and what happens meanwhile."""

    def __init__(self) -> None:
        self.now = 0.0
        self._plan: list[tuple[float, Callable[[], object]]] = []

    def at(self, seconds: float, event: Callable[[], object]) -> None:
        """Let something happen `seconds` from now."""
        self._plan.append((self.now + seconds, event))

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        due = [event for when, event in self._plan if when <= self.now]
        self._plan = [(when, event) for when, event in self._plan if when > self.now]
        for event in due:
            event()


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    # not of the module: threads of other libraries sleep, too
    own = SimpleNamespace(monotonic=lambda: clock.now, sleep=clock.sleep)
    monkeypatch.setattr(frame_folder, "time", own)
    Watch.clock = clock
    return clock


class Watch:
    """Takes frames from a folder."""

    clock: Clock

    def __init__(self, folder: Path, layout: FrameLayout = LAYOUT, **options: bool) -> None:
        self.refused: list[str] = []
        self._watch_for(0)
        self._frames = watch_folder(
            folder,
            layout,
            lambda error: self.refused.append(str(error)),
            **options,
            stopped=lambda: self.clock.now > self._until,
        )

    def take(self, count: int) -> list[RawFrame]:
        self._watch_for(1000)
        return [next(self._frames) for _ in range(count)]

    def names(self, count: int) -> list[str]:
        return [Path(frame.source).name for frame in self.take(count)]

    def rest(self, seconds: float = 30) -> list[RawFrame]:
        self._watch_for(seconds)
        return list(self._frames)

    def _watch_for(self, seconds: float) -> None:
        self._until = self.clock.now + seconds


def put(folder: Path, name: str, data: bytes = FRAME, seconds: float = 1e9) -> Path:
    path = folder / name
    path.write_bytes(data)
    os.utime(path, (seconds, seconds))
    return path


def test_what_is_there_comes_first_by_time_then_what_appears(tmp_path: Path) -> None:
    put(tmp_path, "b", seconds=2e9)
    put(tmp_path, "c", seconds=1e9)
    put(tmp_path, "a", seconds=2e9)
    watch = Watch(tmp_path)
    (first,) = watch.take(1)
    assert (first.source, first.data) == (str(tmp_path / "c"), FRAME)
    assert first.taken.timestamp() == 1e9
    assert watch.names(2) == ["a", "b"]
    put(tmp_path, "later")
    assert [Path(frame.source).name for frame in watch.rest()] == ["later"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c", "later"]
    assert watch.refused == []


def test_only_new_leaves_out_what_is_there(tmp_path: Path, clock: Clock) -> None:
    put(tmp_path, "old")
    put(tmp_path, "overwritten")
    watch = Watch(tmp_path, only_new=True)
    clock.at(3, lambda: put(tmp_path, "new"))
    clock.at(3, lambda: put(tmp_path, "overwritten", seconds=2e9))
    assert watch.names(2) == ["new", "overwritten"]
    assert watch.rest() == []


def test_unfinished_files_wait_for_their_names_and_what_is_no_file_is_passed_over(
    tmp_path: Path,
) -> None:
    for name in (".hidden", "frame.raw.part", "frame.tmp"):
        put(tmp_path, name)
    (tmp_path / "folder").mkdir()
    (tmp_path / "long").symlink_to("a" * 300)
    (tmp_path / "loop").symlink_to("loop")
    watch = Watch(tmp_path)
    assert watch.rest(5) == []
    assert watch.refused == []
    (tmp_path / "frame.tmp").rename(tmp_path / "frame.raw")
    assert Watch(tmp_path).names(1) == ["frame.raw"]


WIDE = FrameLayout(40, 30, "u16")
WHOLE = np.random.default_rng(0).integers(200, 4096, (30, 40), np.uint16).tobytes()
HALF = WHOLE[: len(WHOLE) // 2]
UNWRITTEN = HALF.ljust(len(WHOLE), b"\0")


def copied(path: Path, data: bytes, *, keeps_time: bool = False) -> None:
    """Go on writing a file in its place, as programs do that copy it."""
    path.touch()
    with path.open("r+b") as file:
        file.write(data)
    if keeps_time:
        os.utime(path, (1e9, 1e9))


@pytest.mark.parametrize("keeps_time", [False, True])
@pytest.mark.parametrize(
    ("history", "pause"),
    [
        ([HALF, WHOLE], 1.0),
        ([HALF, WHOLE[:-2], WHOLE], 8.0),
        ([UNWRITTEN, WHOLE], 1.0),
        ([UNWRITTEN, WHOLE], 8.0),
        ([bytes(len(WHOLE)), HALF, WHOLE], 9.0),
        ([WHOLE[:800] + bytes(800) + WHOLE[1600:], WHOLE], 5.0),  # by several at once
        ([HALF + HALF[::-1], WHOLE], 1.0),  # over an older frame
    ],
)
def test_a_frame_is_taken_whole_and_once_whoever_copies_it_pauses(
    tmp_path: Path, clock: Clock, history: list[bytes], pause: float, keeps_time: bool
) -> None:
    path, finished = tmp_path / "frame.raw", (len(history) - 1) * pause
    for number, data in enumerate(history):
        clock.at(number * pause, partial(copied, path, data, keeps_time=keeps_time))
    clock.at(finished, lambda: put(tmp_path, "other.raw", WHOLE[::-1]))
    watch = Watch(tmp_path, WIDE)
    taken = {Path(frame.source).name: bytes(frame.data) for frame in watch.take(2)}
    assert taken == {"frame.raw": WHOLE, "other.raw": WHOLE[::-1]}
    assert clock.now <= finished + 2.2  # the last one does not wait for more
    assert watch.rest() == []
    assert watch.refused == []


def test_a_file_written_again_or_touched_is_no_other_frame(tmp_path: Path, clock: Clock) -> None:
    path = put(tmp_path, "frame.raw", WHOLE)
    watch = Watch(tmp_path, WIDE)
    watch.take(1)
    clock.at(3, lambda: put(tmp_path, "frame.raw", WHOLE))
    clock.at(6, lambda: os.utime(path, (2e9, 2e9)))
    clock.at(9, lambda: path.chmod(0o600))
    clock.at(12, lambda: put(tmp_path, ".new", WHOLE).replace(path))
    clock.at(20, lambda: put(tmp_path, "frame.raw", WHOLE[::-1]))
    (other,) = watch.rest()
    assert (bytes(other.data), clock.now > 20) == (WHOLE[::-1], True)


@pytest.mark.parametrize("has_black_level", [False, True])
@pytest.mark.parametrize("data", [UNWRITTEN, bytes(len(WHOLE)), bytes(80) + WHOLE[80:]])
def test_a_frame_that_stays_without_a_line_is_a_dark_one_or_unfinished(
    tmp_path: Path, clock: Clock, data: bytes, has_black_level: bool
) -> None:
    path = put(tmp_path, "frame.raw", data)
    watch = Watch(tmp_path, WIDE, has_black_level=has_black_level)
    clock.at(9.5, lambda: put(tmp_path, "later.raw", WHOLE))
    if not has_black_level:
        assert watch.names(2) == ["frame.raw", "later.raw"]
        assert clock.now < 12
        return
    assert watch.names(1) == ["later.raw"]
    (line,) = watch.refused
    assert line.startswith(f"{path}: a line of it is empty; copy it again")
    put(tmp_path, "frame.raw", WHOLE)
    assert watch.names(1) == ["frame.raw"]


def test_a_frame_that_changes_while_it_is_read_is_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = put(tmp_path, "frame.raw", WHOLE[::-1])
    read = Path.open

    def late(self: Path, *arguments: Any) -> Any:
        monkeypatch.setattr(Path, "open", read)
        file = read(self, *arguments)
        copied(path, WHOLE)
        return file

    monkeypatch.setattr(Path, "open", late)
    watch = Watch(tmp_path, WIDE)
    assert [bytes(frame.data) for frame in watch.take(1)] == [WHOLE]
    assert watch.rest() == []


def test_a_file_of_another_size_is_told_once_and_taken_when_it_is_mended(tmp_path: Path) -> None:
    bad = put(tmp_path, "bad.raw", FRAME[:5])
    long = put(tmp_path, "long.raw", FRAME * 3)
    watch = Watch(tmp_path)
    assert watch.rest() == []
    told = [line.partition(" bytes are not a frame: 2 x 2")[0] for line in watch.refused]
    assert sorted(told) == [f"{bad}: 5", f"{long}: 24"]
    put(tmp_path, "good.raw")
    assert len(Watch(tmp_path).take(1)) == 1  # one bad file does not stop the others


def test_a_file_that_cannot_be_read_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "frame.raw")
    monkeypatch.setattr(Path, "open", Mock(side_effect=PermissionError(13, "Permission denied")))
    watch = Watch(tmp_path)
    assert watch.rest() == []
    assert watch.refused == [f"{tmp_path / 'frame.raw'}: cannot be read (Permission denied)"]


def test_a_folder_that_goes_away_ends_it(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    watch = Watch(folder)
    put(folder, "frame.raw")
    watch.take(1)
    (folder / "frame.raw").unlink()
    folder.rmdir()
    with pytest.raises(InputError, match="frames: cannot be listed"):
        watch.rest()


def test_what_has_left_the_folder_is_forgotten(tmp_path: Path) -> None:
    """The same name again is another frame, even with the same time."""
    watch = Watch(tmp_path)
    for number in range(3):
        put(tmp_path, "frame.raw")
        assert watch.take(1)[0].source == str(tmp_path / "frame.raw")
        (tmp_path / "frame.raw").unlink()
        put(tmp_path, "other.raw", bytes([number + 1]) * len(FRAME))  # a scan without it
        watch.take(1)


def test_a_time_in_no_year_is_told(tmp_path: Path) -> None:
    """Not every file system can store the year 10000: the state of the file is made up."""
    path = put(tmp_path, "late.raw")
    words = r"late\.raw: its time of change is in no year from 1 to 9999; set it: touch late\.raw"
    with pytest.raises(InputError, match=words):
        frame_folder._read(path, (len(FRAME), 253_402_300_800 * 10**9, 0), LAYOUT)
