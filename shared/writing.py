"""Writing files atomically and durably: a power cut leaves the old file or the new one, never a
part.
"""

import errno
import io
import os
import re
import secrets
import shlex
import stat
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, BinaryIO

from .errors import DurabilityWarning, OutputError
from .reading import File, file_name, file_object

try:
    import fcntl
except ModuleNotFoundError:
    remedy = "on Windows install it in the Windows Subsystem for Linux (WSL)"
    raise ImportError(f"Panchroma runs on Linux and macOS; {remedy}") from None

OnComplete = Callable[[Path], Callable[[], object]]
"""Called with the complete temporary file. The function it returns is called when the file is on
the disk, before the rename.
"""

_PARTIAL = re.compile(r"\..*\.[0-9a-f]{8}\.panchroma\.(part|lock)", re.DOTALL)
# What fsync of a folder says on file systems that cannot do it: shares of virtual machines, 9p, old
# CIFS, some of FUSE.
_UNSUPPORTED = errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS
_CANNOT_SYNC = {*_UNSUPPORTED, errno.EBADF, errno.ENOTTY, errno.EISDIR}


def write_durably(
    path: File, data: bytes, *, overwrite: bool = False, on_complete: OnComplete | None = None
) -> None:
    """Write the content of `path` atomically and durably; see `durable_file`."""
    with durable_file(path, overwrite=overwrite, on_complete=on_complete) as file:
        file.write(data)


@contextmanager
def durable_file(
    path: File, *, overwrite: bool = False, on_complete: OnComplete | None = None
) -> Iterator[BinaryIO]:
    """Open a temporary file for the new content of `path`, in a `with` block; it becomes `path`
    when that ends without an error. What a file object gets is in memory until then.

    The temporary file (see `partial_path`) is written beside `path`, fsynced and renamed, then the
    folder is fsynced: at any moment `path` is absent, old or new, never half of it. An error in the
    block removes the temporary file; `sweep` removes those of killed processes. A replaced file
    keeps its permissions and its owner (see `_keep_permissions`). A link in the place of `path` is
    replaced itself: what it leads to is neither opened nor changed.

    Errors of the block and of `on_complete` that are not of this file pass through. For the folder
    see `sync_folder`.

    Parameters
    ----------
    path : File
        The file to write.
    overwrite : bool, optional
        Replace an existing file.
    on_complete : OnComplete | None, optional
        See `OnComplete`; an error raised there cancels the rename.

    Raises
    ------
    OutputError
        When the file exists and `overwrite` is False, when the folder is missing or read-only, and
        when the disk is full.
    """
    if not isinstance(path, str | os.PathLike):
        target, content = file_object(path, "write"), io.BytesIO()
        yield content
        with _named(Path(file_name(path))):
            try:
                target.write(content.getbuffer())
            except ValueError as error:  # it is closed
                raise OSError(errno.EBADF, str(error)) from None
        return
    path = Path(path)
    partial = partial_path(path)
    with _named(path):
        if not overwrite and os.path.lexists(path):
            raise FileExistsError
        # It stays open, and thus locked, until the rename: otherwise `sweep` would take it for a
        # leftover.
        file = io.BufferedWriter(_locked(partial, path))
    try:
        try:
            yield file
            file.flush()
            if overwrite:
                with _named(path):
                    _keep_permissions(path, file.fileno())
            settled = on_complete(partial) if on_complete is not None else None
            with _named(path):
                os.fsync(file.fileno())
            if settled is not None:
                settled()
            with _named(path):
                _move(partial, path, overwrite)
        finally:
            with _named(path):
                file.close()
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    with _named(path):
        sync_folder(path.parent)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Make an OSError of the `with` block an OutputError that names the file and what to do."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: {reason(error, path)}") from error


def sync_folder(folder: Path) -> None:
    """Wait until the names of the files in a folder are on the disk, if its file system can.

    Where it can but fails, the files are whole and have their names: that is a DurabilityWarning.

    Raises
    ------
    OSError
        When there is no such folder.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except (FileNotFoundError, NotADirectoryError):
        raise
    except OSError as error:
        if error.errno not in _CANNOT_SYNC:
            fault = f"the folder cannot be synced ({error.strerror or error})"
            effect = "files in it are whole, but new ones may be gone after a power cut"
            message = f"{folder}: {fault}: {effect}; check the disk"
            warnings.warn(message, DurabilityWarning, stacklevel=1)


def partial_path(path: Path) -> Path:
    """A unique temporary name beside `path`: `.NAME.XXXXXXXX.panchroma.part`; a long NAME is
    shortened.
    """
    return path.with_name(f".{short_name(path)}.{secrets.token_hex(4)}.panchroma.part")


def short_name(path: Path) -> str:
    """The beginning of a file's name: short enough to stand in another name, and no character
    of UTF-8 is cut in two.
    """
    # 100 bytes: with the suffix a name that every file system accepts
    return os.fsdecode(os.fsencode(path.name)[:100].decode(errors="ignore").encode())


def own_file(path: Path, mode: str, *, buffering: int = -1) -> IO[bytes]:
    """Open a file that this program keeps for itself (a journal, a lock, a kept result), as `open`
    does: a regular file only.

    A link or a pipe under the name of such a file may have been put there by anyone, and a link may
    lead to an original. So symbolic links are not followed, nothing waits for the other end of a
    pipe, and no device is read.

    Raises OSError, which says what to do.

    Parameters
    ----------
    mode : str
        Binary, as for `open`.
    """
    return open(path, mode, buffering, opener=_open_regular)


def _open_regular(path: str, flags: int) -> int:
    name, kinds = Path(path).name, "a link, a pipe, a device or a folder"
    stranger = OSError(errno.EINVAL, f"{name} is no file of Panchroma but {kinds}; remove it")
    try:
        descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        is_strange = error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR, errno.ENODEV)
        raise (stranger if is_strange else error) from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise stranger
    return descriptor


def sweep(folder: Path | str) -> int:
    """Remove the temporary files and locks that killed processes left in a folder.

    Files in use are locked by their process and stay, as do files of other users and those that
    cannot be locked or removed. Symbolic links cannot be locked; they are removed when they are
    more than a minute old.

    Returns
    -------
    int
        How many were removed.
    """
    removed = 0
    with suppress(OSError):
        for partial in [path for path in Path(folder).iterdir() if _PARTIAL.fullmatch(path.name)]:
            with suppress(OSError):
                status = partial.lstat()
                if status.st_uid != os.geteuid():
                    continue
                if stat.S_ISLNK(status.st_mode) and time.time() - status.st_mtime > 60:
                    partial.unlink()
                    removed += 1
                elif stat.S_ISREG(status.st_mode):
                    with own_file(partial, "rb") as file:
                        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                        partial.unlink()
                        removed += 1
    return removed


class _PartialFile(io.FileIO):
    """The temporary file for `path`, which errors name."""

    def __init__(self, partial: Path, path: Path) -> None:
        super().__init__(partial, "x")
        self._path = path

    def write(self, data: Any, /) -> int:
        with _named(self._path):
            return super().write(data)


def _locked(partial: Path, path: Path) -> _PartialFile:
    """Create and open the temporary file; it is locked while it is open."""
    while True:
        file = _PartialFile(partial, path)
        # some network shares have no locks; `sweep` removes nothing there either
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        if os.fstat(file.fileno()).st_nlink:
            return file
        file.close()  # another process removed it before it was locked


def _keep_permissions(path: Path, descriptor: int) -> None:
    """Give the new file the owner, the group and the permissions of the regular file that it will
    replace, if there is one.

    Only root may give files away. Under a group that cannot be kept the new group may do no more
    than everybody may.
    """
    with suppress(FileNotFoundError):
        old, new = path.lstat(), os.fstat(descriptor)
        if not stat.S_ISREG(old.st_mode):
            return
        mode = stat.S_IMODE(old.st_mode) & 0o777
        for owner, group in ((-1, old.st_gid), (old.st_uid, -1)):
            if owner in (-1, new.st_uid) and group in (-1, new.st_gid):
                continue
            try:
                os.fchown(descriptor, owner, group)
            except OSError:
                if group != -1:
                    mode &= ~0o070 | (mode & 0o007) << 3
        with suppress(OSError):  # a file system without permissions
            os.fchmod(descriptor, mode)
        # most files have no access control list, most systems not these functions
        with suppress(OSError, AttributeError):
            os.setxattr(descriptor, _ACL, os.getxattr(path, _ACL, follow_symlinks=False))


_ACL = "system.posix_acl_access"


def _move(partial: Path, path: Path, overwrite: bool) -> None:
    """Rename `partial` to `path`; without `overwrite` by a hard link, which cannot replace a file
    that has appeared meanwhile.
    """
    if overwrite:
        partial.replace(path)
        return
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # no hard links here (FAT, some network shares)
        if os.path.lexists(path):
            raise FileExistsError from None
        partial.rename(path)
    else:
        partial.unlink()


_FULL = "the disk is full; free some space or choose another folder"
_FORBIDDEN = "no permission to write in {folder}; choose another folder"
_REASONS = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), _FULL),
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), _FORBIDDEN),
    errno.EFBIG: "is larger than the file system or a limit of the system allows; choose another "
    "folder",
    errno.ENOENT: "the folder {folder} does not exist; create it first: mkdir -p {quoted}",
    errno.ENOTDIR: "{folder} is not a folder",
    errno.EISDIR: "is a folder",
    errno.ENAMETOOLONG: "the file name is too long",
}


def reason(error: OSError, path: Path) -> str:
    """Say why a file cannot be written, and what to do."""
    if isinstance(error, FileExistsError):
        if path.is_symlink() and not path.exists():
            return f"is a link to {path.readlink()}, which is not there; remove the link"
        return "exists already; use `overwrite=True` to replace it"
    text, folder = _REASONS.get(error.errno or 0), str(path.parent)
    # as in /proc; Path.is_dir would raise where it may not look
    is_there = os.path.isdir(folder)  # noqa: PTH112
    if text is None or (error.errno == errno.ENOENT and is_there):
        return f"cannot be written ({error.strerror or error})"
    return text.format(folder=folder, quoted=shlex.quote(folder))
