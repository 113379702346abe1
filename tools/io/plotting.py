"""matplotlib as it is installed, whatever the user's environment says of it: import it from here.

The backend of a notebook (MPLBACKEND) need not be installed here. A list of fonts would be written
to the user's home: without a folder of the user's choice (MPLCONFIGDIR) it goes to a temporary one.
"""

import atexit
import os
from contextlib import suppress
from tempfile import TemporaryDirectory

from ...shared.environment import environment
from ...shared.errors import InputError

_fonts = os.environ.get("MPLCONFIGDIR")
with suppress(OSError):  # no room for another
    _folder = TemporaryDirectory(prefix="panchroma-fonts-", ignore_cleanup_errors=True)
    atexit.register(_folder.cleanup)  # -W error would complain otherwise
    _fonts = _fonts or _folder.name
try:
    with environment("MPLBACKEND", None), environment("MPLCONFIGDIR", _fonts):
        import matplotlib
        from matplotlib.figure import Figure
except (OSError, ValueError) as error:
    remedy = "mend or move the file matplotlibrc, in this folder or elsewhere"
    raise InputError(f"matplotlib cannot read its settings ({error}); {remedy}") from error

__all__ = ["SETTINGS", "Figure", "matplotlib"]

SETTINGS = {
    **matplotlib.rcParamsDefault,  # those of matplotlib, not of the user's matplotlibrc
    "text.parse_math": False,  # a "$" in a name is a "$"
    "svg.fonttype": "none",  # texts stay texts
    "svg.hashsalt": "panchroma",  # the same figures make the same bytes
    "font.family": "sans-serif",
    "axes.grid": True,
    "axes.axisbelow": True,
}
"""Settings of all plots, for `matplotlib.rc_context`."""
