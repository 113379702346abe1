"""Reading and writing DNG files. Writing is atomic, reading checks everything; error messages begin
with the name of the file.
"""

import imagecodecs

from ..arrays import ByteArray, CodeArray
from ..errors import ForeignFileError, InputError
from ..jpeg_check import read_header
from ..mosaic import Mosaic
from ..reading import MAX_PIXELS, File, naming
from ..writing import write_durably
from .container import picture_id, raw_digest
from .encoding import encode_dng
from .exif import read_metadata
from .reader import DngReader, damaged, library, opened
from .record import RECORD, RECORD_ID, Record, decode_record, preview_digest
from .tags import MAKER, PICTURE_PLANES, TAG

# any of them names us in a file of ours
_WRITER = (TAG["UniqueCameraModel"], TAG["Make"], TAG["Software"])


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
    with naming(path):
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
    with opened(path) as dng:
        return _mosaic(dng, max_pixels)[0]


def verify_dng(path: File, *, max_pixels: int = MAX_PIXELS) -> tuple[int, int]:
    """Check a DNG of Panchroma, mosaic or rendered picture, completely; returns its (rows,
    columns).

    One digest binds size, samples, pattern and calibration of a mosaic together; one of a picture
    size and samples. The mosaic's preview is compared with its digest, and any preview must be
    decodable.

    Raises
    ------
    ForeignFileError
        For the DNG of another program.
    InputError
        For any other file and a damaged one.
    """
    with opened(path) as dng:
        if _is_picture(dng, "not a DNG of Panchroma: it has no digest that could be checked"):
            samples, preview = dng.samples(max_pixels, PICTURE_PLANES), None
            _check_digest(dng, samples)
            _check_identity(dng, picture_id(samples.shape, dng.stored(TAG["NewRawImageDigest"])))
        else:
            mosaic, record = _mosaic(dng, max_pixels)
            samples, preview = mosaic.codes, record.preview
        jpeg = dng.preview()
        _check_preview(jpeg, samples.shape[0] * samples.shape[1])
        if preview not in (None, preview_digest(jpeg)):
            raise damaged("the preview is not the one that was written")
        return samples.shape[0], samples.shape[1]


def read_preview(path: File) -> bytes:
    """The JPEG preview of a DNG, unchanged; b"" if an editor such as exiftool has removed it.

    Raises
    ------
    InputError
        When there has never been one.
    """
    with opened(path) as dng:
        return dng.preview()


def _is_picture(dng: DngReader, foreign: str) -> bool:
    """Return True for a rendered picture, False for a mosaic.

    Raises ForeignFileError, with the message `foreign`, for a file of another program, and
    InputError for one whose first directory is not that of a picture, and for a mosaic without
    record.
    """
    if dng.stored(TAG["DNGPrivateData"]).startswith(RECORD_ID):
        return False
    if not dng.stored(TAG["ImageWidth"]):
        raise damaged("its first directory is not that of a picture (ImageWidth)")
    if not any(dng.stored(tag).startswith(MAKER.encode()) for tag in _WRITER):
        raise ForeignFileError(foreign)
    if dng.raw().samplesperpixel != PICTURE_PLANES:
        raise damaged(f"{RECORD} is missing")
    return True


def _mosaic(dng: DngReader, max_pixels: int) -> tuple[Mosaic, Record]:
    remedy = "`panchroma simulate` makes one from a camera's RAW or a picture"
    foreign = f"not a mosaic of Panchroma; {remedy}"
    if _is_picture(dng, foreign):
        raise ForeignFileError(foreign)
    record = decode_record(dng.stored(TAG["DNGPrivateData"]))
    letters, cfa = record.pattern.letters_from(), dng.cfa()
    if cfa not in (None, letters):
        recorded = f"the record in DNGPrivateData says {' '.join(letters)}"
        raise damaged(f"CFAPattern says {' '.join(cfa or ())}, {recorded}")
    samples = dng.samples(max_pixels)
    _check_digest(dng, samples)
    if samples.shape != record.shape:
        rows, columns = record.shape
        written = f"{columns} x {rows} were written"
        raise damaged(f"the samples are {samples.shape[1]} x {samples.shape[0]} pixels, {written}")
    if dng.stored(TAG["NewRawImageDigest"]).hex() != record.samples:
        raise damaged(f"{RECORD} is that of another shot")
    _check_identity(dng, record.id)
    # tifffile does not read the capture data: it misreads texts that are not UTF-8
    return Mosaic(samples, record.pattern, record.calibration, read_metadata(dng.stream)), record


def _check_identity(dng: DngReader, identity: str) -> None:
    """Raise InputError if the file states another identity."""
    if dng.stored(TAG["RawDataUniqueID"]) != identity.encode():
        raise damaged("its parts are not all from the same file (RawDataUniqueID)")


def _check_preview(jpeg: bytes, pixels: int) -> None:
    """Raise InputError unless the JPEG is whole. pixels: of the shot; a preview has no more."""
    try:
        # a megapixel is harmless, however small the shot
        read_header(jpeg).check(max(pixels, 1 << 20))
    except InputError as error:
        raise damaged(f"the preview: {error}") from None
    with library("the preview is not a whole JPEG"):
        imagecodecs.jpeg8_decode(jpeg)


def _check_digest(dng: DngReader, samples: CodeArray) -> None:
    if dng.stored(TAG["NewRawImageDigest"]) != raw_digest(samples):
        raise damaged("the samples differ from those that were written (NewRawImageDigest)")
