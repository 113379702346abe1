"""DNG files on disk: written whole or not at all, read with suspicion. Errors begin with the file's name."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..arrays import ByteArray
from ..errors import InputError
from ..files import write_durably
from ..mosaic import Mosaic
from .codec import Layout, decode_dng, decode_preview, encode_dng

_LARGEST_FILE = 1 << 32  # TIFF has 32-bit offsets


def write_dng(path: Path | str, mosaic: Mosaic, preview: ByteArray, *, layout: Layout = "auto", overwrite: bool = False) -> None:
    """Save the mosaic with its preview picture, (h, w, 3) uint8 sRGB; see `encode_dng` for `layout`.

    Raises InputError when the mosaic does not fit the layout, and OutputError when the file exists and `overwrite` is not set, or
    cannot be written.
    """
    with _naming(path):
        data = encode_dng(mosaic, preview, layout)
    write_durably(path, data, overwrite=overwrite)


def read_dng(path: Path | str) -> Mosaic:
    """The mosaic that `write_dng` saved: uint16 codes, equal pattern and calibration, capture data as last edited.

    Raises InputError for any other, damaged or missing file.
    """
    with _naming(path):
        return decode_dng(_read(Path(path)))


def read_preview(path: Path | str) -> bytes:
    """The preview of a DNG, a JPEG, as it lies in the file. Raises InputError when there is none."""
    with _naming(path):
        return decode_preview(_read(Path(path)))


@contextmanager
def _naming(path: Path | str) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error


def _read(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise InputError("is a folder; give the DNG file itself")
        if path.exists() and not path.is_file():
            raise InputError("is a pipe or a device, not a file; save the shot first")  # a pipe or device would never end
        if path.stat().st_size > _LARGEST_FILE:
            raise InputError("is larger than the 4 GiB of a TIFF, so it is not a DNG of Panchroma")
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError("there is no such file; check the name") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})") from error
