"""Faults of a file that is decoded: errors of libraries and of the system as an InputError
that says what to do, and what it declares against the bytes that it has.
"""

import errno
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import SEEK_END
from pathlib import Path

from ...shared.errors import InputError, is_program_fault

_LARGE = "the picture does not fit into memory; cut or reduce it"


@contextmanager
def readable() -> Iterator[None]:
    """Raise InputError in a `with` block that reads a file which the system cannot read, or which
    does not fit into memory.
    """
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})") from error
    except MemoryError as error:
        raise InputError(_LARGE) from error


@contextmanager
def guarded(path: Path | str = "") -> Iterator[None]:
    """Raise InputError for whatever a library raises in a `with` block that decodes the file: on
    damaged files that is nearly everything.

    The block calls no function of Panchroma: a fault of the program is no damage of the file.
    """
    try:
        yield
    except MemoryError as error:
        raise InputError(_LARGE) from error
    except Exception as error:
        if is_program_fault(error):
            raise
        message = error.args[0] if error.args else ""
        text = message.decode("ascii", "replace") if isinstance(message, bytes) else str(error)
        reason = (text.strip().splitlines() or [type(error).__name__])[0]
        # whoever shows the error names the file
        reason = re.sub(r"<_io.*?>", "", reason.replace(f"'{path}'", "")).strip()
        why = "the file is cut short or damaged; copy it again"
        raise InputError(f"cannot be decoded ({reason}): {why}") from error


_MOST_HOLES = 4096
# more strips or tiles than this have that many pixels each
_MANY_STRIPS, _LEAST_STRIP = 1 << 14, 1024


def check_strips(offsets: Sequence[int], lengths: Sequence[int], end: int, pixels: int) -> None:
    """Raise InputError unless the strips or tiles of a picture lie in the file, share no bytes, and
    are not needlessly many.

    Parameters
    ----------
    offsets, lengths : Sequence[int]
        Of the strips or tiles, bytes.
    end : int
        Length of the file.
    pixels : int
        Of the picture.
    """
    # tifffile fills missing data with zeros: a black stripe in the picture instead of an error.
    ends = (offset + length for offset, length in zip(offsets, lengths, strict=True))
    if not offsets or max(ends) > end or not all(lengths):
        why = "it points beyond the end of the file; copy it again"
        raise InputError(f"the picture is cut short: {why}")
    if sum(lengths) > end:
        why = "the file is damaged, or made to fill the memory"
        raise InputError(f"the strips of the picture overlap: {why}")
    if len(offsets) > _MANY_STRIPS and len(offsets) * _LEAST_STRIP > pixels:
        reason = "the file is damaged, or made to waste time; save it again"
        raise InputError(f"{pixels} pixels in {len(offsets)} strips: {reason}")


def data_bytes(path: Path | str) -> int:
    """Bytes of a file that are not in holes: a sparse file of a few bytes can seem to be as long as
    a terabyte.

    On a file system that knows no holes: the length. More holes than any file has by accident count
    to the end.
    """
    with Path(path).open("rb", buffering=0) as file:
        descriptor, end, held, place = file.fileno(), file.seek(0, SEEK_END), 0, 0
        try:
            for _ in range(_MOST_HOLES):
                start = os.lseek(descriptor, place, os.SEEK_DATA)
                place = os.lseek(descriptor, start, os.SEEK_HOLE)
                held += place - start
        except OSError as error:
            return held if error.errno == errno.ENXIO else end  # ENXIO: no data from here on
        return held
