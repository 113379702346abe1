"""The tiles of filters that have names: wherever the letters of a tile may stand, its name may
too.
"""

import re
from collections.abc import Sequence
from itertools import product

TILES = {
    # Chakrabarti, Freeman and Zickler 2014, with K = 6
    "paper": "RGWWWW/GBWWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW",
    "Kodak": "WBWG/BWGW/WGWR/GWRW",  # Compton and Hamilton, US patent 8330839
    "Sony": "WRWG/BWGW/WGWR/GWBW",
    "Honda": "BWRW/WGWG/RWBW/WGWG",
    "Kaizu": "RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG",
    # of cars; C is clear: one colour, or two of three, and what panchromatic pixels see beyond them
    "RCCB": "RWRW/WBWB/RWRW/WBWB",
    "RCCG": "RWRW/WGWG/RWRW/WGWG",
    "RCCC": "WWWW/WRWR/WWWW/WRWR",
}
"""Name -> letters, row by row. Case does not count; "K=4" is the paper's block, RGGB, in every 4 x
4 pixels.
"""
CLEAR = "RCCB", "RCCG", "RCCC"
"""Names of tiles in which one of the channels has no filter."""
EXPECTED = (
    "the capital letters of a tile's filters, row by row, such as RGWW/GBWW/WWWW/WWWW, or a name: "
    f"{', '.join(name.casefold() for name in TILES)}, or K=4 for the paper's block in 4 x 4 pixels"
)
"""Texts that may stand for a tile, for messages."""
# "Sparse Color Filter #1" of GenICam is Kodak's tile, which begins at this place; the letters are
# the first row from there on. PFNC 2.4, section 3.1.9, numbers the letters of each (those of WGWR
# overlap there: its green ones are another's, by mistake).
_SPARSE = {"scf1wbwg": (0, 0), "scf1wgwb": (0, 2), "scf1wgwr": (2, 0), "scf1wrwg": (2, 2)}


def letters_of(text: str) -> str | None:
    """The letters of the tile with this name; None if no tile has it.

    Examples
    --------
    >>> from panchroma.shared.tiles import letters_of
    >>> letters_of("kodak"), letters_of("K = 3"), letters_of("RG/BW")
    ('WBWG/BWGW/WGWR/GWRW', 'RGW/GBW/WWW', None)
    """
    name = "".join(text.split()).casefold()
    if found := re.fullmatch(r"k=([0-9]{1,2})", name):
        period = int(found[1])
        return "/".join(row + "W" * (period - 2) for row in ("RG", "GB", *["WW"] * (period - 2)))
    if name in _SPARSE:
        return _begun(TILES["Kodak"].split("/"), *_SPARSE[name])
    return next((letters for known, letters in TILES.items() if known.casefold() == name), None)


def place_of(tile: tuple[str, ...]) -> tuple[str, tuple[int, int]]:
    """Name of a tile, and the (row, column) in it at which the letters of that name begin; "" and
    (0, 0) if it has none.

    Examples
    --------
    >>> from panchroma.shared.tiles import place_of
    >>> place_of(("GWRW", "WBWG", "BWGW", "WGWR")), place_of(("RGWW", "GBWW", "WWWW", "WWWW"))
    (('Kodak', (1, 0)), ('K=4', (0, 0)))
    >>> place_of(("RGW", "GWW", "WWB"))
    ('', (0, 0))
    """
    period = len(tile)
    known = TILES | {f"K={period}": letters_of(f"K={period}") or ""}
    backwards = range(period - 1, -1, -1)  # of places with the same letters the first is kept
    begun = {_begun(tile, *place): place for place in product(backwards, backwards)}
    found = ((name, begun[letters]) for name, letters in known.items() if letters in begun)
    return next(found, ("", (0, 0)))


def _begun(rows: Sequence[str], down: int, right: int) -> str:
    """The letters of a tile that begins at this row and column of another."""
    return "/".join(row[right:] + row[:right] for row in (*rows[down:], *rows[:down]))
