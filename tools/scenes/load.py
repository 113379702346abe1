"""Where scenes come from: camera RAWs, pictures, and the built-in test scene."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from shared.dng.tags import MAKER
from shared.errors import InputError
from shared.reading import MAX_PIXELS
from shared.tiff_check import check_directories

from .camera_raw import camera_raw_scene
from .decoders import Decoded, decode_exr, decode_npy, decode_png, decode_tiff, decode_with_pillow
from .drawn.builtin import builtin_scene
from .drawn.chart import chart_scene
from .gehler_shi import sample_range
from .picture import picture_scene, sampled_scene
from .scene import Scene, check_size

__all__ = ["Scene", "builtin_scene", "load_scene"]

# Scenes without a file: prefix, and what draws them at width x height.
_DRAWN: dict[str, Callable[[int, int], Scene]] = {"builtin:": builtin_scene, "chart:": chart_scene}
_TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_DNG_VERSION, _DNG_PRIVATE_DATA = 50706, 50740

# How a file of each kind begins (a pattern), what its name ends in, and who decodes it.
_KINDS: tuple[tuple[str, bytes, tuple[str, ...], Callable[[Path, int], Decoded]], ...] = (
    ("PNG", rb"\x89PNG\r\n\x1a\n", (".png",), decode_png),
    ("JPEG", rb"\xff\xd8\xff", (".jpg", ".jpeg", ".jpe", ".jfif"), decode_with_pillow),
    ("WebP", rb"RIFF....WEBP", (".webp",), decode_with_pillow),
    ("EXR", rb"\x76\x2f\x31\x01", (".exr",), decode_exr),
    ("NPY", rb"\x93NUMPY", (".npy",), decode_npy),
)
_PIECE = 16 << 20
_TIFF_SUFFIXES = (".tif", ".tiff")


def load_scene(source: str, *, linear: bool = False, max_pixels: int = MAX_PIXELS) -> Scene:
    """The scene in a file, or the built-in one.

    source: the path of
      - a Bayer camera RAW (see `camera_raw_scene`),
      - a TIFF, PNG, JPEG, WebP, EXR or NPY picture (see `picture_scene`: 8 bits are sRGB, more are linear, unless the file says
        otherwise; linear=True makes any of them linear; Gehler's data set as Shi and Funt publish it is recognised),
    or "builtin:WxH" (see `builtin_scene`), "chart:WxH" (see `chart_scene`).

    The content decides what a file is, and its ending has to agree. Raises InputError that says what came and what to do, for more
    than `max_pixels` too; it does not name the file.
    """
    if is_drawn(source):
        return _draw(source, max_pixels)
    path = Path(source)
    start = _first_bytes(path)
    suffix = path.suffix.lower()
    for kind, pattern, suffixes, decode in _KINDS:
        if re.match(pattern, start, re.DOTALL):
            if suffix not in suffixes:
                raise InputError(f"is a {kind} picture by its content; if that is meant, name it {path.stem}{suffixes[0]}")
            picture = decode(path, max_pixels)
            if kind == "PNG" and (known := sample_range(picture, path.stem)):
                return sampled_scene(picture, path.stem, known)
            return picture_scene(picture, path.stem, linear=linear)
    if start.startswith(_TIFF_STARTS):
        ours, dng = _look_into(path)
        if ours:
            raise InputError("this is a shot, sampled by the sparse-colour sensor already, and no scene; use panchroma render")
        if suffix in _TIFF_SUFFIXES and not dng:
            return picture_scene(decode_tiff(path, max_pixels), path.stem, linear=linear)
    return camera_raw_scene(path, path.stem, max_pixels)


def is_drawn(source: str) -> bool:
    """Whether a SCENE names one of the built-in scenes, not a file."""
    return source.startswith(tuple(_DRAWN))


def _draw(source: str, max_pixels: int) -> Scene:
    kind = source[: source.index(":") + 1]
    size = re.fullmatch(r"(\d{1,6})x(\d{1,6})", source.removeprefix(kind))
    if not size:
        raise InputError(f"is no built-in scene; write {kind}WIDTHxHEIGHT, for example {kind}1200x800")
    width, height = int(size[1]), int(size[2])
    check_size(width, height, max_pixels=max_pixels)
    return _DRAWN[kind](width, height)


def _first_bytes(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise InputError("is a pipe or a device, not a file; save the picture first")  # a pipe or device would never end
        with path.open("rb") as file:
            start = file.read(16)
    except FileNotFoundError:
        raise InputError("there is no such file; check the name") from None
    except IsADirectoryError:
        raise InputError("is a folder; name the files in it") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if not start:
        raise InputError("the file is empty; copy it again")
    return start


def _look_into(path: Path) -> tuple[bool, bool]:
    """Of a file that begins as TIFF: whether it is a shot of ours, and whether it is a DNG.

    LibRaw must not see our shots: it takes a 6 x 6 pattern for X-Trans and other periods for four colours, and decodes them wrongly
    without complaint. Their private data may sit beside the preview or beside the samples.
    """
    import tifffile

    try:
        with path.open("rb") as stream:
            check_directories(stream, {*tifffile.TIFF.TAG_LOAD, _DNG_PRIVATE_DATA})
        with tifffile.TiffFile(path) as file:
            first: Any = file.pages[0]
            directories = [first, *(first.pages or ())]
            private = [directory.tags.get(_DNG_PRIVATE_DATA) for directory in directories]
            ours = any(tag is not None and bytes(tag.value).startswith(MAKER.encode()) for tag in private)
            return ours, _DNG_VERSION in first.tags
    except (
        Exception
    ):  # a damaged directory: the decoder that comes next says what is wrong, unless that is LibRaw and the file ours
        return _mentions(path, MAKER.encode()), False


def _mentions(path: Path, word: bytes) -> bool:
    """Whether a file holds a word near its beginning or its end, where directories and what belongs to them are."""
    with path.open("rb") as file:
        start = file.read(_PIECE)
        file.seek(max(0, path.stat().st_size - _PIECE))
        return word in start or word in file.read(_PIECE)
