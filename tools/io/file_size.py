"""Checks of what files declare against the bytes that they have."""

import errno
import os
from collections.abc import Sequence
from io import SEEK_END
from pathlib import Path

from ...shared.errors import InputError

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
