"""A folder for matplotlib that goes when the program ends: it would write a list of fonts to the
user's home.
"""

import os
from contextlib import suppress
from functools import cache
from tempfile import TemporaryDirectory


@cache
def temporary_font_folder() -> "TemporaryDirectory[str] | None":
    """Call it before an import of matplotlib. The folder is removed with the returned object.

    It sets a variable of the whole process.

    Returns
    -------
    TemporaryDirectory[str] | None
        None, and changes nothing, if the user has chosen a folder (MPLCONFIGDIR), or if there is no
        room for another.
    """
    if "MPLCONFIGDIR" in os.environ:
        return None
    with suppress(OSError):
        folder = TemporaryDirectory(prefix="panchroma-fonts-", ignore_cleanup_errors=True)
        os.environ["MPLCONFIGDIR"] = folder.name
        return folder
    return None
