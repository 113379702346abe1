"""Encode a mosaic as the bytes of a DNG file (Adobe, Digital Negative Specification 1.4.0.0)."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..arrays import ByteArray
from ..calibration import SensorCalibration
from ..mosaic import Mosaic
from ..pattern import CfaPattern
from ..tiff import Fields, FieldType, encode_tiff
from .colour_tags import colour_fields, has_colours
from .container import main_directory, raw_digest, raw_directory
from .record import encode_record
from .tags import CFA_CODES, LONGEST_CFA_PERIOD, MAKER, Photometric, fields_of


def encode_dng(mosaic: Mosaic, preview: ByteArray) -> bytes:
    """Encode a mosaic as a DNG file; `read_dng` returns an equal mosaic, with samples in sensor
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
        # DNG, and libjpeg for uint16, require more bits than a low white level has
        compressed = pool.submit(raw_directory, codes, max(calibration.bits, 10), photometric)
        digest = raw_digest(codes)
    raw = compressed.result()
    raw.fields |= _levels(pattern, calibration) | _noise(calibration, photometric)
    camera = f"{MAKER} {calibration.sensor}".strip()
    main = main_directory(preview, mosaic.metadata, camera, raw, digest)
    if photometric is Photometric.CFA:
        raw.fields |= _cfa(pattern)
        main.fields |= colour_fields(calibration.camera_to_xyz, calibration.neutral, calibration)
    record, identity = encode_record(mosaic, digest, main.strips[0])
    main.fields |= fields_of(FieldType.BYTE, DNGPrivateData=record)
    main.fields |= fields_of(FieldType.BYTE, RawDataUniqueID=identity.encode())
    return encode_tiff(main)


def _cfa(pattern: CfaPattern) -> Fields:
    # from the first sample on: DNG knows no origin; CFALayout 1: rectangular
    letters = "".join(pattern.letters_from()), pattern.planes
    tile, planes = (bytes(map(CFA_CODES.__getitem__, text)) for text in letters)
    fields = fields_of(FieldType.BYTE, CFAPattern=tile, CFAPlaneColor=planes)
    shape = [pattern.period] * 2
    return fields | fields_of(FieldType.SHORT, CFARepeatPatternDim=shape, CFALayout=[1])


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
    white = fields_of(FieldType.SHORT, WhiteLevel=[calibration.white_level])
    shape = fields_of(FieldType.SHORT, BlackLevelRepeatDim=list(levels.shape))
    return white | shape | fields_of(kind, BlackLevel=levels.astype(number).ravel().tolist())


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
        # Adobe's SDK drops a profile whose S is zero (dng_noise_function::IsValid)
        profile += max(shot / full, 1e-12), (read / full) ** 2
    return fields_of(FieldType.DOUBLE, NoiseProfile=profile)
