"""Files from anywhere, opened without trust: what a name leads to and how long it is, before a byte is taken. And the bounds."""

from collections.abc import Iterator
from contextlib import contextmanager
from os import SEEK_END
from pathlib import Path
from typing import BinaryIO

from .errors import InputError

MAX_PIXELS = 1 << 28
"""Pixels that every reader accepts unless told otherwise: 268 million, more than any single sensor has."""

MAX_DOCUMENT = 4 << 20
"""Bytes of a text that is read whole (JSON, CGATS): a camera file with a hundred thousand defects has half as many."""


@contextmanager
def opened_file(path: Path | str, largest: int, kind: str) -> Iterator[BinaryIO]:
    """A file open for reading, of 1 to `largest` bytes, for a `with` block.

    kind: what a file of ours is, with its article, for the message. Raises InputError, which does not name the file, for a folder,
    a pipe or a device (they would never end), an empty file and a longer one, and when it cannot be read.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError(f"is a folder; give {kind}")
        if path.exists() and not path.is_file():
            raise InputError("is a pipe or a device, not a file; save it to a file first")
        stream = path.open("rb")
    except FileNotFoundError:
        raise InputError("there is no such file; check the name") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise _unreadable(error) from error
    with stream:
        try:
            size = stream.seek(0, SEEK_END)
            stream.seek(0)
            if not size:
                raise InputError("the file is empty; copy it again")
            if size > largest:
                raise InputError(f"is larger than the {largest} bytes of {kind}: it is something else, or damaged")
            yield stream
        except OSError as error:
            raise _unreadable(error) from error


def _unreadable(error: OSError | ValueError) -> InputError:
    return InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})")


def read_whole(path: Path | str, largest: int, kind: str) -> bytes:
    """All bytes of a file, as `opened_file` opens it; not one more than `largest`, should it grow meanwhile."""
    with opened_file(path, largest, kind) as file:
        return file.read(largest)
