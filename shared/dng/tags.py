"""Values in the fields of our files (TIFF 6.0, Exif 2.3, DNG 1.4); tifffile knows the numbers of
their tags.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

from tifffile import PHOTOMETRIC, TIFF

from ..pattern import PANCHROMATIC
from ..tiff import Fields, FieldType

MAKER = "Panchroma"

DNG_VERSION = bytes([1, 4, 0, 0])

# The longest period of a CFA and of black levels that Adobe's SDK supports (kMaxCFAPattern,
# kMaxBlackPattern).
LONGEST_CFA_PERIOD = 8

# Rows or columns of one JPEG: JPEG_MAX_DIMENSION of libjpeg.
LONGEST_SIDE = 65500

# Codes of colours in CFAPattern and CFAPlaneColor.
CFA_CODES = {"R": 0, "G": 1, "B": 2, "C": 3, "M": 4, "Y": 5, PANCHROMATIC: 6}

PICTURE_PLANES = 3  # of a rendered picture: red, green, blue


TAG: Any = TIFF.TAGS
"""Name of a tag in the standards -> its number; KeyError for a name that has none."""
GPS: Any = TIFF.GPS_TAGS
"""Names of the tags of the GPS directory, as `TAG`."""


Photometric = PHOTOMETRIC
"""Values of PHOTOMETRIC: CFA is one colour per pixel, as CFA_PATTERN says, LINEAR_RAW every plane
at every pixel, linear.
"""


def tags_of(names: str) -> set[int]:
    """The numbers of tags, whose names are parted by blanks."""
    return {TAG[name] for name in names.split()}


def fields_of(kind: FieldType, **values: bytes | str | Sequence[float]) -> Fields:
    """Fields of one type, by the names of their tags."""
    return {TAG[name]: (kind, value) for name, value in values.items()}


class Compression(IntEnum):
    """Values of COMPRESSION. Lossless JPEG is the only compression of samples that every raw
    developer decodes.
    """

    NONE = 1
    JPEG = 7  # lossless for raw samples, baseline for the preview


LIGHT_SOURCES = {"A": 17, "D55": 20, "D65": 21, "D75": 22, "D50": 23}
"""Values of CalibrationIlluminant, which are those of LightSource in Exif."""
