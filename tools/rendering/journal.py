"""What renders have made in a folder: one line per file, appended and fsynced before the file takes its place.

So a file that this journal does not know is not ours, whatever moment a run was cut off at; and a line may be there for a file
that never took its place, which the file's digest tells.
"""

import fcntl
import hashlib
import json
import os
import stat
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

NAME = ".panchroma-journal.jsonl"
_FORMAT = 1


@dataclass(frozen=True)
class Entry:
    """One file that was made.

    output: its path below the journal's folder, "/" between names; digest: SHA-256 of its bytes; key: of everything it depends on
    (`key`); run: which run made it; source: the shot's absolute path.
    """

    output: str
    digest: str
    key: str
    run: str
    source: str


class Journal:
    """The journal of one folder; several processes may hold it at the same time, on several machines too."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._entries: dict[str, list[Entry]] = {}
        self._read = 0

    def of(self, output: str) -> list[Entry]:
        """What was ever made under this path, the latest last, whoever made it. Raises OSError when the journal cannot be read."""
        self._catch_up()
        return self._entries.get(output, [])

    def append(self, entry: Entry) -> None:
        """Note a file, durably. Raises OSError; what it may leave then is a torn line, which is no entry."""
        line = json.dumps({"format": _FORMAT, **asdict(entry)}).encode() + b"\n"
        descriptor = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            exclusive(descriptor)
            size = os.fstat(descriptor).st_size
            if size and os.pread(descriptor, 1, size - 1) != b"\n":
                line = b"\n" + line  # the last writer was cut off: what it left shall not spoil this line too
            while line:
                line = line[os.write(descriptor, line) :]
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        if not size:
            folder = os.open(self._path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def _catch_up(self) -> None:
        """Read what has been appended since."""
        try:
            with self._path.open("rb") as file:
                if file.seek(0, os.SEEK_END) < self._read:  # another journal is in its place
                    self._entries, self._read = {}, 0
                file.seek(self._read)
                for line in file:
                    if not line.endswith(b"\n"):
                        break  # torn, or being written
                    self._read += len(line)
                    entry = _entry(line)
                    if entry is not None:
                        self._entries.setdefault(entry.output, []).append(entry)
        except FileNotFoundError:
            self._entries, self._read = {}, 0


def _entry(line: bytes) -> Entry | None:
    """None for a torn line, and for what another version has written."""
    try:
        document = json.loads(line)
        if not isinstance(document, dict) or document.pop("format", None) != _FORMAT:
            return None
        entry = Entry(**document)
    except (ValueError, TypeError, RecursionError):
        return None
    return entry if all(isinstance(value, str) for value in asdict(entry).values()) else None


def key(**parts: Any) -> str:
    """Digest of everything that an output depends on (JSON values): equal keys, equal pictures."""
    return hashlib.sha256(json.dumps({"format": _FORMAT, **parts}, sort_keys=True).encode()).hexdigest()


def digest(path: Path | str) -> str | None:
    """SHA-256 of a file; None for what is no file that can be read."""
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):  # noqa: PTH116 (a pipe would never end; Path takes no impossible names)
            return None
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):
        return None


def exclusive(descriptor: int, *, wait: bool = True) -> bool:
    """Lock an open file, till it is closed or its process is gone; False where the file system knows no locks.

    Raises BlockingIOError when another holds it and `wait` is not set.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        raise
    except OSError:
        return False
    return True
