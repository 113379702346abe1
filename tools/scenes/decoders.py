"""Decoders: picture files to arrays as stored. One function per format; each checks the declared size before decoding pixels.

Call them in a `guarded` block: then they raise InputError, whatever the decoding library raises. The messages do not name the file:
the caller does.
"""

import io
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared import CaptureMetadata
from shared.colorimetry import as_rows, primaries_to_xyz
from shared.errors import InputError
from shared.reading import MAX_PIXELS
from shared.tiff_check import check_directories

from .exif_reading import picture_metadata, tiff_metadata
from .icc_reading import LINEAR, SRGB, Encoding, power_curve, read_profile
from .scene import check_size

_ICC_PROFILE = 34675  # TIFF tag
_MOST_PER_PIXEL, _MOST_BESIDE = 16, 32 << 20  # bytes of a PNG: twice its samples; profile, texts and capture data
_LARGEST_WEBP = 64 << 20  # bytes, read whole; its longest side is 16383 pixels
_NPY_HEADER = 1 << 16
_PNG_HEADER = 26  # signature, then IHDR's length, name, width, height, bit depth and colour type
_MODES = ("1", "L", "LA", "La", "P", "PA", "RGB", "RGBA", "RGBa", "RGBX")
_NO_ALPHA = "transparency is left out"
_UNREADABLE_PROFILE = "the embedded colour profile is damaged or of a kind this program does not read (tables); it is ignored"


@dataclass(frozen=True, eq=False)
class Decoded:
    """A decoded picture, its values as stored in the file.

    pixels: (H, W, C), C = 1 or 3.
    peak: the integer that stands for 1.0; None for floating point.
    encoding: how the file says its values are encoded; None if it does not say.
    metadata: capture data.
    notes: remarks for the user, such as what was left out.
    """

    pixels: NDArray[Any]
    peak: int | None
    encoding: Encoding | None = None
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)
    notes: tuple[str, ...] = ()


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
        reason = reason.replace(f"'{path}'", "").strip()  # whoever shows the error names the file
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
        header = file.read(_PNG_HEADER)
    width, height = (int.from_bytes(header[start : start + 4], "big") for start in (16, 20))
    size = path.stat().st_size
    check_size(width, height, 0, size, max_pixels)
    # Unknown chunks are read too, whatever length they declare.
    if size > _MOST_PER_PIXEL * width * height + _MOST_BESIDE:
        raise InputError(f"{size} bytes for {width} x {height} pixels: the file is damaged, or made to fill the memory")
    if len(header) < _PNG_HEADER or header[24] != 16:
        return decode_with_pillow(path, max_pixels)
    check_size(width, height, 8, size, max_pixels)
    import imagecodecs

    pixels, notes = _without_alpha(imagecodecs.png_decode(path.read_bytes()))
    with _pillow().open(path) as image:
        return _described(image, pixels, 65535, notes)


def decode_with_pillow(path: Path, max_pixels: int = MAX_PIXELS) -> Decoded:
    """Decode an 8-bit PNG, a JPEG or a WebP."""
    if path.stat().st_size > _LARGEST_WEBP and path.suffix.lower() == ".webp":
        raise InputError(f"is larger than {_LARGEST_WEBP} bytes, more than any WebP needs: it is damaged; if not, save it as PNG")
    # Invalid capture data cause warnings.
    with warnings.catch_warnings(action="ignore"), _pillow().open(path) as image:
        width, height = image.size
        check_size(width, height, 4, path.stat().st_size, max_pixels)
        if image.mode not in _MODES:
            raise InputError(f"the picture is of kind {image.mode} (CMYK, Lab, ...); convert it to RGB or grey")
        transparent = "A" in image.getbands() or "transparency" in image.info
        grey = image.mode in {"1", "L", "LA", "La"}
        pixels = np.atleast_3d(np.asarray(image.convert("L" if grey else "RGB")))
        return _described(image, pixels, 255, (_NO_ALPHA,) if transparent else ())


def decode_tiff(path: Path, max_pixels: int = MAX_PIXELS) -> Decoded:
    """Decode the first page of a grey or RGB TIFF, integer or floating point."""
    import tifffile

    size = path.stat().st_size
    with path.open("rb") as stream:
        several = check_directories(stream, {*tifffile.TIFF.TAG_LOAD, _ICC_PROFILE})
    with tifffile.TiffFile(path) as file:
        page: Any = file.pages[0]
        if page.photometric not in {tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB, tifffile.PHOTOMETRIC.YCBCR}:
            raise InputError(
                f"the TIFF is of kind {getattr(page.photometric, 'name', page.photometric)}; convert it to RGB or grey"
            )
        samples = page.samplesperpixel
        if samples not in {1, 2, 3, 4} or page.imagedepth != 1:
            raise InputError(f"the TIFF has {samples} samples per pixel; expected grey or RGB, with or without transparency")
        check_size(page.imagewidth, page.imagelength, samples * max(1, page.bitspersample // 8), size, max_pixels)
        if page.is_tiled:
            check_size(page.tilewidth, page.tilelength, max_pixels=max_pixels)
        # tifffile fills missing data with zeros: a black stripe in the scene instead of an error.
        extents = list(zip(page.dataoffsets, page.databytecounts, strict=True))
        if not extents or any(count == 0 or offset + count > size for offset, count in extents):
            raise InputError("the TIFF is cut short: it points beyond its end; copy it again")
        pixels = page.asarray(maxworkers=1)
        if page.axes.startswith("S"):
            pixels = np.moveaxis(pixels, 0, -1)
        pixels, notes = _without_alpha(pixels)
        if several:
            notes += ("the file has several pages; only the first is used",)
        peak = (1 << page.bitspersample) - 1 if pixels.dtype.kind == "u" else None
        profile = page.tags.get(_ICC_PROFILE)
        encoding, remarks = _profile_encoding(profile and profile.value)
    return Decoded(pixels, peak, encoding, tiff_metadata(path), notes + remarks)


def decode_exr(path: Path, max_pixels: int = MAX_PIXELS) -> Decoded:
    """Decode the channels R, G, B or Y of the first part of an OpenEXR file; its values are linear by definition."""
    import OpenEXR

    with redirect_stdout(io.StringIO()):  # OpenEXR prints warnings; standard output is for data
        header = OpenEXR.File(str(path), header_only=True).header()
        (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in header["dataWindow"])
        names = {channel.name for channel in header["channels"]}
        wanted = ("R", "G", "B") if {"R", "G", "B"} <= names else ("Y",)
        if not set(wanted) <= names or "RY" in names:
            raise InputError(f"the EXR has the channels {', '.join(sorted(names))}; expected R, G, B, or Y alone")
        check_size(right - left + 1, bottom - top + 1, 4 * len(names), path.stat().st_size, max_pixels)
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    pixels = np.stack([channels[name].pixels for name in wanted], axis=-1)
    if "chromaticities" not in header:
        return Decoded(pixels, None)
    red, green, blue, white = np.reshape(header["chromaticities"], (4, 2)).tolist()
    matrix = as_rows(primaries_to_xyz((tuple(red), tuple(green), tuple(blue)), tuple(white)))
    return Decoded(pixels, None, Encoding(LINEAR.curves, matrix, "the file's chromaticities"))


def decode_npy(path: Path, max_pixels: int = MAX_PIXELS) -> Decoded:
    """Decode a NumPy array (H, W) or (H, W, C) of unsigned integers or floating point. Pickled objects are refused."""
    with path.open("rb") as file:
        start = file.read(12)
    # NumPy reads a header of the length that the file declares, in two bytes in version 1, in four in later versions.
    if start[6:7] != b"\1" and int.from_bytes(start[8:12], "little") > _NPY_HEADER:
        raise InputError("the array's header declares an impossible length: the file is damaged, or made to fill the memory")
    stored = np.load(path, mmap_mode="r", allow_pickle=False)
    if stored.ndim not in (2, 3) or stored.dtype.kind not in "uf" or (stored.ndim == 3 and not 1 <= stored.shape[2] <= 4):
        raise InputError(
            f"the array is {stored.dtype} of shape {stored.shape}; "
            "expected unsigned integers or floating point, (rows, columns) or (rows, columns, 3)"
        )
    check_size(stored.shape[1], stored.shape[0], max_pixels=max_pixels)
    pixels, notes = _without_alpha(np.array(stored))
    return Decoded(pixels, np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else None, notes=notes)


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
