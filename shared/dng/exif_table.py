"""The Exif fields that results carry as their source has them, beside those that `CaptureMetadata` names (Exif 2.32, 4.6.5-6).

What depends on the pixels of the source is not among them: sizes, resolutions, places in the picture, processing.
"""

from dataclasses import dataclass
from typing import Literal

from tifffile import TIFF

from ..tiff import FieldType
from .tags import Tag

DirectoryName = Literal["main", "exif", "gps"]

GPS_VERSION = 0


@dataclass(frozen=True)
class Kept:
    """A field that is carried along: name in Exif, type, number of values (of a text, with its final NUL); 0 = any number."""

    name: str
    kind: FieldType
    count: int


_NAMES = {"main": TIFF.TAGS, "exif": TIFF.EXIF_TAGS, "gps": TIFF.GPS_TAGS}
_TAGS: dict[tuple[DirectoryName, FieldType, int], tuple[int, ...]] = {
    ("main", FieldType.ASCII, 20): (Tag.DATE_TIME,),
    ("exif", FieldType.SHORT, 1): (34850, 37383, 37384, 37385, 41986, 41989, 41990, 41991, 41996),
    ("exif", FieldType.ASCII, 20): (36868,),
    ("exif", FieldType.ASCII, 0): (36880, 36881, 36882, 37520, 37521, 37522, 42032, 42035, 42037),
    ("exif", FieldType.SRATIONAL, 1): (37377, 37379, 37380),
    ("exif", FieldType.RATIONAL, 1): (37378, 37381, 37382, 41483, 41493, 41988),
    ("exif", FieldType.RATIONAL, 4): (Tag.LENS_SPECIFICATION,),
    ("gps", FieldType.BYTE, 4): (GPS_VERSION,),
    ("gps", FieldType.ASCII, 2): (1, 3, 9, 10, 12, 14, 16, 19, 21, 23, 25),
    ("gps", FieldType.RATIONAL, 3): (2, 4, 7, 20, 22),
    ("gps", FieldType.BYTE, 1): (5,),
    ("gps", FieldType.RATIONAL, 1): (6, 11, 13, 15, 17, 24, 26, 31),
    ("gps", FieldType.ASCII, 0): (8, 18),
    ("gps", FieldType.UNDEFINED, 0): (27, 28),
    ("gps", FieldType.ASCII, 11): (29,),
    ("gps", FieldType.SHORT, 1): (30,),
}
_ORDER = list(_NAMES)
_PLACES = sorted((_ORDER.index(where), tag, where, kind, count) for (where, kind, count), tags in _TAGS.items() for tag in tags)

KEPT: dict[tuple[DirectoryName, int], Kept] = {
    # tifffile writes "Subsec", and a blank behind one name.
    (where, tag): Kept(_NAMES[where][tag].strip().replace("Subsec", "SubSec"), kind, count)
    for _, tag, where, kind, count in _PLACES
}
"""(directory, tag) -> the field; by directory and rising tags."""

# A number of the GPS directory means something else without its reference, which says for instance north or south.
REFERENCES: dict[int, tuple[int, str]] = {
    2: (1, "NS"),
    4: (3, "EW"),
    13: (12, "KMN"),
    20: (19, "NS"),
    22: (21, "EW"),
    26: (25, "KMN"),
}
