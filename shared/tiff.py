"""Writing the TIFF structure (TIFF 6.0; Exif 2.3 section 4.6): directories of typed fields, and the
data they point to.

DNG files, TIFF files and Exif blocks share it. It is written little-endian, in memory or strip by
strip. tifffile does the reading.
"""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from io import SEEK_END, BytesIO
from typing import BinaryIO

from tifffile import DATATYPE, TIFF

from .errors import InputError

LARGEST_TIFF = 2**32  # bytes: offsets have 32 bits


FieldType = DATATYPE
RATIOS = (FieldType.RATIONAL, FieldType.SRATIONAL)
"""Field types of which a value is two numbers, numerator and denominator."""

# The fields of a directory by tag. A field is (type, values); values are bytes for BYTE and
# UNDEFINED, str for ASCII (written as UTF-8 with a final NUL), otherwise numbers, or the bytes of
# numbers in little-endian order, which are written as they are.
Fields = dict[int, tuple[FieldType, bytes | str | Sequence[float]]]


@dataclass
class Directory:
    """One image file directory.

    Attributes
    ----------
    fields : Fields
        The fields by tag, without those of strips and children.
    strips : Sequence[bytes]
        The encoded strips of its image, from top to bottom; tiles, if there is a field TileWidth.
    children : dict[int, 'Directory']
        Directories that a field points to (SubIFDs, Exif), by the tag of that field.
    """

    fields: Fields = field(default_factory=dict)
    strips: Sequence[bytes] = ()
    children: dict[int, "Directory"] = field(default_factory=dict)


def encode_tiff(directory: Directory) -> bytes:
    """A whole little-endian TIFF file with one main directory.

    Raises
    ------
    InputError
        Beyond the 4 GiB of the format.
    """
    file = BytesIO()
    write_tiff(file, directory, directory.strips)
    return file.getvalue()


def write_tiff(file: BinaryIO, directory: Directory, strips: Iterable[bytes | memoryview]) -> None:
    """Write a TIFF file strip by strip; the bytes are those of `encode_tiff` for a directory with
    these strips.

    Parameters
    ----------
    file : BinaryIO
        Seekable, at its beginning.
    directory : Directory
        The main directory; its own strips are ignored.
    strips : Iterable[bytes | memoryview]
        Encoded strips from top to bottom, each written as soon as it arrives.

    Raises
    ------
    InputError
        Beyond the 4 GiB of the format.
    """
    file.write(b"II*\0" + bytes(4))
    place = _place(directory, strips, file)
    file.seek(4)  # there the header has the offset of the first directory
    file.write(struct.pack("<I", place))
    file.seek(0, SEEK_END)


def _place(directory: Directory, strips: Iterable[bytes | memoryview], file: BinaryIO) -> int:
    """Append a directory with these strips, after everything it points to, to a file. Returns its
    offset.
    """
    fields = dict(directory.fields)
    if placed := [(_append(strip, file), len(strip)) for strip in strips]:
        chunk = "Tile" if TIFF.TAGS["TileWidth"] in fields else "Strip"
        for name, numbers in zip(("Offsets", "ByteCounts"), zip(*placed, strict=True), strict=True):
            fields[TIFF.TAGS[chunk + name]] = FieldType.LONG, numbers
    for tag, child in directory.children.items():
        fields[tag] = FieldType.LONG, [_place(child, child.strips, file)]
    table = bytearray(struct.pack("<H", len(fields)))
    for tag, (kind, values) in sorted(fields.items()):
        count, payload = _encode(kind, values)
        if len(payload) > 4:
            payload = struct.pack("<I", _append(payload, file))
        table += struct.pack("<HHI4s", tag, kind, count, payload)
    return _append(bytes(table + bytes(4)), file)


def _append(data: bytes | memoryview, file: BinaryIO) -> int:
    """Append data at an even offset, as TIFF requires, and return that offset."""
    file.write(bytes(file.tell() % 2))
    offset = file.tell()
    if offset + len(data) >= LARGEST_TIFF:
        remedy = "use fewer bits, another format, or a crop of the picture"
        raise InputError(f"the file would pass the 4 GiB of a TIFF; {remedy}")
    file.write(data)
    return offset


def _encode(kind: FieldType, values: bytes | str | Sequence[float]) -> tuple[int, bytes]:
    """Number of values and little-endian bytes of a field."""
    if isinstance(values, str):
        # Exif prescribes ASCII, which cannot hold a name like "Käthe"; other programs write and
        # read UTF-8 too.
        data = values.encode("utf-8", "replace").replace(b"\0", b"") + b"\0"
        return len(data), data
    if isinstance(values, bytes):
        return len(values) // value_bytes(kind), values
    numbers = (
        [number for value in values for number in _ratio(value, kind)] if kind in RATIOS else values
    )
    return len(values), struct.pack(f"<{len(numbers)}{number_format(kind)}", *numbers)


def number_format(kind: int) -> str:
    """The letter by which `struct` knows the numbers of a field type; rational values have two of
    them.
    """
    return TIFF.DATA_FORMATS[kind][-1]


def value_bytes(kind: int) -> int:
    """Bytes of a value of a field type; 0 for a type that TIFF does not know."""
    return struct.calcsize(f"={TIFF.DATA_FORMATS.get(kind, '')}")


def _ratio(value: float, kind: FieldType) -> tuple[int, int]:
    """Numerator and denominator of the simplest fraction that reads back as `value`, or of the
    nearest that fits into 32 bits.
    """
    limit = 2**31 - 1
    finest = min(limit, max(1, int(limit / max(abs(value), 1e-9))))
    for denominator in (10**3, 10**6, finest):  # 1/250 rather than the binary fraction of the float
        fraction = Fraction(float(value)).limit_denominator(min(denominator, finest))
        if float(fraction) == value:
            break
    if abs(fraction.numerator) > limit or (fraction < 0 and kind is FieldType.RATIONAL):
        raise InputError(f"{value} does not fit a TIFF {kind.name}")
    return fraction.numerator, fraction.denominator
