"""Encode a rendered picture as a linear DNG with three samples per pixel, to be finished in a raw developer."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import ByteArray, FloatArray
from ..errors import InputError
from ..jpeg_writing import ROWS as STRIP_ROWS
from ..jpeg_writing import JpegStrip, encode_strip, join_strips
from ..metadata import CaptureMetadata
from ..tiff import Directory, FieldType, encode_tiff
from .colour_tags import colour_fields
from .container import (
    DIGEST_TILE,
    PREVIEW_QUALITY,
    EncodedPreview,
    check_sides,
    joined_digest,
    lossless_jpeg,
    main_directory,
    picture_fields,
    picture_id,
    tile_digests,
)
from .tags import MAKER, PICTURE_PLANES, Compression, Photometric, Tag

PART = DIGEST_TILE
"""Rows of a part of a picture."""
_BITS = 16
_WHITE_CODE = 65535
_TILE = 16  # TIFF 6.0: sides of tiles are multiples of this


@dataclass(frozen=True)
class EncodedPart:
    """Some rows of a picture, encoded: the tiles, from left to right, the digests of the samples, and strips of the preview."""

    tiles: Sequence[bytes]
    digests: bytes
    preview: Sequence[JpegStrip]


def encode_part(rgb: FloatArray, preview: ByteArray | None, shape: tuple[int, int], *, white: float = 1.0) -> EncodedPart:
    """Encode some rows of a picture; parts are independent of each other, and may be encoded in parallel.

    rgb: (rows, W, 3), see `encode_picture_dng`: `PART` rows, or what is left of the picture.
    preview: the same rows, (rows, W, 3) uint8 sRGB; None if the preview has another size.
    shape: (H, W) of the picture.
    """
    if not np.isfinite(rgb).all():
        raise InputError("the picture has values that are not finite (NaN or infinite)")
    scaled = rgb * (_WHITE_CODE / white)
    codes = np.rint(scaled, out=scaled).clip(0, _WHITE_CODE, out=scaled).astype(np.uint16, order="C")
    tall, wide = _tile(shape)
    pieces = [codes[:, left : left + wide] for left in range(0, shape[1], wide)]
    # What fills a tile up is equal to its left neighbours, from which samples are predicted, and so takes a bit per sample.
    pieces[-1] = np.pad(pieces[-1], ((0, 0), (0, wide - pieces[-1].shape[1]), (0, 0)), mode="edge")
    tiles = [lossless_jpeg(np.pad(piece, ((0, tall - len(codes)), (0, 0), (0, 0))), _BITS) for piece in pieces]
    strips: list[JpegStrip] = []
    if preview is not None:
        shown = (preview[top : top + STRIP_ROWS] for top in range(0, len(preview), STRIP_ROWS))
        strips += (encode_strip(rows, PREVIEW_QUALITY, "420") for rows in shown)
    return EncodedPart(tiles, tile_digests(codes), strips)


def _tile(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of a tile: a picture of one part is one strip, others have two tiles side by side."""
    if shape[0] <= PART:
        return shape
    # One tile would be wider than the picture if that is no multiple of 16: RawTherapee, like dcraw, then shears the picture.
    return PART, -(-shape[1] // (2 * _TILE)) * _TILE


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
    shape = picture.shape[0], picture.shape[1]
    check_sides(shape)
    parts = [encode_part(picture[top : top + PART], None, shape, white=white) for top in range(0, shape[0], PART)]
    return encode_tiff(join_parts(parts, shape, metadata, camera_to_xyz, neutral, preview, white=white))


def join_parts(
    parts: Sequence[EncodedPart],
    shape: tuple[int, int],
    metadata: CaptureMetadata,
    camera_to_xyz: ArrayLike | None,
    neutral: ArrayLike | None,
    preview: ByteArray | None = None,
    *,
    white: float = 1.0,
) -> Directory:
    """The DNG of a picture of this shape (H, W), to be written as a TIFF, from its parts in order; see `encode_picture_dng`.

    preview: None = the parts have it.
    """
    whole = (*shape, PICTURE_PLANES)
    fields = picture_fields(whole, _BITS, Compression.JPEG, Photometric.LINEAR_RAW) | {
        Tag.NEW_SUBFILE_TYPE: (FieldType.LONG, [0]),
        Tag.BLACK_LEVEL_REPEAT_DIM: (FieldType.SHORT, [1, 1]),
        Tag.BLACK_LEVEL: (FieldType.SHORT, [0] * 3),
        Tag.WHITE_LEVEL: (FieldType.SHORT, [_WHITE_CODE] * 3),
    }
    if len(parts) > 1:
        # Tiles: of several strips LibRaw reads only the first.
        del fields[Tag.ROWS_PER_STRIP]
        tall, wide = _tile(shape)
        fields |= {Tag.TILE_WIDTH: (FieldType.LONG, [wide]), Tag.TILE_LENGTH: (FieldType.LONG, [tall])}
    raw = Directory(fields, strips=[tile for part in parts for tile in part.tiles])
    digest = joined_digest(b"".join(part.digests for part in parts))
    shown = EncodedPreview(join_strips([strip for part in parts for strip in part.preview]), whole) if preview is None else preview
    main = main_directory(shown, metadata, f"{MAKER} render", raw, digest)
    main.fields.update(colour_fields(camera_to_xyz, neutral))
    main.fields[Tag.RAW_DATA_UNIQUE_ID] = FieldType.BYTE, picture_id(whole, digest).encode()
    main.fields[Tag.BASELINE_EXPOSURE] = FieldType.SRATIONAL, [math.log2(white)]
    return main
