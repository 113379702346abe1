"""Reading and writing DNG files. Writing is atomic, reading checks everything; error messages begin
with the name of the file.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from ..arrays import ByteArray
from ..errors import InputError
from ..mosaic import Mosaic
from ..reading import MAX_PIXELS, File, file_name, opened_file
from ..writing import write_durably
from .codec import decode_dng, decode_preview, encode_dng, verify

_LARGEST_FILE = 1 << 32  # TIFF has 32-bit offsets
_KIND = "a DNG of Panchroma"


def write_dng(path: File, mosaic: Mosaic, preview: ByteArray, *, overwrite: bool = False) -> None:
    """Save a mosaic with its preview picture as a DNG, atomically and durably.

    Parameters
    ----------
    path : File
        The file to write.
    mosaic : Mosaic
        The shot; its `codes` are saved.
    preview : ByteArray
        (h, w, 3) uint8 sRGB, in the orientation of the samples; `device.Preview` makes one.
    overwrite : bool, optional
        Replace an existing file.

    Raises
    ------
    InputError
        For another kind of preview and for a side of more than 65500 pixels.
    OutputError
        When the file exists and `overwrite` is False, or cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, read_dng, write_dng
    >>> mosaic = Mosaic(np.full((12, 18), 1000, np.uint16), CfaPattern.bayer(6),
    ...     SensorCalibration.of_bits(12))
    >>> write_dng("shot.dng", mosaic, preview=np.zeros((12, 18, 3), np.uint8))
    >>> bool((read_dng("shot.dng").codes == mosaic.codes).all())
    True
    """
    with _naming(path):
        data = encode_dng(mosaic, preview)
    write_durably(path, data, overwrite=overwrite)


def read_dng(path: File, *, max_pixels: int = MAX_PIXELS) -> Mosaic:
    """Read a mosaic that `write_dng` saved: uint16 codes, equal pattern and calibration, capture
    data as last edited.

    Parameters
    ----------
    path : File
        The file.
    max_pixels : int, optional
        A file that declares more is refused before it is decoded.

    Raises
    ------
    InputError
        For any other file, and for a damaged or missing one.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, read_dng, write_dng
    >>> codes = np.full((12, 18), 1000, np.uint16)
    >>> write_dng("shot.dng", Mosaic(codes, CfaPattern.bayer(4), SensorCalibration.of_bits(12)),
    ...     np.zeros((8, 8, 3), np.uint8))
    >>> mosaic = read_dng("shot.dng")
    >>> mosaic.shape, mosaic.pattern.period, mosaic.calibration.bits
    ((12, 18), 4, 12)
    """
    with _naming(path), opened_file(path, _LARGEST_FILE, _KIND) as file:
        return decode_dng(file, max_pixels=max_pixels)


def verify_dng(path: File, *, max_pixels: int = MAX_PIXELS) -> tuple[int, int]:
    """Check a DNG of Panchroma completely, see `codec.verify`; returns (rows, columns).

    Raises
    ------
    InputError
        If it is damaged.
    """
    with _naming(path), opened_file(path, _LARGEST_FILE, _KIND) as file:
        return verify(file, max_pixels=max_pixels)


def read_preview(path: File) -> bytes:
    """The JPEG preview of a DNG, unchanged.

    Raises
    ------
    InputError
        When there is none.
    """
    with _naming(path), opened_file(path, _LARGEST_FILE, _KIND) as file:
        return decode_preview(file)


@contextmanager
def _naming(path: File) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise type(error)(f"{file_name(path)}: {error}") from error
