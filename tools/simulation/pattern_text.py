"""A pattern of colour filters as users write it: letters, the name of a tile, or a file with
either.
"""

import os
import re
from contextlib import suppress
from dataclasses import replace

from ...shared import Camera, read_camera
from ...shared.errors import InputError, meant
from ...shared.figures import whole
from ...shared.pattern import PERIODS, CfaPattern
from ...shared.reading import File, naming, read_text
from ...shared.tiles import EXPECTED, TILES, letters_of

_PATTERN_LETTERS = re.compile(r"[A-Z/\s]+")
_MOST_LETTERS = 2 * PERIODS[-1] * (PERIODS[-1] + 1)  # with what parts the letters, and the rows
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
        name = text if is_file else f"`pattern` {text[: _MOST_LETTERS // 2]!r}"
        raise InputError(f"{name}: {str(error).removeprefix('pattern: ')}") from None


def camera_and_pattern(
    camera: File | None,
    pattern: str | int | CfaPattern | None = None,
    channels: str | None = None,
    origin: tuple[int, int] | None = None,
    stated: CfaPattern | None = None,
) -> tuple[Camera | None, CfaPattern]:
    """The camera in a file, and the pattern before its sensor.

    Raises InputError that names the file when the camera was measured with another pattern.

    Parameters
    ----------
    camera
        The file; None = there is none.
    pattern
        As a text, see `read_pattern`, as the period of the paper's pattern, or as it is; None =
        `stated`, or that of the camera file, or K = 6.
    channels, origin
        Replace those of the pattern.
    stated
        The pattern that a connected camera says it has.
    """
    known = read_camera(camera) if camera else None
    if isinstance(pattern, CfaPattern):
        tile = pattern
    elif pattern is not None:
        tile = read_pattern(pattern if isinstance(pattern, str) else f"K={pattern}")
        if known:
            with suppress(InputError):  # a camera of another pattern is refused below
                tile = replace(tile, channels=known.calibration.channels)
    else:
        tile = stated or (known and known.pattern) or CfaPattern.bayer()
    if channels is not None:
        tile = replace(tile, channels=channels)
    if origin is not None:
        if isinstance(origin, str) or len(origin) != 2:
            raise InputError(f"`origin` is {origin!r}, expected two whole numbers (row, column)")
        row, column = (whole("`origin`", place) for place in origin)
        tile = replace(tile, origin=(row, column))
    if known and camera:
        with naming(camera):
            known.check_pattern(tile)
    return known, tile


def _letters_in(name: str) -> str:
    """The rows in a file with a pattern, parted by "/"."""
    lines = read_text(name, _LARGEST_FILE, "a pattern", otherwise="latin-1").splitlines()
    rows = ["".join(row.split()) for line in lines for row in line.partition("#")[0].split("/")]
    return "/".join(row for row in rows if row)
