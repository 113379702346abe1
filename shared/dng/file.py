"""DNG files on disk: written whole or not at all, read with suspicion. Errors begin with the file's name."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..arrays import ByteArray
from ..errors import InputError
from ..mosaic import Mosaic
from ..reading import MAX_PIXELS, opened_file
from ..writing import write_durably
from .codec import Layout, decode_dng, decode_preview, encode_dng, verify

_LARGEST_FILE = 1 << 32  # TIFF has 32-bit offsets
_KIND = "a DNG of Panchroma"


def write_dng(path: Path | str, mosaic: Mosaic, preview: ByteArray, *, layout: Layout = "auto", overwrite: bool = False) -> None:
    """Save the mosaic with its preview picture, (h, w, 3) uint8 sRGB; see `encode_dng` for `layout`.

    Raises InputError when the mosaic does not fit the layout, and OutputError when the file exists and `overwrite` is not set, or
    cannot be written.
    """
    with _naming(path):
        data = encode_dng(mosaic, preview, layout)
    write_durably(path, data, overwrite=overwrite)


def read_dng(path: Path | str, *, max_pixels: int = MAX_PIXELS) -> Mosaic:
    """The mosaic that `write_dng` saved: uint16 codes, equal pattern and calibration, capture data as last edited.

    Raises InputError for any other, damaged or missing file, and for one of more than `max_pixels`.
    """
    with _naming(path), opened_file(path, _LARGEST_FILE, _KIND) as file:
        return decode_dng(file, max_pixels=max_pixels)


def verify_dng(path: Path | str, *, max_pixels: int = MAX_PIXELS) -> tuple[int, int]:
    """(rows, columns) of a whole DNG of ours, mosaic or rendered picture; see `codec.verify`. Raises InputError for any other."""
    with _naming(path), opened_file(path, _LARGEST_FILE, _KIND) as file:
        return verify(file, max_pixels=max_pixels)


def read_preview(path: Path | str) -> bytes:
    """The preview of a DNG, a JPEG, as it lies in the file. Raises InputError when there is none."""
    with _naming(path), opened_file(path, _LARGEST_FILE, _KIND) as file:
        return decode_preview(file)


@contextmanager
def _naming(path: Path | str) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
