import os
import time
from itertools import islice
from pathlib import Path
from unittest.mock import Mock

import pytest

from panchroma.device.capture import frame_folder
from panchroma.device.capture.frame_folder import watch_folder
from panchroma.device.capture.frames import FrameLayout, RawFrame
from panchroma.shared.errors import InputError

LAYOUT = FrameLayout(2, 2, "u16")
FRAME = bytes(range(8))


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_folder, "_POLL", 0.01)
    monkeypatch.setattr(frame_folder, "_PATIENCE", 0.05)


class Watch:
    """Takes frames from a folder, and lets things happen there between two looks."""

    def __init__(self, folder: Path, *, only_new: bool = False) -> None:
        self.refused: list[str] = []
        self.looks = 0
        self.most = 0
        self._frames = watch_folder(
            folder, LAYOUT, self._refuse, only_new=only_new, stopped=self._stopped
        )

    def take(self, count: int) -> list[RawFrame]:
        self.most = self.looks + 1000
        return [next(self._frames) for _ in range(count)]

    def names(self, count: int) -> list[str]:
        return [Path(frame.source).name for frame in self.take(count)]

    def rest(self, looks: int = 20) -> list[RawFrame]:
        self.most = self.looks + looks
        return list(self._frames)

    def _refuse(self, error: InputError) -> None:
        self.refused.append(str(error))

    def _stopped(self) -> bool:
        self.looks += 1
        return self.looks > self.most


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
    first = watch.take(3)
    assert [Path(frame.source).name for frame in first] == ["c", "a", "b"]
    assert first[0].taken.timestamp() == 1e9
    assert bytes(first[0].data) == FRAME
    put(tmp_path, "later")
    assert [Path(frame.source).name for frame in watch.rest()] == ["later"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c", "later"]
    assert watch.refused == []


def test_only_new_leaves_out_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, "old")
    put(tmp_path, "overwritten")
    watch = Watch(tmp_path, only_new=True)

    def then(_: float) -> None:
        if watch.looks == 3:
            put(tmp_path, "new")
            put(tmp_path, "overwritten", seconds=2e9)

    monkeypatch.setattr(time, "sleep", then)
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


@pytest.mark.parametrize(
    "history",
    [
        [FRAME[:length] for length in (0, 3, 6, 8)],
        [bytes([number]) * len(FRAME) for number in (3, 2, 1)] + [FRAME],
    ],
    ids=["grows", "changes"],
)
def test_a_file_is_taken_when_it_has_stopped_changing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, history: list[bytes]
) -> None:
    left = iter(enumerate(history))

    def change(_: float) -> None:
        for number, data in islice(left, 1):
            put(tmp_path, "frame.raw", data, seconds=1e9 - number)

    change(0)
    monkeypatch.setattr(time, "sleep", change)
    monkeypatch.setattr(frame_folder, "_PATIENCE", 3600)
    watch = Watch(tmp_path)
    (frame,) = watch.take(1)
    assert bytes(frame.data) == FRAME
    assert watch.refused == []


def test_a_file_of_another_size_is_told_once_and_taken_when_it_is_mended(tmp_path: Path) -> None:
    bad = put(tmp_path, "bad.raw", FRAME[:5])
    long = put(tmp_path, "long.raw", FRAME * 3)
    watch = Watch(tmp_path)
    assert watch.rest(60) == []
    assert sorted(watch.refused) == [
        f"{bad}: 5 bytes are not a frame: 2 x 2 pixels in u16 with a stride of 4 have 8",
        f"{long}: 24 bytes are not a frame: 2 x 2 pixels in u16 with a stride of 4 have 8; "
        "3 frames in one are a stream: give it on standard input",
    ]
    put(tmp_path, "good.raw")
    assert len(Watch(tmp_path).take(1)) == 1  # one bad file does not stop the others


def test_a_file_that_cannot_be_read_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "frame.raw")

    denied = PermissionError(13, "Permission denied")
    monkeypatch.setattr(Path, "open", Mock(side_effect=denied))
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
        put(tmp_path, "other.raw", seconds=2e9 + number)  # a scan without it
        watch.take(1)


def test_a_time_in_no_year_is_told(tmp_path: Path) -> None:
    """Not every file system can store the year 10000: the state of the file is made up."""
    path = put(tmp_path, "late.raw")
    words = r"late\.raw: its time of change is in no year from 1 to 9999; set it: touch late\.raw"
    with pytest.raises(InputError, match=words):
        frame_folder._read(path, (len(FRAME), 253_402_300_800 * 10**9), LAYOUT)
