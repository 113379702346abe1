"""Decoders: picture files to arrays as stored. One function per format; each checks the declared size before decoding pixels.

Call them in a `guarded` block: then they raise InputError, whatever the decoding library raises. The messages do not name the file:
the caller does.
"""

import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared import CaptureMetadata
from shared.colorimetry import as_rows, primaries_to_xyz
from shared.errors import InputError
from shared.jpeg_check import read_header
from shared.reading import MAX_PIXELS, data_bytes
from shared.tiff_check import PLAIN, check_directories, check_pieces

from .exif_reading import picture_metadata, tiff_metadata
from .icc_reading import LINEAR, SRGB, Encoding, power_curve, read_profile
from .limited import run_limited
from .png_chunks import picture_chunks
from .scene import RGB, check_size, scene_channels

_ICC_PROFILE = 34675  # TIFF tag
_ALPHA = (1, 2)  # ExtraSamples: associated and unassociated
_MOST_SAMPLES = 4  # of a picture: RGB and transparency
_MOST_PAGES = 26  # one more than a pattern has channels
_MOST_PER_PIXEL, _MOST_BESIDE = 16, 32 << 20  # bytes of a PNG: twice its samples; profile, texts and capture data
_LARGEST_WEBP, _LARGEST_JPEG = 64 << 20, 1 << 30  # bytes, read whole; the longest side of a WebP is 16383 pixels
# None, LZW, Deflate (two codes), PackBits, LZMA, Zstandard. All others declare a size of their own, which decoders believe.
_COMPRESSIONS = (1, 5, 8, 32946, 32773, 34925, 50000)
_SMALL = 1 << 22  # pixels of all tiles together that are harmless, however small the picture
_NPY_HEADER = 1 << 16
_PNG_HEADER = 26  # signature, then IHDR's length, name, width, height, bit depth and colour type
_MODES = ("1", "L", "LA", "La", "P", "PA", "RGB", "RGBA", "RGBa", "RGBX")
_NO_ALPHA = "transparency is left out"
_UNREADABLE_PROFILE = "the embedded colour profile is damaged or of a kind this program does not read (tables); it is ignored"


@dataclass(frozen=True, eq=False)
class Decoded:
    """A decoded picture, its values as stored in the file.

    pixels: (H, W, C), C = 1 for a grey picture, otherwise one for each channel.
    peak: the integer that stands for 1.0; None for floating point.
    encoding: how the file says its values are encoded; None if it does not say.
    metadata: capture data.
    notes: remarks for the user, such as what was left out.
    channels: letters of the channels; a grey picture has them all alike.
    """

    pixels: NDArray[Any]
    peak: int | None
    encoding: Encoding | None = None
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)
    notes: tuple[str, ...] = ()
    channels: str = RGB


@contextmanager
def guarded(path: Path) -> Iterator[None]:
    """Raise only InputError in a `with` block that decodes a file: on damaged files the libraries raise nearly everything."""
    try:
        with _quiet_libraries():
            yield
    except InputError:
        raise
    except MemoryError:
        raise InputError("the picture does not fit into memory; cut or reduce it") from None
    except Exception as error:
        said = error.args[0] if error.args else ""
        lines = (said.decode("ascii", "replace") if isinstance(said, bytes) else str(error)).strip().splitlines()
        reason = lines[0] if lines else type(error).__name__
        reason = re.sub(r"<_io.*?>", "", reason.replace(f"'{path}'", "")).strip()  # whoever shows the error names the file
        raise InputError(f"cannot be decoded ({reason}): the file is cut short or damaged; copy it again") from error


@contextmanager
def _quiet_libraries() -> Iterator[None]:
    """Silence standard error for C code: LibRaw and OpenEXR print there what we report as one line."""
    try:
        kept = os.dup(2)
    except OSError:  # standard error is closed
        yield
        return
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def decode_png(path: Path, max_pixels: int = MAX_PIXELS) -> Decoded:
    """Decode a PNG of any kind. 16-bit colour goes through libpng, because Pillow would reduce it to 8 bits."""
    with path.open("rb") as file:
        header = file.read(_PNG_HEADER).ljust(_PNG_HEADER, b"\0")
    width, height = (int.from_bytes(header[start : start + 4], "big") for start in (16, 20))
    wide = header[24] == 16
    check_size(width, height, 8 if wide else 4, data_bytes(path), max_pixels)
    png = picture_chunks(path, _MOST_PER_PIXEL * width * height + _MOST_BESIDE)
    if not wide:
        return _with_pillow(png, max_pixels)
    import imagecodecs

    pixels, notes = _without_alpha(imagecodecs.png_decode(png))
    with _pillow().open(BytesIO(png)) as image:
        return _described(image, pixels, 65535, notes)


def decode_jpeg(path: Path, max_pixels: int = MAX_PIXELS) -> Decoded:
    """Decode a JPEG."""
    jpeg = _read(path, _LARGEST_JPEG, "JPEG")
    header = read_header(jpeg)
    check_size(header.columns, header.rows, 4, data_bytes(path), max_pixels)
    header.check(max_pixels)
    # Pillow would parse every Exif directory when it opens the file.
    picture = _with_pillow(jpeg.replace(b"Exif\0\0", b"Read\0\0"), max_pixels)
    return replace(picture, metadata=picture_metadata({"exif": header.exif}))


def decode_webp(path: Path, max_pixels: int = MAX_PIXELS) -> Decoded:
    """Decode a WebP; of an animation the first picture."""
    webp = _read(path, _LARGEST_WEBP, "WebP")
    width, height = _webp_size(webp)
    check_size(width, height, 4, data_bytes(path), max_pixels)
    return _with_pillow(webp, max_pixels)


def _read(path: Path, largest: int, kind: str) -> bytes:
    if path.stat().st_size > largest:
        raise InputError(f"is larger than {largest} bytes, more than any {kind} needs: it is damaged; if not, save it as PNG")
    return path.read_bytes()


def _with_pillow(data: bytes, max_pixels: int) -> Decoded:
    """Decode an 8-bit PNG, a JPEG or a WebP whose declared size has been checked."""
    # Invalid capture data cause warnings.
    with warnings.catch_warnings(action="ignore"), _pillow().open(BytesIO(data), formats=("PNG", "JPEG", "WEBP")) as image:
        width, height = image.size
        check_size(width, height, 4, len(data), max_pixels)
        if image.mode not in _MODES:
            raise InputError(f"the picture is of kind {image.mode} (CMYK, Lab, ...); convert it to RGB or grey")
        transparent = "A" in image.getbands() or "transparency" in image.info
        grey = image.mode in {"1", "L", "LA", "La"}
        pixels = np.atleast_3d(np.asarray(image.convert("L" if grey else "RGB")))
        return _described(image, pixels, 255, (_NO_ALPHA,) if transparent else ())


def decode_tiff(path: Path, max_pixels: int = MAX_PIXELS, channels: str = RGB) -> Decoded:
    """Decode the first page of a TIFF, integer or floating point: grey, RGB, or a sample for each of `channels`.

    Pages with one sample each, all of one size and kind, are taken together as such samples.
    """
    import tifffile

    size, held = path.stat().st_size, data_bytes(path)
    with path.open("rb") as stream:
        several = check_directories(stream, {*tifffile.TIFF.TAG_LOAD, _ICC_PROFILE})
    with tifffile.TiffFile(path, **PLAIN) as file:
        first: Any = file.pages[0]
        if first.photometric not in {tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB}:
            raise InputError(
                f"the TIFF is of kind {getattr(first.photometric, 'name', first.photometric)}; convert it to RGB or grey"
            )
        pages = [first]
        if several and first.samplesperpixel == 1:
            with path.open("rb") as stream:
                check_directories(stream, tifffile.TIFF.TAG_LOAD, _MOST_PAGES)
            pages = _stack(file)
        samples = first.samplesperpixel
        if not samples or first.imagedepth != 1 or first.tiledepth != 1:
            raise InputError(f"the TIFF has {samples} samples per pixel and {first.imagedepth} planes in depth; expected a picture")
        alpha = any(kind in _ALPHA for kind in first.extrasamples)
        colour = first.photometric == tifffile.PHOTOMETRIC.RGB
        found, notes = _channels(samples * len(pages), channels, alpha=alpha, colour=colour, pages=len(pages))
        pixel_bytes = max(samples * len(pages), 3) * max(1, first.bitspersample // 8)  # a grey scene has three planes as well
        check_size(first.imagewidth, first.imagelength, pixel_bytes, held, max_pixels)
        offsets, lengths = ([each for page in pages for each in getattr(page, name)] for name in ("dataoffsets", "databytecounts"))
        check_pieces(offsets, lengths, size, first.imagewidth * first.imagelength * len(pages))
        pixels = _page_pixels(first) if len(pages) == 1 else np.concatenate([_page_pixels(page) for page in pages], axis=-1)
        if not found:
            pixels, remarks = _without_alpha(pixels)
            notes += remarks
        if several and len(pages) == 1:
            notes += ("the file has several pages; only the first is used",)
        peak = (1 << first.bitspersample) - 1 if pixels.dtype.kind == "u" else None
        profile = first.tags.get(_ICC_PROFILE)
        encoding, remarks = _profile_encoding(profile and profile.value)
    return Decoded(pixels, peak, encoding, tiff_metadata(path), notes + remarks, found or RGB)


def _stack(file: Any) -> list[Any]:
    """The pages of a TIFF, `_MOST_PAGES` at most, if all have the same size and kind; otherwise the first alone."""
    pages: list[Any] = []
    with suppress(IndexError):  # len(file.pages) would follow the directories, however many there are
        while len(pages) < _MOST_PAGES:
            pages.append(file.pages[len(pages)])
    kinds = {(page.shape, page.samplesperpixel, page.bitspersample, page.dtype, page.photometric) for page in pages}
    return pages if len(kinds) == 1 else pages[:1]


def _page_pixels(page: Any) -> NDArray[Any]:
    """The samples of a page, (H, W, C)."""
    if page.compression not in _COMPRESSIONS:
        name = getattr(page.compression, "name", page.compression)
        raise InputError(f"the TIFF is compressed with {name}; save it with LZW or ZIP (Deflate) compression, or with none")
    if page.is_tiled:  # tiles are decoded whole, also where they lie outside the picture
        covered, pixels = page.tilewidth * page.tilelength * len(page.dataoffsets), page.imagewidth * page.imagelength
        if covered > max(_SMALL, 4 * page.samplesperpixel * pixels):
            raise InputError(f"the tiles of the TIFF hold {covered} pixels, the picture {pixels}: it is made to fill the memory")
    samples: NDArray[Any] = page.asarray(maxworkers=1)
    return np.moveaxis(samples, 0, -1) if page.axes.startswith("S") else np.atleast_3d(samples)


def decode_exr(path: Path, max_pixels: int = MAX_PIXELS, channels: str = RGB) -> Decoded:
    """Decode `channels`, what they can be made from, or Y, of the first part of an OpenEXR file; its values are linear."""
    # OpenEXR takes tiles, attributes and further parts of whatever size they declare.
    pixels, found, chromaticities = run_limited(path, ("OpenEXR",), _read_exr, path, max_pixels, channels)
    if pixels.dtype.kind != "f":
        raise InputError(f"the EXR holds whole numbers ({pixels.dtype}), which are labels and no light; save it as half or float")
    if chromaticities is None:
        return Decoded(pixels, None, channels=found)
    red, green, blue, white = chromaticities
    matrix = as_rows(primaries_to_xyz((red, green, blue), white))
    return Decoded(pixels, None, Encoding(LINEAR.curves, matrix, "the file's chromaticities"), channels=found)


def _read_exr(path: Path, max_pixels: int, wanted: str) -> tuple[NDArray[Any], str, list[tuple[float, float]] | None]:
    """Return the pixels (H, W, C), their letters, and x, y of red, green, blue and white if the file has them."""
    with guarded(path):
        import OpenEXR

        header = OpenEXR.File(str(path), header_only=True).header()
        (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in header["dataWindow"])
        names = {channel.name for channel in header["channels"]}
        choices = [wanted, scene_channels(wanted), RGB]  # the filters' own channels before those they can be made from
        found = next((each for each in choices if set(each) <= names), "Y")
        if not set(found) <= names or "RY" in names:
            expected = "R, G, B" if wanted == RGB else f"{', '.join(wanted)}, or R, G, B"
            raise InputError(f"the EXR has the channels {', '.join(sorted(names))[:200]}; expected {expected}, or Y alone")
        check_size(right - left + 1, bottom - top + 1, 4 * len(names), data_bytes(path), max_pixels)
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        pixels = np.stack([channels[name].pixels for name in found], axis=-1)
        primaries = header.get("chromaticities")
        corners = None if primaries is None else [(x, y) for x, y in np.reshape(primaries, (4, 2)).tolist()]
        return pixels, RGB if found == "Y" else found, corners


def decode_npy(path: Path, max_pixels: int = MAX_PIXELS, channels: str = RGB) -> Decoded:
    """Decode a NumPy array (H, W) or (H, W, C) of unsigned integers or floating point. Pickled objects are refused.

    C is 1 (grey), 3 (RGB), 2 or 4 (with transparency), or the number of `channels`, which are then taken in this order.
    """
    with path.open("rb") as file:
        start = file.read(12)
    # NumPy reads a header of the length that the file declares, in two bytes in version 1, in four in later versions.
    if start[6:7] != b"\1" and int.from_bytes(start[8:12], "little") > _NPY_HEADER:
        raise InputError("the array's header declares an impossible length: the file is damaged, or made to fill the memory")
    stored = np.load(path, mmap_mode="r", allow_pickle=False)
    if stored.ndim in (2, 3):
        check_size(stored.shape[1], stored.shape[0], stored[:1, :1].nbytes, data_bytes(path), max_pixels)
    return decode_array(stored, channels)


def decode_array(array: NDArray[Any], channels: str = RGB) -> Decoded:
    """The picture in an array, of the shapes, types and channels that `decode_npy` reads; a copy."""
    if array.ndim not in (2, 3) or array.dtype.kind not in "uf" or (array.ndim == 3 and not array.shape[2]):
        raise InputError(
            f"the array is {array.dtype} of shape {array.shape}; "
            "expected unsigned integers or floating point, (rows, columns) or (rows, columns, channels)"
        )
    found, notes = _channels(array.shape[2] if array.ndim == 3 else 1, channels)
    pixels = np.array(array)
    if not found:
        pixels, notes = _without_alpha(pixels)
    return Decoded(pixels, np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else None, notes=notes, channels=found or RGB)


def _channels(count: int, wanted: str, *, alpha: bool = False, colour: bool = False, pages: int = 1) -> tuple[str, tuple[str, ...]]:
    """Which channels `count` samples per pixel without names are: `wanted`, "" for a grey or RGB picture; and notes.

    alpha: one of them is declared to be transparency.
    colour: three of them are declared to be red, green and blue.
    pages: that they come from.
    Raises InputError when there are more samples than a picture has, and another number than `wanted`.
    """
    stacked = f"{pages} pages" if pages > 1 else f"{count} channels"
    if pages == _MOST_PAGES:
        stacked += " or more"
    of_rgb = set(scene_channels(wanted)) <= set(RGB)
    if count == len(wanted) and not alpha and not (count == len(RGB) and (colour or of_rgb)):
        return wanted, (f"its {stacked} have no names: they are taken as linear light of {', '.join(wanted)}, in this order",)
    if pages > 1 and count == len(RGB) and of_rgb:
        return "", (f"its {stacked} are taken for red, green and blue",)
    if count > 1 and (count > _MOST_SAMPLES or pages > 1 or not (of_rgb or colour or alpha)):
        raise InputError(
            f"has {stacked}, and the pattern the {len(wanted)} channels {wanted}; a scene has as many channels as the pattern "
            "(`pattern`), or red, green and blue"
        )
    return "", ()


def _webp_size(webp: bytes) -> tuple[int, int]:
    """Return the width and height that a WebP declares, before libwebp makes room for them (RFC 9649, 2.5 to 2.7)."""
    kind, word = webp[12:16], partial(int.from_bytes, byteorder="little")
    if kind == b"VP8X":
        return 1 + word(webp[24:27]), 1 + word(webp[27:30])
    if kind == b"VP8L":
        bits = word(webp[21:25])
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    return word(webp[26:28]) & 0x3FFF, word(webp[28:30]) & 0x3FFF


def _pillow() -> ModuleType:
    """Return the module PIL.Image with its own size limit switched off: `check_size` runs before anything is decoded."""
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None
    return Image


def _described(image: Any, pixels: NDArray[Any], peak: int, notes: tuple[str, ...]) -> Decoded:
    """Return the pixels with what Pillow's `image` says about them: encoding and capture data."""
    encoding, remarks = _png_encoding(image.info)
    return Decoded(pixels, peak, encoding, picture_metadata(image.info), notes + remarks)


def _without_alpha(pixels: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Return (H, W) or (H, W, 1 to 4) without a transparency channel, (H, W, 1 or 3), and notes."""
    pixels = np.atleast_3d(pixels)
    return (pixels, ()) if pixels.shape[2] in (1, 3) else (pixels[..., :-1], (_NO_ALPHA,))


def _png_encoding(info: dict[Any, Any]) -> tuple[Encoding | None, tuple[str, ...]]:
    """Return the encoding that Pillow's `info` declares, and notes: profile before sRGB before gamma (PNG, third edition, 4.3)."""
    if info.get("icc_profile"):
        return _profile_encoding(info["icc_profile"])
    gamma = info.get("gamma")
    if "srgb" in info or (gamma and abs(gamma - 1 / 2.2) < 0.005):  # sRGB files give this gamma for old readers
        return SRGB, ()
    if gamma and 0.1 < gamma < 10:
        return Encoding((power_curve(1 / gamma),) * 3, SRGB.to_xyz, f"gamma {gamma:.4g}"), ()
    return None, ()


def _profile_encoding(profile: bytes | None) -> tuple[Encoding | None, tuple[str, ...]]:
    encoding = read_profile(bytes(profile)) if profile else None
    return encoding, (_UNREADABLE_PROFILE,) if profile and not encoding else ()
