"""DNG files: a mosaic with its preview as a standard DNG."""

from .encoding import encode_dng
from .file import read_dng, read_preview, verify_dng, write_dng

__all__ = ["encode_dng", "read_dng", "read_preview", "verify_dng", "write_dng"]
