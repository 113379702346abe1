"""DNGs as scenes: linear ones, and the corrections that any of them asks for, which are not made.

A linear DNG has three samples per pixel, as `panchroma render -f dng`, Adobe's DNG Converter and
Lightroom write them.
"""

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tifffile import TiffPage

from ...shared import DoubleArray, FloatArray, InputError
from ...shared.dng.reader import DngReader
from ...shared.dng.tags import PICTURE_PLANES, TAG, Compression, Photometric, tags_of
from ...shared.tiff_reading import check_page
from ...shared.white_balance import clipped_share
from .camera_raw import camera_scene
from .clipped import SHOULDER, saturation
from .damage import check_strips, data_bytes, guarded
from .decoders import remark_on_unused
from .scene import Scene, check_size
from .tiff import beside, opened_tiff, tag_numbers

# Corrections that a DNG asks for (DNG 1.7.1, chapter 7), such as a gain map against dark corners.
_LISTS = "OpcodeList1", "OpcodeList2", "OpcodeList3"
# nothing else is, such as an original RAW inside
_READ = tags_of(
    "LinearizationTable BlackLevelRepeatDim BlackLevel BlackLevelDeltaH BlackLevelDeltaV "
    "WhiteLevel ActiveArea DefaultCropOrigin DefaultCropSize BaselineExposure " + " ".join(_LISTS)
)
_DEFLATE = (8, 32946)
_LARGE_TILE = 1024  # pixels: larger tiles than this are never larger than the picture


def linear_dng_scene(path: Path, max_pixels: int) -> tuple[Scene | None, tuple[str, ...]]:
    """Read the scene in a DNG whose main picture has three linear samples per pixel, None if it has
    a mosaic; and notes for the user on what any DNG has beside its main picture, and on the
    corrections that it asks for and that are not made.

    rgb is (sample - black) / (white - black) of the default crop of the active area, after the
    linearization table. It is neither rotated nor white-balanced, and not brightened by
    BaselineExposure. Values below black become 0, values above white exceed 1. Integers at the
    white level, or a lower limit of their plane, are clipped, and become white (see `clipped`).
    Matrix, neutral and orientation are the file's. Lossless JPEG and Deflate are read (DNG 1.7.1,
    chapter 4), integers and floating point.

    max_pixels: larger files are refused. Raises InputError for JPEG XL, lossy JPEG and rare
    compressions, for impossible levels, and for a damaged file.
    """
    with opened_tiff(path, _READ) as (stream, file, _):
        with guarded():
            pages = (file.pages.first, *(file.pages.first.pages or ()))
        pictures = [page for page in pages if isinstance(page, TiffPage) and page.subfiletype == 0]
        notes = _remarks(pages, pictures)
        kind = Photometric.LINEAR_RAW, PICTURE_PLANES
        linear = [one for one in pictures if (one.photometric, one.samplesperpixel) == kind]
        if not linear:  # the main picture is another
            return None, notes
        page = max(linear, key=lambda one: one.imagewidth * one.imagelength)
        _check(page, stream, path, max_pixels)
        integers = page.dtype is not None and page.dtype.kind == "u"
        if integers and page.compression in tuple(Compression):
            samples = DngReader(stream, file).samples(max_pixels, PICTURE_PLANES, page)
        else:
            with guarded(path):
                samples = page.asarray(maxworkers=1)
        rgb, limits = _levelled(samples, page)
    gone = clipped_share(rgb, limits, SHOULDER) if integers else None
    return camera_scene(path, rgb, gone, {}), notes


def _check(page: TiffPage, stream: Any, path: Path, max_pixels: int) -> None:
    """Raise InputError for samples that are not read, whose declared sizes are impossible, or which
    inflate to more than they should hold, for which tifffile has no limit.
    """
    if page.compression not in (*Compression, *_DEFLATE):
        kind = getattr(page.compression, "name", page.compression)
        fault = "which is not read; export it without JPEG XL, with lossless compression"
        raise InputError(f"the linear DNG is compressed by {kind}, {fault}")
    check_page(page)
    kind, planes = page.dtype, " in separate planes" if page.planarconfig != 1 else ""
    if planes or kind is None or kind.itemsize > {"u": 2, "f": 4}.get(kind.kind, 0):
        stored = f"the samples of the linear DNG are {page.bitspersample} bits {kind}{planes}"
        raise InputError(f"{stored}; expected interleaved integers up to 16 bits or floating point")
    columns, rows = page.imagewidth, page.imagelength
    check_size(columns, rows, PICTURE_PLANES * kind.itemsize, data_bytes(path), max_pixels)
    check_strips(page.dataoffsets, page.databytecounts, path.stat().st_size, columns * rows)
    sides = (page.tilewidth, columns), (page.tilelength, rows)
    if page.is_tiled and any(tile > max(side, _LARGE_TILE) for tile, side in sides):
        reason = "its tiles are larger than its picture; copy it again"
        raise InputError(f"the linear DNG is damaged: {reason}")
    rows = min(page.rowsperstrip, rows)
    if page.is_tiled:
        rows, columns = page.tilelength, page.tilewidth
    most = rows * -(-columns * PICTURE_PLANES * page.bitspersample // 8)
    chunks = zip(page.dataoffsets, page.databytecounts, strict=True)
    for offset, count in chunks if page.compression in _DEFLATE else ():
        stream.seek(offset)
        with guarded():
            inflated = zlib.decompressobj().decompress(stream.read(count), most + 1)
        if len(inflated) > most:
            reason = "it is damaged, or made to fill the memory"
            raise InputError(f"the linear DNG's strips hold more than they say: {reason}")


def _levelled(samples: NDArray[Any], page: TiffPage) -> tuple[FloatArray, FloatArray]:
    """Return the active area of the samples in scene units, float32 (H, W, 3); and the value at
    which each plane is clipped.
    """
    floating = samples.dtype.kind == "f"
    table = tag_numbers(page, "LinearizationTable")
    if table.size and not floating:
        samples = table.astype(np.float32)[np.minimum(samples, table.size - 1)]
    rgb: FloatArray = samples.astype(np.float32)
    if (area := tag_numbers(page, "ActiveArea")).size == 4:
        top, left, bottom, right = area.astype(int).tolist()
        if not (0 <= top < bottom <= rgb.shape[0] and 0 <= left < right <= rgb.shape[1]):
            reason = "the file is damaged; copy it again"
            raise InputError(f"the active area is outside the picture: {reason}")
        rgb = rgb[top:bottom, left:right]
    black = _black(page, rgb.shape)
    default = 1.0 if floating else float((1 << page.bitspersample) - 1)
    stated = tag_numbers(page, "WhiteLevel")
    white = np.resize(stated, 3) if stated.size else np.full(3, default)
    lowest = black.reshape(-1, 3).max(axis=0)
    if not (np.isfinite(black).all() and np.isfinite(white).all() and (lowest < white).all()):
        levels = f"black level {lowest.max():g} is not below white level {white.min():g}"
        raise InputError(f"{levels}: the file's levels are damaged")
    limits = white
    if samples.dtype in (np.uint8, np.uint16):  # a table, such as of a logarithm, makes gaps
        planes = zip(np.moveaxis(samples, 2, 0), white, lowest, strict=True)
        limits = np.array([saturation(*plane) for plane in planes])
    scaled: FloatArray = ((limits - lowest) / (white - lowest)).astype(np.float32)
    rgb = (rgb - black.astype(np.float32)) * (1 / (white - lowest)).astype(np.float32)
    return np.maximum(rgb, 0, out=rgb)[_default_crop(page, rgb.shape)], scaled


def _default_crop(page: TiffPage, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the rows and columns that the file shows, of an active area of this shape (H, W, 3):
    all without a crop, or with one that does not lie inside.
    """
    origin, size = tag_numbers(page, "DefaultCropOrigin"), tag_numbers(page, "DefaultCropSize")
    everything = slice(None), slice(None)
    if origin.size != 2 or size.size != 2 or not np.isfinite([*origin, *size]).all():
        return everything
    (left, top), (width, height) = np.rint([origin, size]).astype(int).tolist()
    inside = 0 <= top < top + height <= shape[0] and 0 <= left < left + width <= shape[1]
    return (slice(top, top + height), slice(left, left + width)) if inside else everything


def _black(page: TiffPage, shape: tuple[int, ...]) -> DoubleArray:
    """Return the black level, one that can be subtracted from a picture of this shape (H, W, 3)."""
    period = tag_numbers(page, "BlackLevelRepeatDim").astype(int).tolist() or [1, 1]
    rows, columns = (period * 2)[:2] if min(period) > 0 else (0, 0)
    stated = tag_numbers(page, "BlackLevel")
    if stated.size not in (0, 1, rows * columns * 3):
        levels = f"{stated.size} black levels for {rows} x {columns} pixels"
        raise InputError(f"{levels}: the file is damaged; copy it again")
    black: DoubleArray = np.full((1, 1, 3), stated.sum())
    if stated.size > 1:
        black = stated.reshape(rows, columns, 3)
        if rows * columns > 1:
            black = black[np.arange(shape[0]) % rows][:, np.arange(shape[1]) % columns]
    for name, axis in (("BlackLevelDeltaH", 1), ("BlackLevelDeltaV", 0)):
        if (delta := tag_numbers(page, name)).size == shape[axis]:
            black = black + np.expand_dims(delta, (1 - axis, 2))
    return black


def _remarks(pages: Sequence[Any], pictures: Sequence[TiffPage]) -> tuple[str, ...]:
    """Return notes for the user, see `linear_dng_scene`.

    pages: the first directory, and those below it. pictures: those of them that are no previews.
    """
    notes, stops = list[str](), float(tag_numbers(pages[0], "BaselineExposure").sum())
    remark_on_unused(beside(pages), notes)
    if names := [name for name in _LISTS if any(TAG[name] in page.tags for page in pictures)]:
        advice = "a linear TIFF of a raw developer has them"
        asked = f"the file asks for corrections that are not made ({', '.join(names)})"
        notes.append(f"{asked}: {advice}")
    if stops and any(page.photometric == Photometric.LINEAR_RAW for page in pictures):
        asked = f"the file asks to be shown {stops:+.3g} stops brighter (BaselineExposure)"
        notes.append(f"{asked}: the scene is as measured, its white level is 1.0")
    return tuple(notes)
