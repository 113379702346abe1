"""Encode a rendered picture as a linear DNG with three samples per pixel, to be finished in a raw developer."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import ByteArray, FloatArray
from ..errors import InputError
from ..jpeg_writing import ROWS as STRIP_ROWS
from ..jpeg_writing import JpegStrip, encode_strip, join_strips
from ..metadata import CaptureMetadata
from ..tiff import Directory, FieldType
from .colour_tags import colour_fields
from .container import (
    DIGEST_TILE,
    PREVIEW_QUALITY,
    EncodedPreview,
    check_sides,
    joined_digest,
    main_directory,
    picture_fields,
    picture_id,
    tile_digests,
)
from .lossless_jpeg import encode_lossless
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


def encode_part(rgb: FloatArray, preview: ByteArray, shape: tuple[int, int]) -> EncodedPart:
    """Encode some rows of a picture in camera colours (three-sample LinearRaw, 16 bits, lossless).

    Parts are independent of each other, and may be encoded in parallel.

    rgb: (rows, W, 3) floats, linear camera RGB in scene units, in the orientation of the mosaic: `PART` rows, or what is left of
        the picture. Values below 0 and above 1 are clipped.
    preview: the same rows, (rows, W, 3) uint8 sRGB.
    shape: (H, W) of the picture.
    Raises InputError for values that are not finite, and for a side of more than 65500 pixels.
    """
    check_sides(shape)
    if not np.isfinite(rgb).all():
        raise InputError("the picture has values that are not finite (NaN or infinite)")
    scaled = rgb * np.float32(_WHITE_CODE)
    codes = np.rint(scaled, out=scaled).clip(0, _WHITE_CODE, out=scaled).astype(np.uint16, order="C")
    tall, wide = _tile(shape)
    pieces = [codes[:, left : left + wide] for left in range(0, shape[1], wide)]
    # What fills a tile up is equal to its left neighbours, from which samples are predicted, and so takes a bit per sample.
    pieces[-1] = np.pad(pieces[-1], ((0, 0), (0, wide - pieces[-1].shape[1]), (0, 0)), mode="edge")
    tiles = [encode_lossless(np.pad(piece, ((0, tall - len(codes)), (0, 0), (0, 0))), _BITS) for piece in pieces]
    shown = (preview[top : top + STRIP_ROWS] for top in range(0, len(preview), STRIP_ROWS))
    strips = [encode_strip(rows, PREVIEW_QUALITY, "420") for rows in shown]
    return EncodedPart(tiles, tile_digests(codes), strips)


def _tile(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of a tile: a picture of one part is one strip, others have two tiles side by side."""
    if shape[0] <= PART:
        return shape
    # One tile would be wider than the picture if that is no multiple of 16: RawTherapee, like dcraw, then shears the picture.
    return PART, -(-shape[1] // (2 * _TILE)) * _TILE


def join_parts(
    parts: Sequence[EncodedPart],
    shape: tuple[int, int],
    metadata: CaptureMetadata,
    camera_to_xyz: ArrayLike | None,
    neutral: ArrayLike | None,
) -> Directory:
    """The DNG of a picture of this shape (H, W), to be written as a TIFF, from its parts in order.

    metadata: capture data.
    camera_to_xyz: 3 x 3, camera RGB -> XYZ (D50 white); None = a nominal matrix.
    neutral: reading of white in the 3 channels; None = unknown.
    Raises InputError for a matrix or a neutral that cannot be.
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
    shown = EncodedPreview(join_strips([strip for part in parts for strip in part.preview]), whole)
    main = main_directory(shown, metadata, f"{MAKER} render", raw, digest)
    main.fields.update(colour_fields(camera_to_xyz, neutral))
    main.fields[Tag.RAW_DATA_UNIQUE_ID] = FieldType.BYTE, picture_id(whole, digest).encode()
    main.fields[Tag.BASELINE_EXPOSURE] = FieldType.SRATIONAL, [0.0]
    return main
