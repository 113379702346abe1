"""LibRaw's demosaicing of a Bayer DNG in memory: the code behind nearly every free raw developer and many viewers."""

import io
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray
from shared.dng.tags import CFA_CODES, DNG_VERSION, Photometric, Tag
from shared.errors import InputError
from shared.tiff import FieldType
from tools.camera.bayer import ORDER, check_mosaic

from ..method import Method
from .integers import Levels

ALGORITHMS = ("ahd", "dcb", "dht", "aahd")
_LEAST = 22  # pixels each way: LibRaw refuses smaller frames


def demosaic_libraw(mosaic: FloatArray, algorithm: str) -> FloatArray:
    """Picture, float32 (H, W, 3), from a Bayer mosaic (H, W), both in scene units.

    LibRaw gets the samples with a pedestal that it keeps, so that noise below black or above white is not clipped. It returns
    linear 16-bit camera colours without white balance, colour conversion or brightening.

    algorithm: one of ALGORITHMS.
    Raises InputError for an unknown algorithm, and for a frame smaller than 22 x 22.
    """
    check_mosaic(mosaic)
    if algorithm not in ALGORITHMS:
        raise InputError(f"unknown LibRaw algorithm {algorithm!r}; one of {', '.join(ALGORITHMS)}")
    if min(mosaic.shape) < _LEAST:
        raise InputError(f"a mosaic of {mosaic.shape[1]} x {mosaic.shape[0]} is too small for LibRaw: {_LEAST} pixels each way")
    levels = Levels.around(mosaic)
    developed = develop(encode_bayer_dng(levels.encode(mosaic)), algorithm)
    if developed.shape != (*mosaic.shape, 3):
        raise InputError(f"LibRaw made {developed.shape} of a mosaic of {mosaic.shape}")
    return levels.decode(developed)


def develop(data: bytes, algorithm: str) -> NDArray[np.uint16]:
    """Linear camera colours, uint16 (H, W, 3), that one of LibRaw's algorithms makes of a Bayer file in memory."""
    import rawpy

    with rawpy.imread(io.BytesIO(data)) as raw:
        developed: Any = raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm[algorithm.upper()],
            output_bps=16,
            gamma=(1, 1),
            output_color=rawpy.ColorSpace.raw,
            user_wb=[1.0, 1.0, 1.0, 1.0],
            user_black=0,
            user_sat=65535,
            adjust_maximum_thr=0.0,
            no_auto_bright=True,
            user_flip=0,
        )
    return np.asarray(developed, np.uint16)


def encode_bayer_dng(codes: NDArray[np.uint16]) -> bytes:
    """Uncompressed DNG of a Bayer mosaic, uint16 (H, W): black is 0, white 65535, camera colours are those of sRGB."""
    from tifffile import imwrite

    # XYZ -> linear sRGB (IEC 61966-2-1), under D65: AHD compares colours in CIE Lab and needs a matrix.
    matrix = (3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.204, 1.057)
    fields = (
        (Tag.CFA_REPEAT_PATTERN_DIM, FieldType.SHORT, 2, (2, 2)),
        (Tag.CFA_PATTERN, FieldType.BYTE, 4, bytes(CFA_CODES[letter] for letter in ORDER)),
        (Tag.DNG_VERSION, FieldType.BYTE, 4, bytes(DNG_VERSION)),
        (Tag.UNIQUE_CAMERA_MODEL, FieldType.ASCII, 0, "Panchroma Bayer rival"),
        (Tag.WHITE_LEVEL, FieldType.LONG, 1, 65535),
        (Tag.COLOR_MATRIX_1, FieldType.SRATIONAL, 9, tuple(part for each in matrix for part in (round(10000 * each), 10000))),
        (Tag.CALIBRATION_ILLUMINANT_1, FieldType.SHORT, 1, 21),
        (Tag.AS_SHOT_NEUTRAL, FieldType.RATIONAL, 3, (1, 1) * 3),
    )
    file = io.BytesIO()
    imwrite(file, codes, photometric=Photometric.CFA, extratags=[(*field, True) for field in fields], metadata=None)
    return file.getvalue()


METHODS = tuple(
    Method(
        name,
        f"Bayer, LibRaw {name.upper()}",
        partial(demosaic_libraw, algorithm=name),
        balanced=True,
        packages=("rawpy",),
        seconds=0.2,
    )
    for name in ALGORITHMS
)
