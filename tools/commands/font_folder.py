"""A folder for matplotlib that goes when the program ends: colour-demosaicing imports it, and it would write to the user's home."""

import os
from contextlib import suppress
from functools import cache
from tempfile import TemporaryDirectory


@cache
def temporary_font_folder() -> "TemporaryDirectory[str] | None":
    """Call it in a command before an import that may import matplotlib, which keeps a list of fonts; its workers inherit it.

    It is removed with the returned object. Libraries do not call it: it sets a variable of the whole process.

    Returns None, and changes nothing, if the user has chosen a folder (MPLCONFIGDIR), or if there is no room for another.
    """
    if "MPLCONFIGDIR" in os.environ:
        return None
    with suppress(OSError):
        folder = TemporaryDirectory(prefix="panchroma-fonts-", ignore_cleanup_errors=True)
        os.environ["MPLCONFIGDIR"] = folder.name
        return folder
    return None
