"""Encode a rendered picture as a linear DNG with three samples per pixel, to be finished in a raw developer."""

import math

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import ByteArray, FloatArray
from ..errors import InputError
from ..metadata import CaptureMetadata
from ..tiff import FieldType, encode_tiff
from .colour_tags import colour_fields
from .container import main_directory, picture_id, raw_digest, raw_directory
from .tags import MAKER, Photometric, Tag

_BITS = 16
_WHITE_CODE = 65535


def encode_picture_dng(
    rgb: FloatArray,
    metadata: CaptureMetadata,
    camera_to_xyz: ArrayLike | None,
    neutral: ArrayLike | None,
    preview: ByteArray,
    *,
    white: float = 1.0,
) -> bytes:
    """Encode a picture in camera colours as a DNG (three-sample LinearRaw, 16 bits, lossless).

    rgb: (H, W, 3) floats, linear camera RGB in scene units, in the orientation of the mosaic. Negative values become 0.
    metadata: capture data.
    camera_to_xyz: 3 x 3, camera RGB -> XYZ (D50 white); None = a nominal matrix.
    neutral: reading of white in the 3 channels; None = unknown.
    preview: (h, w, 3) uint8 sRGB.
    white: scene units at code 65535. Brighter values are clipped; pass the maximum of the picture to keep all highlights. The field
        BaselineExposure makes raw developers brighten the picture accordingly.
    Raises InputError for a picture of another shape, for values that are not finite, and for a white that is not positive.
    """
    picture = np.asarray(rgb)
    if picture.ndim != 3 or picture.shape[2] != 3 or not min(picture.shape) or not np.issubdtype(picture.dtype, np.floating):
        raise InputError(f"the picture is {picture.dtype} {picture.shape}, expected floats (rows, columns, 3)")
    if not (math.isfinite(white) and white > 0):
        raise InputError(f"white is {white}, expected a positive number of scene units")
    if not np.isfinite(picture).all():
        raise InputError("the picture has values that are not finite (NaN or infinite)")
    codes = np.rint(picture * (_WHITE_CODE / white)).clip(0, _WHITE_CODE).astype(np.uint16)
    raw = raw_directory(codes, _BITS, Photometric.LINEAR_RAW)
    raw.fields.update(
        {
            Tag.BLACK_LEVEL_REPEAT_DIM: (FieldType.SHORT, [1, 1]),
            Tag.BLACK_LEVEL: (FieldType.SHORT, [0] * 3),
            Tag.WHITE_LEVEL: (FieldType.SHORT, [_WHITE_CODE] * 3),
        }
    )
    digest = raw_digest(codes)
    main = main_directory(preview, metadata, f"{MAKER} render", raw, digest)
    main.fields.update(colour_fields(camera_to_xyz, neutral))
    main.fields[Tag.RAW_DATA_UNIQUE_ID] = FieldType.BYTE, picture_id(codes.shape, digest).encode()
    main.fields[Tag.BASELINE_EXPOSURE] = FieldType.SRATIONAL, [math.log2(white)]
    return encode_tiff(main)
