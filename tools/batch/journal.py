"""Journal of the renders of one folder: a record of their outputs, and a lock per output.

The record has a line for each file, on the disk before the file gets its name, and after that the
same line again with sizes and times.

So a file that is not in the journal was not made by a render, even if a run was interrupted. A line
whose file never got its name is recognised by the digest. A lock is released when its process dies,
so that any number of processes can share a folder.
"""

import errno
import fcntl
import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from ...shared.errors import InputError, OutputError
from ...shared.figures import parsed_json
from ...shared.writing import own_file, reason, short_name, sync_folder
from .jobs import identity

NAME = ".panchroma-journal.jsonl"
_FORMAT = 1
_LONGEST_LINE = 1 << 16  # bytes: two paths, two digests and a name


@dataclass(frozen=True)
class Entry:
    """One file that was made.

    Attributes
    ----------
    output : str
        Its path below the journal's folder, "/" between names.
    digest : str
        SHA-256 of its bytes; "" = a run has found that there can be no such file.
    key : str
        Digest of everything that it depends on, see `key`.
    run : str
        Name of the run that made it.
    source : str
        Absolute path of the shot.
    input : str
        Digest of what it was made from.
    stamp : str
        Sizes and times of the files that it was made from, and of the file itself; "" as long as it
        has no name.
    """

    output: str
    digest: str
    key: str
    run: str
    source: str
    input: str
    stamp: str = ""


class Journal:
    """The journal of one folder. Several processes, on several machines, may use it at the same
    time.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._entries: dict[str, list[Entry]] = {}
        self._read = 0
        self._lock = Lock()

    def of(self, output: str) -> list[Entry]:
        """Entries of this output from all runs, the latest last.

        Raises OSError when the journal cannot be read.
        """
        with self._lock:
            self._catch_up()
        return self._entries.get(output, [])

    def made_with(self, outputs: Iterable[str]) -> list[Entry]:
        """The latest entries of all outputs that the latest runs of these made of their sources."""
        made = {(entry.run, entry.source) for name in outputs for entry in self.of(name)[-1:]}
        with self._lock:
            latest = [entries[-1] for entries in self._entries.values()]
        return [entry for entry in latest if (entry.run, entry.source) in made]

    def append(self, entry: Entry, *, wait: bool = True) -> None:
        """Add an entry, and wait until it is on the disk unless `wait` is False. Raises
        OutputError; the torn line that may be left then is ignored.
        """
        line = json.dumps({"format": _FORMAT, **asdict(entry)}).encode() + b"\n"
        try:
            with own_file(self._path, "ab+", buffering=0) as file:
                # the other name may be that of an original, or of a copy in a backup
                if os.fstat(file.fileno()).st_nlink > 1:
                    second = f"{NAME} has a second name (a hard link); replace it by a copy"
                    raise OSError(errno.EMLINK, second)
                exclusive(file.fileno())
                size = file.seek(0, os.SEEK_END)
                if size and os.pread(file.fileno(), 1, size - 1) != b"\n":
                    # the last writer was cut off: keep its torn line apart from this one
                    line = b"\n" + line
                while line:
                    line = line[file.write(line) :]
                if wait:
                    os.fsync(file.fileno())
            if not size:
                sync_folder(self._path.parent)
        except OSError as error:
            raise OutputError(f"{self._path}: {reason(error, self._path)}") from error

    def _catch_up(self) -> None:
        """Read what has been appended since."""
        try:
            with own_file(self._path, "rb") as file:
                if file.seek(0, os.SEEK_END) < self._read:  # it was replaced by another journal
                    self._entries, self._read = {}, 0
                file.seek(self._read)
                while line := file.readline(_LONGEST_LINE):
                    if len(line) == _LONGEST_LINE:
                        long = f"a line of {NAME} has {len(line)} bytes or more: remove the file"
                        raise OSError(errno.EINVAL, long)
                    if not line.endswith(b"\n"):
                        break  # torn, or still being written
                    self._read += len(line)
                    entry = _entry(line)
                    if entry is not None:
                        self._entries.setdefault(entry.output, []).append(entry)
        except FileNotFoundError:
            self._entries, self._read = {}, 0


def _entry(line: bytes) -> Entry | None:
    """The entry in a line; None for a torn line, and for a line of another version."""
    try:
        document = parsed_json(line)
        if not isinstance(document, dict) or document.pop("format", None) != _FORMAT:
            return None
        entry = Entry(**document)
    except (InputError, TypeError):
        return None
    return entry if all(isinstance(value, str) for value in asdict(entry).values()) else None


def key(**facts: Any) -> str:
    """Digest of everything that an output depends on (JSON values). Equal keys mean equal
    pictures.
    """
    text = json.dumps({"format": _FORMAT, **facts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def digest(path: Path | str) -> str | None:
    """SHA-256 of a file; None when it is not a file or cannot be read."""
    with suppress(OSError, ValueError):
        if Path(path).is_file():  # a pipe would never end
            with Path(path).open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
    return None


def exclusive(descriptor: int) -> None:
    """Lock an open file until it is closed or this process ends; on a file system without locks, do
    nothing.
    """
    with suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX)


@contextmanager
def output_lock(output: Path) -> Iterator[None]:
    """Hold the lock on `output` in a `with` block; wait for another process that holds it.

    The lock is a file beside the output, removed at the end. One that a killed process left behind
    is taken over, or swept. On a file system without locks everybody gets it: then two processes
    may write the same file, each as a whole.

    Raises OSError when the lock file cannot be created.
    """
    name_digest = hashlib.sha256(os.fsencode(output.name)).hexdigest()[:8]
    path = output.with_name(f".{short_name(output)}.{name_digest}.panchroma.lock")
    while True:
        with own_file(path, "ab") as file:
            exclusive(file.fileno())
            if identity(path) != identity(file.fileno()):
                continue  # its last owner has removed it meanwhile: this locks nothing
            try:
                yield
            finally:
                path.unlink(missing_ok=True)
            return
