"""Opening untrusted files: kind and size are checked before anything is read. Also the size
limits.
"""

import codecs
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from io import TextIOBase
from pathlib import Path
from typing import IO, Any, TypeAlias, TypeGuard

from .errors import InputError, MissingFileError

MAX_PIXELS = 1 << 28
"""Largest number of pixels that readers accept by default: 268 million, more than all but a few
sensors have.
"""

MAX_DOCUMENT = 4 << 20
"""Largest text file that is read (JSON, CGATS), bytes; a camera file with a hundred thousand
defects has half as many.
"""

File: TypeAlias = str | os.PathLike[str] | IO[bytes]
"""The name of a file, or a file object that is open for bytes, such as io.BytesIO."""


def is_file(value: object) -> TypeGuard[File]:
    """True for the name of a file and for a file object."""
    return isinstance(value, str | os.PathLike) or hasattr(value, "read") or hasattr(value, "write")


def file_name(file: File) -> str:
    """The name of a file for messages; a file object may have none."""
    if isinstance(file, str | os.PathLike):
        return os.fspath(file)
    name = getattr(file, "name", None)  # a temporary file has a number
    return name if isinstance(name, str) else "the file object"


def file_object(file: Any, method: str) -> IO[bytes]:
    """The file object, after a check that it is one for bytes and has this method.

    Raises
    ------
    InputError
        That does not name the file.
    """
    if isinstance(file, TextIOBase) or not hasattr(file, method):
        expected = "expected its name, or a file that is open for bytes"
        raise InputError(f"a file is {type(file).__name__}, {expected}")
    return file


@contextmanager
def naming(file: File) -> Iterator[None]:
    """Begin the message of an InputError of the `with` block with the name of the file."""
    try:
        yield
    except InputError as error:
        raise type(error)(f"{file_name(file)}: {error}") from error


@contextmanager
def opened_file(path: File, largest: int, kind: str) -> Iterator[IO[bytes]]:
    """Open a file of 1 to `largest` bytes for reading, in a `with` block; a file object is read
    from its beginning, and stays open.

    The message does not name the file.

    Parameters
    ----------
    path : File
        The file.
    largest : int
        Bytes; a longer file is refused.
    kind : str
        The kind of file that is expected, with its article, for the message.

    Raises
    ------
    MissingFileError
        When there is no such file.
    InputError
        For a folder, for a pipe or a device (which might never end), for an empty file, for a
        longer one, and when the file cannot be read.
    """
    with _opened(path, kind) as stream:
        try:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(0)
            if not size:
                raise InputError("the file is empty; copy it again")
            if size > largest:
                reason = "it is something else, or damaged"
                raise InputError(f"is larger than the {largest} bytes of {kind}: {reason}")
            yield stream
        except OSError as error:
            raise _unreadable(error) from error


def _opened(path: File, kind: str) -> AbstractContextManager[IO[bytes]]:
    """The file, open until the end of a `with` block; a file object, which stays open."""
    if not isinstance(path, str | os.PathLike):
        if not file_object(path, "seekable").seekable():
            raise InputError("cannot be read from its beginning; give io.BytesIO(file.read())")
        return nullcontext(path)
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError(f"is a folder; give {kind}")
        if path.exists() and not path.is_file():
            raise InputError("is a pipe or a device, not a file; save it to a file first")
        return path.open("rb")
    except FileNotFoundError:
        wild, plain = "no file matches this name with wildcards", "there is no such file"
        # a shell leaves wildcards where they match nothing
        what = wild if {"*", "?"} & set(str(path)) else plain
        raise MissingFileError(f"{what}; check the name") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise _unreadable(error) from error


def _unreadable(error: OSError | ValueError) -> InputError:
    return InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})")


def read_whole(path: File, largest: int, kind: str) -> bytes:
    """All bytes of a file, checked as by `opened_file`; never more than `largest`, even if the file
    grows meanwhile.
    """
    with opened_file(path, largest, kind) as file:
        return file.read(largest)


def read_text(path: File, largest: int, kind: str, otherwise: str = "") -> str:
    """The text of a file in UTF-8, without the byte-order mark that some editors put before it;
    checked as by `opened_file`.

    Raises InputError, which does not name the file, for any other file.

    Parameters
    ----------
    otherwise : str, optional
        Name of the encoding of a file that is not in UTF-8; "" = there must be none.
    """
    data = read_whole(path, largest, kind)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in data:
        raise InputError(f"is not a text in UTF-8 (it may be UTF-16); save {kind} as UTF-8")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        if otherwise:
            return data.decode(otherwise)
        raise InputError(f"is not a text in UTF-8; save {kind} as UTF-8") from None
