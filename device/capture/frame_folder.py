"""Watching a folder into which another program writes raw frames, one per file."""

import math
import stat
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from ...shared.errors import InputError
from .frames import FrameLayout, RawFrame

_POLL = 0.2  # seconds between two scans of the folder
_PATIENCE = 2.0  # seconds without a change after which a file of the wrong size counts as finished
_UNFINISHED = (".part", ".tmp")

# State of a file: its size in bytes, and the time of its last change in nanoseconds.
_State = tuple[int, int]


def watch_folder(
    folder: Path,
    layout: FrameLayout,
    refused: Callable[[InputError], None],
    *,
    only_new: bool = False,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[RawFrame]:
    """Yield the frames in a folder, oldest first, and those that appear later, until `stopped`
    returns True.

    A file is a frame when it has the size of one and has not changed between two scans. Files are
    only read. Hidden files, and those named .part or .tmp, are ignored as unfinished. A file that
    changes after it was yielded counts as another frame.

    Parameters
    ----------
    folder : Path
        The folder to watch.
    layout : FrameLayout
        Size and format of a frame.
    refused : Callable[[InputError], None]
        Called with an error for each file that keeps another size or cannot be read.
    only_new : bool, optional
        Skip the files that exist at the beginning.
    stopped : Callable[[], bool], optional
        Polled before each scan.

    Raises
    ------
    InputError
        When the folder cannot be listed.
    """
    done = _scan(folder) if only_new else {}
    since: dict[tuple[Path, _State], float] = {}  # when a state was first seen
    while not stopped():
        now = _scan(folder)
        # Removed files are forgotten, so that this does not grow if the folder is emptied now and
        # then.
        done = {path: state for path, state in done.items() if path in now}
        new = sorted(
            (entry for entry in now.items() if done.get(entry[0]) != entry[1]),
            key=lambda entry: (entry[1][1], entry[0]),
        )
        for path, state in new:
            # -inf: changed since the scan before
            lasted = time.monotonic() - since.get((path, state), math.inf)
            if lasted > _PATIENCE or (lasted >= 0 and state[0] == layout.frame_bytes):
                done[path] = state
                try:
                    frame = _read(path, state, layout)
                except InputError as error:
                    refused(error)
                else:
                    yield frame
        since = {entry: since.get(entry, time.monotonic()) for entry in new}
        time.sleep(_POLL)


def _scan(folder: Path) -> dict[Path, _State]:
    found: dict[Path, _State] = {}
    try:
        for path in folder.iterdir():
            if path.name.startswith(".") or path.suffix in _UNFINISHED:
                continue
            try:
                status = path.stat()
            except OSError:  # removed meanwhile, or a link that leads nowhere
                continue
            if stat.S_ISREG(status.st_mode):
                found[path] = status.st_size, status.st_mtime_ns
    except OSError as error:
        raise InputError(f"{folder}: cannot be listed ({error.strerror or error})") from None
    return found


def _read(path: Path, state: _State, layout: FrameLayout) -> RawFrame:
    """The frame that a file in this state is. Raises InputError if it is none, or cannot be
    read.
    """
    size, changed = state
    if size != layout.frame_bytes:
        raise InputError(f"{path}: {layout.misfit(size)}")
    try:
        with path.open("rb") as file:
            # it may have grown meanwhile: one byte more, and it is refused
            data = file.read(size + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        taken = datetime.fromtimestamp(changed / 1e9, UTC)
        taken.astimezone()  # local time, which the file states too, may lie beyond the last year
    except (ValueError, OverflowError, OSError):
        raise InputError(
            f"{path}: its time of change is in no year from 1 to 9999; set it: touch {path.name}"
        ) from None
    return RawFrame(data, taken, time.monotonic(), str(path))
