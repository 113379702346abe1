"""A folder into which another program puts raw frames, one to a file."""

import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from shared.errors import InputError

from .frames import FrameLayout, RawFrame

_POLL = 0.2  # seconds between two looks
_PATIENCE = 2.0  # seconds without a change after which a file of the wrong size is taken to be finished
_UNFINISHED = (".part", ".tmp")

# What a file was like at a look: bytes, and time of its last change in nanoseconds.
_State = tuple[int, int]


def watch_folder(
    folder: Path,
    layout: FrameLayout,
    refused: Callable[[InputError], None],
    *,
    only_new: bool = False,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[RawFrame]:
    """The frames in the files of a folder, oldest change first, and those that appear later, until `stopped`.

    A file is a frame when it has a frame's size and has not changed between two looks. Files are only read. Hidden ones, and those
    named .part or .tmp, are somebody's unfinished work; a file that was changed after it was taken is another frame.
    refused: told of each file that stays at another size or cannot be read.
    only_new: leave out what is there at the beginning.
    Raises InputError when the folder cannot be looked into.
    """
    done = _look(folder) if only_new else {}
    before: dict[Path, _State] = {}
    since: dict[Path, float] = {}
    while not stopped():
        now = _look(folder)
        # Forgotten with the file: a folder that is emptied does not make this grow.
        done = {path: state for path, state in done.items() if path in now}
        for path, state in sorted(now.items(), key=lambda entry: (entry[1][1], entry[0])):
            if done.get(path) == state:
                continue
            if before.get(path) != state:
                since[path] = time.monotonic()
            elif state[0] == layout.frame_bytes:
                done[path] = state
                if (frame := _read(path, state, refused)) is not None:
                    yield frame
            elif time.monotonic() - since[path] > _PATIENCE:
                done[path] = state
                refused(InputError(f"{path}: {layout.misfit(state[0])}"))
        since = {path: when for path, when in since.items() if path in now and path not in done}
        before = now
        time.sleep(_POLL)


def _look(folder: Path) -> dict[Path, _State]:
    found: dict[Path, _State] = {}
    try:
        for path in folder.iterdir():
            if path.name.startswith(".") or path.suffix in _UNFINISHED:
                continue
            try:
                if path.is_file():
                    status = path.stat()
                    found[path] = status.st_size, status.st_mtime_ns
            except FileNotFoundError:  # it was renamed or removed between the two calls
                continue
    except OSError as error:
        raise InputError(f"{folder}: cannot be looked into ({error.strerror or error})") from None
    return found


def _read(path: Path, state: _State, refused: Callable[[InputError], None]) -> RawFrame | None:
    try:
        with path.open("rb") as file:
            data = file.read(state[0] + 1)  # it may have grown since, without end; one byte more, and it is refused
    except OSError as error:
        refused(InputError(f"{path}: cannot be read ({error.strerror or error})"))
        return None
    return RawFrame(data, datetime.fromtimestamp(state[1] / 1e9, UTC), time.monotonic(), str(path))
