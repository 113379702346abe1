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

_ALL = Tiff(), Png(), Jpeg(), JpegXl(), UltraHdr(), LinearDng(), OpenExr(), NumPy()
FORMATS: dict[str, Format] = {written.name: written for written in _ALL}
"""Every format, by its name. A new one is a module with a `Format`, and its place here."""

OTHER_NAMES = {alias: written.name for written in _ALL for alias in written.aliases}
"""Other names of formats: name -> key of `FORMATS`."""

__all__ = ["FORMATS", "OTHER_NAMES", "Format"]
