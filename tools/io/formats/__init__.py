"""The formats of picture files."""

from ..development import Format
from .at_once import JpegXl, NumPy, OpenExr, Png
from .jpg import Jpeg, UltraHdr
from .tif import LinearDng, Tiff

_ALL = Tiff(), Png(), Jpeg(), JpegXl(), UltraHdr(), LinearDng(), OpenExr(), NumPy()
FORMATS: dict[str, Format] = {written.name: written for written in _ALL}
"""Every format, by its name. A new one is a class in a module, and its place here."""

OTHER_NAMES = {alias: written.name for written in _ALL for alias in written.aliases}
"""Other names of formats: name -> key of `FORMATS`."""
