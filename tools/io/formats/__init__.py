"""The formats of picture files, a module each."""

from .dng import LinearDng
from .exr import OpenExr
from .format import Format
from .jpg import Jpeg
from .jxl import JpegXl
from .npy import NumPy
from .png import Png
from .tif import Tiff
from .uhdr import UltraHdr

FORMATS: dict[str, Format] = {
    each.name: each
    for each in (Tiff(), Png(), Jpeg(), JpegXl(), UltraHdr(), LinearDng(), OpenExr(), NumPy())
}
"""Every format, by its name. A new one is a module with a `Format`, and its place here."""

OTHER_NAMES = {name: each.name for each in FORMATS.values() for name in each.aliases}
"""Other names of formats: name -> key of `FORMATS`."""

__all__ = ["FORMATS", "OTHER_NAMES", "Format"]
