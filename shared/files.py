"""Bytes to disk: whole or not at all, also through a power cut."""

import errno
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import OutputError

Sealed = Callable[[Path], Callable[[], object]]

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

    A temporary file `.NAME.XXXXXXXX.part` (of a long name, its beginning) beside it is written, fsynced and moved into place,
    then the folder is fsynced: at any moment `path` is absent, old or new, never a part. Raises OutputError, with the temporary
    file removed, when the file exists (and `overwrite` is not set), when the folder is missing or read-only, or when the disk is
    full; the temporary file is removed too when anything else is raised in the block.
    sealed: called with the temporary file when all of it is written; what it returns is called when it is on the disk too and about
    to become `path`. What they raise stops it.
    """
    path = Path(path)
    name = os.fsencode(path.name)[:_LONGEST_PART].decode(errors="ignore")
    part = path.with_name(f".{name}.{secrets.token_hex(4)}.part")
    try:
        if not overwrite and path.exists():
            raise FileExistsError
        try:
            with part.open("xb") as file:
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
