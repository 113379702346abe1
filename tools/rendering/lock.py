"""One maker per output: a lock that dies with its process, so that any number of processes share a folder."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .journal import exclusive

_LONGEST = 100  # bytes of the output's name in the lock's: with what is added, a name that every file system takes


@contextmanager
def making(output: Path, *, wait: bool) -> Iterator[bool]:
    """Whether this process may make `output`, for the time of a `with` block; if `wait` is set, as soon as no other does.

    The lock is a file beside the output, removed at the end; one that a killed process has left is taken over, or swept. Where the
    file system knows no locks everybody may: two processes then may make the same file, each whole. Raises OSError when the lock
    cannot be made.
    """
    name = os.fsencode(output.name)
    shown = name[:_LONGEST].decode(errors="ignore")
    path = output.with_name(f".{shown}.{hashlib.sha256(name).hexdigest()[:8]}.panchroma.lock")
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            exclusive(descriptor, wait=wait)
        except BlockingIOError:
            os.close(descriptor)
            yield False
            return
        except BaseException:
            os.close(descriptor)
            raise
        if _is(path, descriptor):
            break
        os.close(descriptor)  # the one before has removed it: this is a lock on nothing
    try:
        yield True
    finally:
        path.unlink(missing_ok=True)
        os.close(descriptor)


def _is(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
