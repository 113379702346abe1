"""A pattern of colour filters as users write it: letters, the name of a tile, or a file with
either.
"""

import os
import re

from ...shared.errors import InputError
from ...shared.pattern import PERIODS, CfaPattern
from ...shared.reading import read_text
from ...shared.spelling import meant
from ...shared.tiles import EXPECTED, TILES, letters_of

_PATTERN_LETTERS = re.compile("[A-Z/]+")
_MOST_LETTERS = PERIODS[-1] * (PERIODS[-1] + 1)  # with what parts the rows
_LARGEST_FILE = 1 << 16  # bytes, with its comments


def read_pattern(text: str) -> CfaPattern:
    """The pattern that a text stands for.

    Raises InputError that names the file, or the argument `pattern`, and says what is wrong with
    the letters.

    Parameters
    ----------
    text : str
        The name of a tile, see `shared.tiles`; or that of a file, if there is one; or letters, as
        "RGWW/GBWW/WWWW/WWWW". In a file a row ends with its line or a "/"; white space, empty
        lines, and what follows a # are left out.

    Examples
    --------
    >>> from panchroma.tools.simulation.pattern_text import read_pattern
    >>> read_pattern("kodak") == read_pattern("WBWG/BWGW/WGWR/GWRW")
    True
    """
    is_file = letters_of(text) is None and os.path.exists(text)  # noqa: PTH110 (Path.exists raises for a name that is too long)
    try:
        letters = _letters_in(text) if is_file else text
        if not is_file and letters_of(text) is None and not _PATTERN_LETTERS.fullmatch(text):
            raise InputError(f"is not {EXPECTED}, and no file has this name{meant(text, TILES)}")
        if len(letters) > _MOST_LETTERS:
            most = f"the largest tile has, {PERIODS[-1]} x {PERIODS[-1]}"
            raise InputError(f"{len(letters)} letters are more than {most}")
        return CfaPattern.of_letters(letters)
    except InputError as error:
        name = text if is_file else f"`pattern` {text[:_MOST_LETTERS]!r}"
        raise InputError(f"{name}: {str(error).removeprefix('pattern: ')}") from None


def _letters_in(name: str) -> str:
    """The rows in a file with a pattern, parted by "/"."""
    lines = read_text(name, _LARGEST_FILE, "a pattern", otherwise="latin-1").splitlines()
    rows = ["".join(row.split()) for line in lines for row in line.partition("#")[0].split("/")]
    return "/".join(row for row in rows if row)
