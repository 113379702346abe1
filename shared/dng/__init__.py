"""DNG files: a mosaic with its preview as a standard DNG."""

from .encoding import encode_dng
from .exif import metadata_directory, metadata_from, read_metadata
from .file import read_dng, read_preview, verify_dng, write_dng

__all__ = [
    "encode_dng",
    "metadata_directory",
    "metadata_from",
    "read_dng",
    "read_metadata",
    "read_preview",
    "verify_dng",
    "write_dng",
]
