"""A lock per output file that is released when its process dies, so that any number of processes can share a folder."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from shared.writing import own_file, short_name
from tools.host.jobs import identity

from .journal import exclusive


@contextmanager
def output_lock(output: Path, *, wait: bool) -> Iterator[bool]:
    """Hold the lock on `output` in a `with` block; yields False when another process holds it and `wait` is not set.

    The lock is a file beside the output, removed at the end. One that a killed process left behind is taken over, or swept. On a
    file system without locks everybody gets it: then two processes may write the same file, each as a whole. Raises OSError when
    the lock file cannot be created.
    """
    path = lock_path(output)
    while True:
        with own_file(path, "ab") as file:
            try:
                exclusive(file.fileno(), wait=wait)
            except BlockingIOError:
                yield False
                return
            if identity(path) != identity(file.fileno()):
                continue  # its last owner has removed it meanwhile: this locks nothing
            try:
                yield True
            finally:
                path.unlink(missing_ok=True)
            return


def lock_path(output: Path) -> Path:
    """The name of the lock on an output."""
    digest = hashlib.sha256(os.fsencode(output.name)).hexdigest()[:8]
    return output.with_name(f".{short_name(output)}.{digest}.panchroma.lock")
