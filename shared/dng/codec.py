"""Encode a mosaic as the bytes of a DNG file and decode it (Adobe, Digital Negative Specification
1.4.0.0).
"""

from concurrent.futures import ThreadPoolExecutor
from typing import IO

import imagecodecs
import numpy as np

from ..arrays import ByteArray, CodeArray
from ..calibration import SensorCalibration
from ..errors import ForeignFileError, InputError
from ..jpeg_check import read_header
from ..mosaic import Mosaic
from ..pattern import CfaPattern
from ..reading import MAX_PIXELS
from ..tiff import Fields, FieldType, encode_tiff
from .colour_tags import colour_fields, has_colours
from .container import main_directory, picture_id, raw_digest, raw_directory
from .reader import DngReader, damaged, library, opened
from .record import Record, decode_record, encode_record, is_record, preview_digest, record_id
from .tags import CFA_CODES, LONGEST_CFA_PERIOD, MAKER, PICTURE_PLANES, TAG, Photometric

_RECTANGULAR = 1
_LEAST_BITS = 10  # DNG, and libjpeg for uint16, require more than a low white level has
_SMALL_PREVIEW = 1 << 20  # pixels that are harmless, however small the shot
# any of them names us in a file of ours
_WRITER = (TAG["UniqueCameraModel"], TAG["Make"], TAG["Software"])
# Adobe's SDK drops a noise profile whose S is zero (dng_noise_function::IsValid).
_LEAST_SHOT_NOISE = 1e-12


def encode_dng(mosaic: Mosaic, preview: ByteArray) -> bytes:
    """Encode a mosaic as a DNG file; `decode_dng` returns an equal mosaic, with samples in sensor
    codes.

    Where DNG cannot express the pattern the samples are stored as one grey plane.

    Parameters
    ----------
    mosaic : Mosaic
        Its `codes` are saved.
    preview : ByteArray
        (h, w, 3) uint8 sRGB picture in the orientation of the samples. Make it large: most viewers
        show it as the photograph.

    Raises
    ------
    InputError
        For another kind of preview, and for a side of more than 65500 pixels.
    """
    pattern, calibration, codes = mosaic.pattern, mosaic.calibration, mosaic.codes
    stated = has_colours(pattern.channels) and pattern.period <= LONGEST_CFA_PERIOD
    photometric = Photometric.CFA if stated else Photometric.LINEAR_RAW
    with ThreadPoolExecutor(1, "samples") as pool:
        bits = max(calibration.bits, _LEAST_BITS)
        compressed = pool.submit(raw_directory, codes, bits, photometric)
        digest = raw_digest(codes)
    raw = compressed.result()
    raw.fields.update(_levels(pattern, calibration))
    camera = f"{MAKER} {calibration.sensor}".strip()
    main = main_directory(preview, mosaic.metadata, camera, raw, digest)
    if photometric is Photometric.CFA:
        raw.fields.update(_cfa(pattern))
        known = calibration.camera_to_xyz, calibration.neutral, calibration.gamma
        main.fields.update(colour_fields(*known, pattern.channels, calibration.lights))
    raw.fields.update(_noise(calibration, photometric))
    record = encode_record(mosaic, digest, main.strips[0])
    main.fields[TAG["DNGPrivateData"]] = FieldType.BYTE, record
    main.fields[TAG["RawDataUniqueID"]] = FieldType.BYTE, record_id(record).encode()
    return encode_tiff(main)


def decode_dng(data: bytes | IO[bytes], *, max_pixels: int = MAX_PIXELS) -> Mosaic:
    """Decode a DNG written by `encode_dng`: the mosaic with uint16 codes, and pattern and
    calibration as they were written.

    Capture data come from the TIFF and Exif fields, which other programs may have edited since.

    Parameters
    ----------
    data : bytes | IO[bytes]
        The bytes of the file, or the file opened for reading.
    max_pixels : int, optional
        A file that declares more is refused before it is decoded.

    Raises
    ------
    ForeignFileError
        For the DNG of another program.
    InputError
        For any other and for a damaged file.
    """
    with opened(data) as dng:
        return _mosaic(dng, max_pixels)[0]


def _mosaic(dng: DngReader, max_pixels: int) -> tuple[Mosaic, Record]:
    stored = dng.stored(TAG["DNGPrivateData"])
    if not is_record(stored):
        remedy = "`panchroma simulate` makes one from a camera's RAW or a picture"
        raise ForeignFileError(f"not a mosaic of Panchroma; {remedy}")
    record = decode_record(stored)
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
        raise damaged(
            "the record of pattern and calibration (DNGPrivateData) is that of another shot"
        )
    _check_identity(dng, record.id)
    return Mosaic(samples, record.pattern, record.calibration, dng.metadata()), record


def verify(data: bytes | IO[bytes], *, max_pixels: int = MAX_PIXELS) -> tuple[int, int]:
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
    with opened(data) as dng:
        recorded = is_record(dng.stored(TAG["DNGPrivateData"]))
        if not (recorded or any(dng.stored(tag).startswith(MAKER.encode()) for tag in _WRITER)):
            raise ForeignFileError("not a DNG of Panchroma: it has no digest that could be checked")
        if not recorded and dng.raw().samplesperpixel == PICTURE_PLANES:
            samples, preview = dng.samples(max_pixels, PICTURE_PLANES), None
            _check_digest(dng, samples)
            _check_identity(dng, picture_id(samples.shape, dng.stored(TAG["NewRawImageDigest"])))
        elif not recorded:
            raise damaged("the record of pattern and calibration (DNGPrivateData) is missing")
        else:
            mosaic, record = _mosaic(dng, max_pixels)
            samples, preview = mosaic.codes, record.preview
        jpeg = dng.preview()
        _check_preview(jpeg, samples.shape[0] * samples.shape[1])
        if preview not in (None, preview_digest(jpeg)):
            raise damaged("the preview is not the one that was written")
        return samples.shape[0], samples.shape[1]


def _check_identity(dng: DngReader, identity: str) -> None:
    """Raise InputError if the file states another identity."""
    if dng.stored(TAG["RawDataUniqueID"]) != identity.encode():
        raise damaged("its parts are not all from the same file (RawDataUniqueID)")


def _check_preview(jpeg: bytes, pixels: int) -> None:
    """Raise InputError unless the JPEG is whole. pixels: of the shot; a preview has no more."""
    try:
        read_header(jpeg).check(max(pixels, _SMALL_PREVIEW))
    except InputError as error:
        raise damaged(f"the preview: {error}") from None
    with library("the preview is not a whole JPEG"):
        imagecodecs.jpeg8_decode(jpeg)


def _check_digest(dng: DngReader, samples: CodeArray) -> None:
    if dng.stored(TAG["NewRawImageDigest"]) != raw_digest(samples):
        raise damaged("the samples differ from those that were written (NewRawImageDigest)")


def decode_preview(data: bytes | IO[bytes]) -> bytes:
    """The JPEG preview of a DNG, unchanged.

    Raises
    ------
    InputError
        When there is none.
    """
    with opened(data) as dng:
        return dng.preview()


def _cfa(pattern: CfaPattern) -> Fields:
    tile = "".join(pattern.letters_from())  # from the first sample on: DNG knows no origin
    return {
        TAG["CFARepeatPatternDim"]: (FieldType.SHORT, [pattern.period] * 2),
        TAG["CFAPattern"]: (FieldType.BYTE, bytes(map(CFA_CODES.__getitem__, tile))),
        TAG["CFAPlaneColor"]: (FieldType.BYTE, bytes(map(CFA_CODES.__getitem__, pattern.planes))),
        TAG["CFALayout"]: (FieldType.SHORT, [_RECTANGULAR]),
    }


def _levels(pattern: CfaPattern, calibration: SensorCalibration) -> Fields:
    """Fields of the levels. The black level is stated for each pixel of a period if the planes
    differ, otherwise once.
    """
    levels = np.array(calibration.black_level)
    if len(set(calibration.black_level)) == 1 or pattern.period > LONGEST_CFA_PERIOD:
        levels = levels[-1:, None]  # the panchromatic plane's: most pixels belong to it
    else:
        levels = levels[pattern.filter_map((pattern.period, pattern.period))]
    kind, number = (FieldType.RATIONAL, float) if (levels % 1).any() else (FieldType.SHORT, int)
    return {
        TAG["BlackLevelRepeatDim"]: (FieldType.SHORT, list(levels.shape)),
        TAG["BlackLevel"]: (kind, levels.astype(number).ravel().tolist()),
        TAG["WhiteLevel"]: (FieldType.SHORT, [calibration.white_level]),
    }


def _noise(calibration: SensorCalibration, photometric: Photometric) -> Fields:
    """Field NoiseProfile, in which samples are x = signal / full_scale: S = shot / full_scale, O =
    (read / full_scale)**2.
    """
    noise, full = calibration.noise, calibration.full_scale
    if noise is None:
        return {}
    # a grey file has one plane, nearly all of it panchromatic
    first = -1 if photometric is Photometric.LINEAR_RAW else 0
    profile = list[float]()
    for shot, read in zip(noise.shot[first:], noise.read[first:], strict=True):
        profile += max(shot / full, _LEAST_SHOT_NOISE), (read / full) ** 2
    return {TAG["NoiseProfile"]: (FieldType.DOUBLE, profile)}
