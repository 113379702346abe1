"""Decoders: picture files to arrays as stored. A format is a module with a FORMAT, and its name in `FORMATS`.

Each checks the declared size before it decodes pixels. Call them in a `guarded` block: then they raise InputError, whatever the
decoding library raises. The messages do not name the file: the caller does.
"""

from . import exr, jpeg, npy, png, tiff
from .decoded import Decoded, PictureFormat, guarded
from .npy import decode_array

__all__ = ["FORMATS", "TIFF", "Decoded", "PictureFormat", "decode_array", "guarded"]

TIFF = tiff.FORMAT
FORMATS = (png.FORMAT, jpeg.FORMAT, exr.FORMAT, npy.FORMAT, TIFF)
"""All formats; whether what begins like a TIFF is a picture depends on more than its first bytes."""
