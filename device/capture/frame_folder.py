"""Watching a folder into which another program writes raw frames, one per file."""

import stat
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from zlib import crc32

import numpy as np

from ...shared.errors import InputError
from .frames import FrameLayout, RawFrame

_POLL_FOLDER = 0.2  # seconds between two scans of the folder
# Seconds without a change after which a file counts as finished: whatever copies it may pause for a
# second on a network or a slow card.
_PATIENCE = 1.5
# The same for a file that is shorter than a frame, or has a line of zeros, as there are where space
# is reserved and nothing written yet. Dark frames without a black level may keep such lines.
_UNFINISHED_PATIENCE = 10.0
_UNFINISHED = (".part", ".tmp")

# State of a file: its size in bytes, and the times of its last modification and of its last change
# of any kind, in nanoseconds: programs set the former as they like.
_State = tuple[int, int, int]


def watch_folder(
    folder: Path,
    layout: FrameLayout,
    refused: Callable[[InputError], None],
    *,
    only_new: bool = False,
    has_black_level: bool = False,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[RawFrame]:
    """Yield the frames in a folder, oldest first, and those that appear later, until `stopped`
    returns True.

    A file is a frame when it has the size of one and has not changed for 1.5 seconds, or ten if it
    has a line of zeros. Files are only read. Hidden files, and those named .part or .tmp, are
    ignored as unfinished. A file that changes after it was yielded counts as another frame if its
    bytes are others.

    Parameters
    ----------
    folder : Path
        The folder to watch.
    layout : FrameLayout
        Size and format of a frame.
    refused : Callable[[InputError], None]
        Called with an error for each file that keeps another size, cannot be read, or is not
        written to its end.
    only_new : bool, optional
        Skip the files that exist at the beginning.
    has_black_level : bool, optional
        Without light the sensor reads more than zero: a file that keeps a line of zeros was not
        written to its end.
    stopped : Callable[[], bool], optional
        Polled before each scan.

    Raises
    ------
    InputError
        When the folder cannot be listed.
    """
    done = _scan(folder) if only_new else {}
    yielded: dict[Path, int] = {}  # checksums
    waits: dict[tuple[Path, _State], tuple[float, float]] = {}  # since when, and for how long
    while not stopped():
        now = _scan(folder)
        # Removed files are forgotten, so that this does not grow if the folder is emptied now and
        # then.
        done = {path: state for path, state in done.items() if path in now}
        yielded = {path: checksum for path, checksum in yielded.items() if path in now}
        changed = [entry for entry in now.items() if done.get(entry[0]) != entry[1]]
        new = sorted(changed, key=lambda entry: (entry[1][1], entry[0]))
        waits = {entry: waits.get(entry, (time.monotonic(), _PATIENCE)) for entry in new}
        for path, state in new:
            since, patience = waits[path, state]
            if state[0] < layout.frame_bytes:
                patience = _UNFINISHED_PATIENCE
            if time.monotonic() - since < patience:
                continue
            try:
                frame = _read(path, state, layout)
                if _state(path) != state:  # it has changed while it was read
                    continue
                lines = np.frombuffer(frame.data, np.uint8).reshape(layout.height, layout.stride)
                has_gap = not lines.any(axis=1).all()
                if has_gap and patience < _UNFINISHED_PATIENCE:
                    waits[path, state] = since, _UNFINISHED_PATIENCE
                    continue
                if has_gap and has_black_level:
                    fault = "a line of it is empty; copy it again to its end, or add `unchecked`"
                    raise InputError(f"{path}: {fault}")
            except InputError as error:
                done[path] = state
                refused(error)
                continue
            done[path], checksum = state, crc32(frame.data)
            if yielded.get(path) != checksum:
                yielded[path] = checksum
                yield frame
        time.sleep(_POLL_FOLDER)


def _scan(folder: Path) -> dict[Path, _State]:
    try:
        paths = [*folder.iterdir()]
    except OSError as error:
        raise InputError(f"{folder}: cannot be listed ({error.strerror or error})") from None
    named = (path for path in paths if path.name[0] != "." and path.suffix not in _UNFINISHED)
    return {path: state for path in named if (state := _state(path))}


def _state(path: Path) -> _State | None:
    """Return the state of a file; None for a folder, a file that was removed meanwhile, or a link
    that leads nowhere.
    """
    try:
        status = path.stat()
    except OSError:
        return None
    is_file = stat.S_ISREG(status.st_mode)
    return (status.st_size, status.st_mtime_ns, status.st_ctime_ns) if is_file else None


def _read(path: Path, state: _State, layout: FrameLayout) -> RawFrame:
    """The frame that a file in this state is. Raises InputError if it is none, or cannot be
    read.
    """
    size, modified, _ = state
    if size != layout.frame_bytes:
        raise InputError(f"{path}: {layout.misfit(size)}")
    try:
        with path.open("rb") as file:
            data = file.read(size)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        taken = datetime.fromtimestamp(modified / 1e9, UTC)
        taken.astimezone()  # local time, which the file states too, may lie beyond the last year
    except (ValueError, OverflowError, OSError):
        reason = f"its time of change is in no year from 1 to 9999; set it: touch {path.name}"
        raise InputError(f"{path}: {reason}") from None
    return RawFrame(data, taken, time.monotonic(), str(path))
