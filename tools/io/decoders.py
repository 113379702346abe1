"""Decoders: picture files to arrays as stored; and what all of them share: what they return, names
of channels, transparency.

Each checks the declared size before it decodes pixels, and raises InputError for whatever the
decoding library raises. The messages do not name the file: the caller does.
"""

import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...shared import CaptureMetadata, InputError
from ...shared.dng.exif import read_metadata
from ...shared.jpeg_check import read_header
from ...shared.reading import read_whole
from ...shared.tiff_reading import StoredField, read_directories
from . import encoding as encodings
from .damage import data_bytes, guarded
from .encoding import SRGB, Encoding
from .limited import Facts, run_limited
from .scene import RGB, check_size, scene_channels

_MOST_SAMPLES = 4  # of a picture: RGB and transparency


@dataclass(frozen=True, eq=False)
class Decoded:
    """A decoded picture, its values as stored in the file.

    Attributes
    ----------
    pixels : NDArray[Any]
        (H, W, C), C = 1 for a grey picture, otherwise one for each channel.
    peak : int | None
        The integer that stands for 1.0; None for floating point.
    encoding : Encoding | None
        How the file says its values are encoded; None if it does not say.
    metadata : CaptureMetadata
        Capture data.
    notes : Sequence[str]
        Remarks for the user, such as what was left out.
    channels : str
        Letters of the channels; a grey picture has them all alike.
    """

    pixels: NDArray[Any]
    peak: int | None
    encoding: Encoding | None = None
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)
    notes: Sequence[str] = ()
    channels: str = RGB


class PictureFormat(NamedTuple):
    """A format of picture files.

    Attributes
    ----------
    name : str
        For people.
    start : bytes
        Pattern (`re`) of the first bytes.
    endings : tuple[str, ...]
        Of the names of its files, the usual one first.
    decode : Callable[[Path, int, str], Decoded]
        (file, limit of pixels, channels of the pattern that will see it) -> picture.
    """

    name: str
    start: bytes
    endings: tuple[str, ...]
    decode: Callable[[Path, int, str], Decoded]


def channels_of(
    count: int, requested: str, notes: list[str], *, declared: bool = False, pages: int = 1
) -> str:
    """Return which channels `count` samples per pixel without names are: `requested`, or "" for a
    grey or RGB picture.

    Raises InputError when there are more samples than a picture has, or one that is neither a
    colour nor declared to be transparency, and another number than `requested`.

    Parameters
    ----------
    notes : list[str]
        Gets remarks for the user.
    declared : bool, optional
        They are declared to be red, green and blue, or one of them to be transparency.
    pages : int, optional
        That they come from.
    """
    stacked = f"{pages} pages" if pages > 1 else f"{count} channels"
    of_rgb = count == len(RGB) and set(scene_channels(requested)) <= set(RGB)
    known = declared or of_rgb
    if count == len(requested) and not known:
        order = f"{', '.join(requested)}, in this order"
        notes.append(f"its {stacked} have no names: they are taken as linear light of {order}")
        return requested
    if count > 1 and (count > _MOST_SAMPLES or not known or (pages > 1 and not of_rgb)):
        pattern = f"the pattern the {len(requested)} channels {requested}"
        raise InputError(
            f"has {stacked}, and {pattern}; a scene has as many channels as the pattern "
            "(`pattern`), or red, green and blue: leave others out (array[..., :3]), declare "
            "transparency (ExtraSamples of a TIFF), or in Python name those of an array with bands"
        )
    return ""


def without_alpha(pixels: NDArray[Any], notes: list[str]) -> NDArray[Any]:
    """Return (H, W) or (H, W, 1 to 4) without a transparency channel, (H, W, 1 or 3).

    notes: gets a remark for the user.
    """
    pixels = np.atleast_3d(pixels)
    if pixels.shape[2] in (1, 3):
        return pixels
    notes.append("transparency is left out")
    return pixels[..., :-1]


def remark_on_unused(names: Iterable[str], notes: list[str]) -> None:
    """Add one remark for the user on what a file has besides, and is not used, to its notes."""
    if listed := ", ".join(names):
        notes.append(f"not used: {listed}")


_NPY_HEADER = 1 << 16
_LONGEST_NAMES = 200  # characters: channels that a message lists


def decode_npy(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a NumPy array (H, W) or (H, W, C) of unsigned integers or floating point. Pickled
    objects are refused.

    C is 1 (grey), 3 (RGB), or the number of `channels`, which are then taken in this order.
    """
    with path.open("rb") as file:
        start = file.read(12)
    # NumPy reads a header of the length that the file declares, in two bytes in version 1, in four
    # in later versions.
    if start[6:7] != b"\1" and int.from_bytes(start[8:12], "little") > _NPY_HEADER:
        reason = "the file is damaged, or made to fill the memory"
        raise InputError(f"the array's header declares an impossible length: {reason}")
    with guarded(path):
        stored = np.load(path, mmap_mode="r", allow_pickle=False)
    if stored.ndim in (2, 3):
        rows, columns = stored.shape[:2]
        check_size(columns, rows, stored[:1, :1].nbytes, data_bytes(path), max_pixels)
    return decode_array(stored, channels)


def decode_array(array: NDArray[Any], channels: str = RGB) -> Decoded:
    """The picture in an array, of the shapes, types and channels that `decode_npy` reads; a
    copy.
    """
    count = array.shape[2] if array.ndim == 3 else int(array.ndim == 2)
    if not count or array.dtype.kind not in "uf":
        shapes = "(rows, columns) or (rows, columns, channels)"
        expected = f"unsigned integers or floating point, {shapes}"
        raise InputError(f"the array is {array.dtype} of shape {array.shape}; expected {expected}")
    notes: list[str] = []
    letters = channels_of(count, channels, notes)
    pixels = np.atleast_3d(np.array(array))
    peak = np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else None
    return Decoded(pixels, peak, notes=notes, channels=letters or RGB)


NPY = PictureFormat("NPY", rb"\x93NUMPY", (".npy",), decode_npy)


_MOST_PER_PIXEL, _MOST_BESIDE = 16, 32 << 20  # bytes: twice its samples; profile and capture data
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# The chunks that make up the picture (PNG, third edition, 11.2 and 11.3), and those beside it, one
# of each.
_PICTURE = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
_CHUNKS_KEPT = (b"cICP", b"gAMA", b"cHRM", b"sRGB", b"iCCP", b"eXIf", b"acTL")
_TEXTS = b"tEXt", b"zTXt"
_EXIF_TEXTS = b"Raw profile type exif\0", b"Raw profile type APP1\0"  # of exiv2 and ImageMagick
_EXIF_START = b"Exif\0\0"  # of a JPEG's, which some keep
_LONGEST_BESIDE = 4 << 20  # bytes
# more chunks than this have that many bytes on average; encoders write 8 KiB
_MOST_CHUNKS, _LEAST_CHUNK = 4096, 1024
_FRAME = 12  # length, name and check sum of a chunk
_HEADER = 26  # signature, then IHDR's length, name, width, height, bit depth and colour type


def decode_png(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a PNG of any kind."""
    import imagecodecs

    with path.open("rb") as file:
        header = file.read(_HEADER).ljust(_HEADER, b"\0")
    width, height = (int.from_bytes(header[start : start + 4], "big") for start in (16, 20))
    wide, notes = header[24] == 16, list[str]()
    check_size(width, height, 8 if wide else 4, data_bytes(path), max_pixels)
    png, beside = _chunks(path, _MOST_PER_PIXEL * width * height + _MOST_BESIDE)
    with guarded():
        samples = imagecodecs.png_decode(png)
    pixels, peak = without_alpha(samples, notes), 65535 if wide else 255
    encoding = _encoding(beside, peak, notes)
    if b"acTL" in beside:
        remark_on_unused(["the animation"], notes)
    exif = beside.get(b"eXIf") or _exif_of_text(beside)
    metadata = read_metadata(BytesIO(exif.removeprefix(_EXIF_START)))
    return Decoded(pixels, peak, encoding, metadata, notes)


def _chunks(path: Path, most: int) -> tuple[bytes, dict[bytes, bytes]]:
    """The PNG with its picture alone; and what the chunks beside it hold, by their names.

    One that is cut short is kept as it is.

    Left out is what decoders expand unasked: texts but Exif's, frames of an animation, unknown
    chunks.

    path: the file, which begins like a PNG.
    most: bytes that may be kept.
    Raises InputError when the picture is longer, or in more strips than any encoder makes.
    """
    kept, beside, length, chunks = [_SIGNATURE], dict[bytes, bytes](), 0, 0
    with path.open("rb") as file:
        file.seek(len(_SIGNATURE))
        while len(start := file.read(8)) == 8 and (name := start[4:]).isalpha():
            size = int.from_bytes(start[:4], "big") + _FRAME - len(start)
            chunks += 1
            if chunks > _MOST_CHUNKS + file.tell() // _LEAST_CHUNK:
                counts = f"{chunks} chunks in {file.tell()} bytes"
                raise InputError(f"{counts}: the file is damaged, or made to waste time")
            if name in _PICTURE:
                length += _FRAME + size
                if length > most:
                    limit = f"more than {most} bytes of samples"
                    raise InputError(f"{limit}: the file is damaged, or made to fill the memory")
                kept += start, file.read(size)
            elif name in (*_CHUNKS_KEPT, *_TEXTS) and name not in beside:
                held = file.read(min(size, _LONGEST_BESIDE))[:-4]  # a longer one is damaged
                file.seek(max(size - _LONGEST_BESIDE, 0), 1)
                if name in _CHUNKS_KEPT or held.startswith(_EXIF_TEXTS):
                    beside[name] = held
            else:
                file.seek(size, 1)
            if name == b"IEND":
                break
    return b"".join(kept), beside


def _exif_of_text(beside: dict[bytes, bytes]) -> bytes:
    """Return the Exif data that stand in hexadecimal in a text, after their name and number."""
    for name in _TEXTS:
        _, _, held = beside.get(name, b"").partition(b"\0")
        with suppress(zlib.error, ValueError):
            if name == b"zTXt":  # behind the method, of which there is one
                held = zlib.decompressobj().decompress(held[1:], _LONGEST_BESIDE)
            if words := held.split(maxsplit=2)[2:]:
                return bytes.fromhex(words[0].decode("ascii"))
    return b""


def _encoding(beside: dict[bytes, bytes], peak: int, notes: list[str]) -> Encoding | None:
    """Return the encoding that a PNG declares: cICP before iCCP before sRGB before gAMA and cHRM
    (PNG, third edition, 4.3).

    peak: largest sample.
    notes: gets a remark for the user.
    """
    if b"cICP" in beside:
        if encoding := encodings.coded_encoding(beside[b"cICP"], peak):
            return encoding
        code = " ".join(map(str, beside[b"cICP"][:4]))
        remark_on_unused([f"cICP {code}, an encoding that this program does not read"], notes)
    if b"iCCP" in beside:
        # behind its name and the method, of which there is one
        profile, compressed = b"", beside[b"iCCP"].partition(b"\0")[2][1:]
        with suppress(zlib.error):
            profile = zlib.decompressobj().decompress(compressed, _LONGEST_BESIDE)
        if encoding := encodings.profile_encoding(profile or compressed or b"none", notes):
            return encoding
    return SRGB if b"sRGB" in beside else _gamma_and_primaries(beside)


def _gamma_and_primaries(beside: dict[bytes, bytes]) -> Encoding | None:
    """The encoding that gAMA and cHRM declare; the curve alone is not declared without gAMA."""
    gamma = int.from_bytes(beside.get(b"gAMA", b""), "big") / 100000
    corners = np.frombuffer(beside.get(b"cHRM", b"").ljust(32, b"\0")[:32], ">u4") / 100000
    to_xyz = encodings.space_of([*corners[2:], *corners[:2]])  # white is the first
    if not 0.1 < gamma < 10:
        return Encoding((), to_xyz, "primaries alone") if to_xyz else None
    to_xyz = to_xyz or SRGB.to_xyz
    # sRGB files give this gamma for old readers
    if abs(gamma - 1 / 2.2) < 0.005 and np.allclose(to_xyz, SRGB.to_xyz, atol=0.002):
        return SRGB
    return Encoding((encodings.power_curve(1 / gamma),) * 3, to_xyz, f"gamma {gamma:.4g}")


PNG = PictureFormat("PNG", rb"\x89PNG\r\n\x1a\n", (".png",), decode_png)


_LARGEST_JPEG = 1 << 30  # bytes, read whole
_PROFILE = b"ICC_PROFILE\0"  # ICC.1:2022, B.4
# CIPA DC-007: its segment, the field of its entries, their length, and the kind of previews
_MULTI_PICTURE, _ENTRIES, _ENTRY, _PREVIEW = b"MPF\0", 45058, 16, 1
_GAIN_MAPS = (
    b"http://ns.adobe.com/hdr-gain-map/",
    b"urn:iso:std:iso:ts:21496:-1",
    b"urn:com:apple:photo:2020:aux:hdrgainmap",
)


def decode_jpeg(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode a JPEG."""
    import imagecodecs

    jpeg = read_whole(path, _LARGEST_JPEG, "a JPEG")
    header = read_header(jpeg)
    check_size(header.columns, header.rows, 4, data_bytes(path), max_pixels)
    header.check(max_pixels)
    if header.components not in (1, 3) or header.bits != 8:
        kind = f"{header.components} channels of {header.bits} bits"
        raise InputError(f"the JPEG has {kind} (CMYK, ...); convert it to RGB or grey of 8 bits")
    if not header.complete:  # libjpeg makes grey of what is missing
        raise InputError("the picture is cut short: its end is missing; copy it again")
    with guarded():
        pixels = np.atleast_3d(imagecodecs.jpeg8_decode(jpeg))
    notes: list[str] = []
    # The chunks of a profile begin with their number, and how many there are.
    chunks = sorted(header.held(_PROFILE), key=lambda chunk: chunk[:1])
    profile = b"".join(chunk[2:] for chunk in chunks)
    encoding = encodings.profile_encoding(profile, notes)
    encoding = encoding or encodings.exif_encoding(BytesIO(header.exif), notes)
    if any(mark in jpeg for mark in _GAIN_MAPS):
        plain = "this is the plain picture, whose highlights end at white"
        remark_on_unused([f"a gain map for HDR ({plain})"], notes)
    elif others := _others(header.held(_MULTI_PICTURE)):
        remark_on_unused([f"{others} more in the file: only the first picture is"], notes)
    return Decoded(pixels, 255, encoding, read_metadata(BytesIO(header.exif)), notes)


def _others(segments: Sequence[bytes]) -> int:
    """Number of pictures in a JPEG beside the first that are not its previews (CIPA DC-007)."""
    index = b"".join(segments[:1])
    entries = read_directories(BytesIO(index), {_ENTRIES}).main.get(_ENTRIES, StoredField(0)).data
    kinds = entries[_ENTRY + (2 if index.startswith(b"II") else 1) :: _ENTRY]  # a byte of each
    return len(kinds) - kinds.count(_PREVIEW)


JPEG = PictureFormat("JPEG", rb"\xff\xd8\xff", (".jpg", ".jpeg", ".jpe", ".jfif"), decode_jpeg)


def decode_exr(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode `channels`, what they can be made from, or Y, of the first part of an OpenEXR file
    that has them; its values are linear.
    """
    # OpenEXR takes tiles, attributes and further parts of whatever size they declare.
    pixels, facts = run_limited(path, ("OpenEXR",), unpack_exr, str(path), max_pixels, channels)
    if pixels.dtype.kind != "f" or pixels.ndim != 3:
        labels = f"the EXR holds whole numbers ({pixels.dtype}), which are labels and no light"
        raise InputError(f"{labels}; save it as half or float")
    matrix, more = encodings.space_of(facts["chromaticities"]), facts["parts"] - 1
    encoding = Encoding((), matrix, "the file's chromaticities") if matrix else None
    notes: list[str] = []
    names = f"the channels {facts['unused']}" if facts["unused"] else ""
    others = f"{more} more parts of the EXR" if more else ""
    remark_on_unused(filter(None, (names, others)), notes)
    return Decoded(pixels, None, encoding, notes=notes, channels=str(facts["channels"]))


def unpack_exr(path: str, max_pixels: int, requested: str) -> tuple[NDArray[Any], Facts]:
    """Return the pixels (H, W, C), their letters, the names of the part's other channels, x, y of
    red, green, blue and white if the file has them, and the number of its parts.

    Call it by `run_limited`.
    """
    import OpenEXR

    with guarded(path):
        file = OpenEXR.File(path, header_only=True)
        headers = [file.header(part) for part in range(len(file.parts))]
        parts = [{channel.name for channel in header["channels"]} for header in headers]
    # the filters' own channels before those they can be made from
    choices = product([requested, scene_channels(requested), RGB, "Y"], range(len(parts)))
    fitting = ((letters, part) for letters, part in choices if set(letters) <= parts[part])
    letters, part = next(fitting, ("", 0))
    header, names = headers[part], parts[part]
    if not letters or "RY" in names:
        expected = "R, G, B" if requested == RGB else f"{', '.join(requested)}, or R, G, B"
        listed = ", ".join(sorted(set().union(*parts)))[:_LONGEST_NAMES]
        raise InputError(f"the EXR has the channels {listed}; expected {expected}, or Y alone")
    with guarded(path):
        corners = [np.asarray(corner, np.int64) for corner in header["dataWindow"]]
        width, height = (corners[1] - corners[0] + 1).tolist()
        primaries = np.ravel(np.asarray(header.get("chromaticities", ()), np.float64)).tolist()
    check_size(width, height, 4 * len(names), data_bytes(path), max_pixels)
    with guarded(path):
        channels = OpenEXR.File(path, separate_channels=True).channels(part)
        pixels = np.stack([channels[name].pixels for name in letters], axis=-1)
    unused = ", ".join(sorted(names - {*letters}))[:_LONGEST_NAMES]
    letters = RGB if letters == "Y" else letters
    facts = {"channels": letters, "unused": unused, "chromaticities": primaries}
    return pixels, facts | {"parts": len(parts)}


EXR = PictureFormat("EXR", rb"\x76\x2f\x31\x01", (".exr",), decode_exr)
