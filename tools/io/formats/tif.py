"""TIFF 6.0, and linear DNG, which is one: both go to the file in bands.

TIFF: 8 bits are compressed with LZW, the others are not: noise in the last bits makes LZW larger
than that, and TIFF 6.0 has nothing better; Deflate came later.

Linear DNG: three samples per pixel (LinearRaw, 16 bits, lossless), to finish in a raw developer.
Code 65535 stands for 1.0 in all files: the brightness does not depend on the picture's brightest
spot, and raw developers find clipped highlights at the white level and make them white.
"""

from collections.abc import Iterable
from math import log2
from typing import Any, BinaryIO, ClassVar

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from ....shared import ByteArray, CodeArray, FloatArray, InputError
from ....shared.dng import container
from ....shared.dng.colour_tags import colour_fields
from ....shared.dng.lossless_jpeg import encode_lossless
from ....shared.dng.tags import LONGEST_SIDE, MAKER, PICTURE_PLANES, TAG, Compression, Photometric
from ....shared.tiff import Directory, FieldType, write_tiff
from ..ahead import WAITING, ahead
from ..development import CAMERA, Bands, Development, Format
from ..display import display_codes, joined, quantise, regrouped

_STRIP_ROWS = 64

_LZW, _HORIZONTAL, _UNSIGNED, _FLOAT, _BLACK_IS_ZERO, _RGB = 5, 2, 1, 3, 1, 2

CHUNK_ROWS = container.DIGEST_TILE
"""Rows of a chunk of a picture."""
_PICTURE_BITS, _WHITE_CODE = 16, 65535
_TILE = 16  # TIFF 6.0: sides of tiles are multiples of this
_MEMORY_OF_CHUNK = 30.0  # bytes per pixel of a chunk that waits or is compressed


class Tiff(Format):
    """TIFF; each band goes to the file as it comes.

    Raises InputError for files that would exceed 4 GiB.
    """

    name, aliases = "tif", ("tiff",)
    spaces: ClassVar = {"srgb": (16, 8), "display-p3": (16, 8), "linear-srgb": (32,), CAMERA: (32,)}
    # the bands that wait take less than the planes of the frame that are no longer needed then
    in_bands = True

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        bits, channels = development.kind.bits, len(development.channels)
        rgb, shape = development.channels == "RGB", (*development.written_shape, channels)
        compression = _LZW if bits == 8 else Compression.NONE
        directory = development.directory
        colours = _RGB if rgb else _BLACK_IS_ZERO
        directory.fields |= container.picture_fields(shape, bits, compression, colours)
        sample = _FLOAT if bits == 32 else _UNSIGNED
        directory.fields[TAG["SampleFormat"]] = FieldType.SHORT, [sample] * channels
        directory.fields[TAG["RowsPerStrip"]] = FieldType.LONG, [_STRIP_ROWS]
        if bits == 8:
            directory.fields[TAG["Predictor"]] = FieldType.SHORT, [_HORIZONTAL]
        if extra := channels - (3 if rgb else 1):
            directory.fields[TAG["ExtraSamples"]] = FieldType.SHORT, [0] * extra
        if development.icc:
            directory.fields[TAG["InterColorProfile"]] = FieldType.UNDEFINED, development.icc
        rows = regrouped(bands, _STRIP_ROWS)
        strips = ahead(_lzw_strip, rows, threads) if bits == 8 else map(_plain_strip, rows)
        write_tiff(file, directory, strips)


def _plain_strip(rows: NDArray[Any]) -> memoryview:
    return np.ascontiguousarray(rows, rows.dtype.newbyteorder("<")).data.cast("B")


def _lzw_strip(rows: NDArray[Any]) -> bytes:
    differences = imagecodecs.delta_encode(np.ascontiguousarray(rows), axis=-2)
    return bytes(imagecodecs.lzw_encode(differences.tobytes()))


class LinearDng(Format):
    """Linear DNG, with the colours and the white of our own rendering; raw developers turn it. Only
    what is compressed, and the preview, is held.
    """

    name = "dng"
    spaces: ClassVar = {CAMERA: (16,)}
    about = "linear, to finish in a raw developer"
    in_bands = True
    longest_side = LONGEST_SIDE
    memory_per_pixel = 10.0  # of noise; pictures take two thirds of that

    def check(self, development: Development) -> None:
        """Implement `Format`."""
        channels = development.calibration.channels
        if len(channels) != 3:
            held = f"dng holds pictures of 3 channels, the sensor has {channels}"
            raise InputError(f"{held}; use tif, exr or npy")
        super().check(development)

    def memory(self, shape: tuple[int, int], channels: int, rendering: int, threads: int) -> float:
        """Implement `Format`."""
        chunks = _MEMORY_OF_CHUNK * min(CHUNK_ROWS * (threads + WAITING + 1), shape[0]) * shape[1]
        return super().memory(shape, channels, rendering, threads) + chunks

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`. What is saturated, and not restored, gets the white level in every
        channel.
        """
        shown, shape = development.shown, development.shape
        tiles, digests = list[bytes](), list[bytes]()

        def encoded(rgb: FloatArray) -> tuple[list[bytes], bytes, ByteArray]:
            # as at the exposure at which the brightest white that is measured is display white
            rgb = shown.whitened(rgb, shown.saturated(rgb), -log2(shown.brightest))
            return *encode_chunk(rgb, shape), display_codes(rgb, shown, 8)

        def previews() -> Iterable[ByteArray]:
            for chunk, digest, preview in ahead(encoded, regrouped(bands, CHUNK_ROWS), threads):
                tiles.extend(chunk)
                digests.append(digest)
                yield preview

        preview = joined(previews(), shape[0])
        main = linear_dng(tiles, digests, preview, development)
        write_tiff(file, main, main.strips)


def encode_chunk(rgb: FloatArray, shape: tuple[int, int]) -> tuple[list[bytes], bytes]:
    """Encode some rows of a picture in camera colours: return the tiles, from left to right, and
    the digests of the samples. Chunks are independent of each other.

    Parameters
    ----------
    rgb : FloatArray
        (rows, W, 3) floats, linear camera RGB in scene units, in the orientation of the mosaic:
        `CHUNK_ROWS` rows, or what is left of the picture. Values below 0 and above 1 are clipped.
    shape : tuple[int, int]
        (H, W) of the picture.
    """
    codes = quantise(rgb, _PICTURE_BITS).astype(np.uint16, copy=False)
    height, width = _tile(shape)
    # What fills a tile up is equal to its left neighbours, from which samples are predicted, and so
    # takes a bit per sample.
    padded: CodeArray = np.pad(codes, ((0, 0), (0, -shape[1] % width), (0, 0)), mode="edge")
    padded = np.pad(padded, ((0, height - len(codes)), (0, 0), (0, 0)))
    lefts = range(0, shape[1], width)
    tiles = [encode_lossless(padded[:, left : left + width], _PICTURE_BITS) for left in lefts]
    return tiles, container.tile_digests(codes)


def _tile(shape: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of a tile: a picture of one chunk is one strip, others have two tiles side
    by side.
    """
    if shape[0] <= CHUNK_ROWS:
        return shape
    # One tile would be wider than the picture if that is no multiple of 16: RawTherapee, like
    # dcraw, then shears the picture.
    return CHUNK_ROWS, -(-shape[1] // (2 * _TILE)) * _TILE


def linear_dng(
    tiles: list[bytes], digests: list[bytes], preview: ByteArray, development: Development
) -> Directory:
    """Return the DNG of a picture, to be written as a TIFF.

    tiles: of all chunks, in order. digests: of each chunk. preview: the picture as uint8 sRGB
    (H, W, 3). development: of colours and capture data.
    """
    shape = preview.shape[0], preview.shape[1], PICTURE_PLANES
    kind = Compression.JPEG, Photometric.LINEAR_RAW
    fields = container.picture_fields(shape, _PICTURE_BITS, *kind) | {
        TAG["NewSubfileType"]: (FieldType.LONG, [0]),
        TAG["BlackLevelRepeatDim"]: (FieldType.SHORT, [1, 1]),
        TAG["BlackLevel"]: (FieldType.SHORT, [0] * 3),
        TAG["WhiteLevel"]: (FieldType.SHORT, [_WHITE_CODE] * 3),
    }
    if len(digests) > 1:
        # Tiles: of several strips LibRaw reads only the first.
        del fields[TAG["RowsPerStrip"]]
        height, width = _tile(shape[:2])
        fields[TAG["TileWidth"]] = FieldType.LONG, [width]
        fields[TAG["TileLength"]] = FieldType.LONG, [height]
    raw, digest = Directory(fields, strips=tiles), container.md5(b"".join(digests))
    shown = development.shown
    main = container.main_directory(preview, development.noted, f"{MAKER} render", raw, digest)
    main.fields |= colour_fields(shown.space.to_xyz @ np.array(shown.matrix), shown.white)
    identity = container.picture_id(shape, digest).encode()
    main.fields[TAG["RawDataUniqueID"]] = FieldType.BYTE, identity
    main.fields[TAG["BaselineExposure"]] = FieldType.SRATIONAL, [0.0]
    return main
