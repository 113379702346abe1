"""DNG files: a mosaic with its preview as a standard DNG, and a rendered picture as a linear DNG."""

from .codec import Layout, decode_dng, decode_preview, encode_dng
from .exif import metadata_directory
from .exif_reading import metadata_from, read_metadata
from .file import read_dng, read_preview, verify_dng, write_dng
from .picture import PART, EncodedPart, encode_part, join_parts

__all__ = [
    "PART",
    "EncodedPart",
    "Layout",
    "decode_dng",
    "decode_preview",
    "encode_dng",
    "encode_part",
    "join_parts",
    "metadata_directory",
    "metadata_from",
    "read_dng",
    "read_metadata",
    "read_preview",
    "verify_dng",
    "write_dng",
]
