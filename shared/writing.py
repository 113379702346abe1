"""Bytes to disk: whole or not at all, also through a power cut."""

import errno
import fcntl
import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from .errors import OutputError

Sealed = Callable[[Path], Callable[[], object]]

_PART = re.compile(r"\..*\.[0-9a-f]{8}\.panchroma\.(part|lock)", re.DOTALL)
_LINK_SECONDS = 60.0
_LONGEST_PART = 100  # bytes: with what is added, a name that every file system takes


def write_durably(
    path: Path | str,
    *parts: bytes | bytearray | memoryview,
    overwrite: bool = False,
    sealed: Sealed | None = None,
) -> None:
    """Write `parts` one after the other as the new content of `path`, as `durable_file` does."""
    with durable_file(path, overwrite=overwrite, sealed=sealed) as file:
        for piece in parts:
            file.write(piece)


@contextmanager
def durable_file(path: Path | str, *, overwrite: bool = False, sealed: Sealed | None = None) -> Iterator[BinaryIO]:
    """A file to write the new content of `path` to, in a `with` block; it becomes `path` when the block ends well.

    A temporary file beside it (see `part_path`) is written, fsynced and moved into place, then the folder is fsynced: at any moment
    `path` is absent, old or new, never a part. Raises OutputError, with the temporary file removed, when the file exists (and
    `overwrite` is not set), when the folder is missing or read-only, or when the disk is full; the temporary file is removed too
    when anything else is raised in the block. What a killed process leaves behind, `sweep` removes.
    sealed: called with the temporary file when all of it is written; what it returns is called when it is on the disk too and about
    to become `path`. What they raise stops it.
    """
    path = Path(path)
    part = part_path(path)
    try:
        if not overwrite and path.exists():
            raise FileExistsError
        try:
            # It stays open, and so locked, until it has its name: `sweep` must not take it for a dead process's.
            with _locked(part) as file:
                yield file
                file.flush()
                settled = sealed(part) if sealed is not None else None
                os.fsync(file.fileno())
                if settled is not None:
                    settled()
                _move(part, path, overwrite)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise OutputError(f"{path}: {_reason(error, path)}") from error


def part_path(path: Path) -> Path:
    """A temporary name beside `path` that no other file has: `.NAME.XXXXXXXX.panchroma.part`, of a long name its beginning."""
    name = os.fsencode(path.name)[:_LONGEST_PART].decode(errors="ignore")
    return path.with_name(f".{name}.{secrets.token_hex(4)}.panchroma.part")


def sweep(folder: Path | str) -> int:
    """Remove the temporary files and locks that killed processes have left in a folder, and say how many.

    Those that a living process has in use are locked, and stay; so does what cannot be locked or removed, and another user's. Links
    cannot be locked: one is taken for left behind when it is a minute old.
    """
    removed = 0
    with suppress(OSError):
        for part in [path for path in Path(folder).iterdir() if _PART.fullmatch(path.name)]:
            with suppress(OSError):
                status = part.lstat()
                if status.st_uid != os.geteuid():
                    continue
                if stat.S_ISLNK(status.st_mode) and time.time() - status.st_mtime > _LINK_SECONDS:
                    part.unlink()
                    removed += 1
                elif stat.S_ISREG(status.st_mode):
                    with part.open("rb") as file:
                        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                        part.unlink()
                        removed += 1
    return removed


def _locked(part: Path) -> BinaryIO:
    """The temporary file, new, open and locked as long as it is open."""
    while True:
        file = part.open("xb")
        try:
            with suppress(OSError):  # some network shares have no locks: nothing is swept there either
                fcntl.flock(file, fcntl.LOCK_EX)
            if os.fstat(file.fileno()).st_nlink:
                return file
        except BaseException:
            file.close()
            raise
        file.close()  # another process swept it before it was locked


def _move(part: Path, path: Path, overwrite: bool) -> None:
    """Rename; without `overwrite` in the one way that cannot replace a file that has appeared meanwhile."""
    if overwrite:
        part.replace(path)
        return
    try:
        os.link(part, path)
    except FileExistsError:
        raise
    except OSError:  # no hard links here (FAT, some network shares)
        if path.exists():
            raise FileExistsError from None
        part.rename(path)
    else:
        part.unlink()


def _reason(error: OSError, path: Path) -> str:
    match error.errno:
        case errno.ENOSPC | errno.EDQUOT:
            return "the disk is full; free some space or choose another folder"
        case errno.EFBIG:
            return "is larger than the file system or a limit of the system allows; choose another folder"
        case errno.EACCES | errno.EPERM | errno.EROFS:
            return f"no permission to write in {path.parent}; choose another folder"
        case errno.ENOENT:
            return f"the folder {path.parent} does not exist; create it first"
        case errno.ENOTDIR:
            return f"{path.parent} is not a folder"
        case errno.EISDIR:
            return "is a folder"
        case errno.ENAMETOOLONG:
            return "the file name is too long"
    if isinstance(error, FileExistsError):
        return "exists already; use --overwrite to replace it"
    return f"cannot be written ({error.strerror or error})"
