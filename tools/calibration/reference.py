"""Reference colours of a chart: the built-in ColorChecker, or a CGATS file (.ti3, .cie), the format
of Argyll CMS.
"""

import re

import numpy as np

from ...shared import DoubleArray, InputError
from ...shared.reading import MAX_DOCUMENT, File, naming, read_text
from ..io.colour import lab_to_xyz, xyz_to_lab
from ..simulation.drawn.charts import color_checker_xyz
from .chart.place import COLUMNS, PATCHES

_PLACE = re.compile(r"([A-F])0?([1-6])", re.IGNORECASE)
_COLUMNS = (("XYZ_X", "XYZ_Y", "XYZ_Z"), ("LAB_L", "LAB_A", "LAB_B"))
_WHITE = 18
_LARGEST_COORDINATE = 10_000
_LEAST_WHITE, _MOST_WHITE = 0.7, 1.1  # Y of the white patch: 0.88 to 0.92 on charts sold
_TINTED = 6.0  # chroma of greys: of charts sold below 3, of their XYZ for D55 7, for D65 19


def read_reference(path: File | None) -> DoubleArray:
    """Read a CGATS file with XYZ or L*a*b* of 24 patches; return XYZ (24, 3), D50 with white = 1,
    in reading order. None = those of the built-in ColorChecker.

    XYZ may be those of 0 to 1 or of 0 to 100, which the white patch tells. Patches are named by
    column and row (A1 dark skin, A4 white, F4 black, as in Argyll's ColorChecker.cie), by row and
    column (A1 dark skin, D1 white, D6 black) or numbered in reading order; without names they are
    in reading order.

    Raises InputError that names the file and what is wrong with it.
    """
    if path is None:
        return color_checker_xyz()
    with naming(path):
        return _reference(read_text(path, MAX_DOCUMENT, "a CGATS file", otherwise="latin-1"))


def _reference(text: str) -> DoubleArray:
    """Return XYZ (24, 3) in reading order, from the text of a file; raises InputError."""
    fields, rows = _table(text.upper())  # X-Rite's own file names its fields Lab_L, Lab_a, Lab_b
    columns = next((names for names in _COLUMNS if all(name in fields for name in names)), None)
    if columns is None:
        remedy = "turn spectra into XYZ for D50 and 2 degrees, as Argyll's spec2cie does"
        raise InputError(f"has neither XYZ_X, XYZ_Y, XYZ_Z nor LAB_L, LAB_A, LAB_B; {remedy}")
    if len(rows) != PATCHES:
        raise InputError(f"{len(rows)} patches with {', '.join(columns)}, expected {PATCHES}")
    try:
        places = [fields.index(column) for column in columns]
        values = np.array([[_number(row[place]) for place in places] for row in rows])
    except ValueError as error:
        raise InputError(str(error)) from None
    if not (np.abs(values) <= _LARGEST_COORDINATE).all():
        raise InputError(f"a colour is not a number up to {_LARGEST_COORDINATE}")
    labels = [name for name in ("SAMPLE_LOC", "SAMPLE_NAME", "SAMPLE_ID") if name in fields]
    named = [_order([row[fields.index(label)] for row in rows]) for label in labels]
    order = next(filter(None, named), [])
    if labels and not order:
        expected = f"each of the patches A1 to F4 (or 1 to {PATCHES}) once"
        raise InputError(f"{' or '.join(labels)} does not name {expected}")
    ordered = np.empty_like(values)
    ordered[order or list(range(PATCHES))] = values
    return _checked(_scaled(ordered) if columns == _COLUMNS[0] else lab_to_xyz(ordered))


def _number(word: str) -> float:
    return float(word.replace(",", "."))  # X-Rite's own file has decimal commas


def _scaled(values: DoubleArray) -> DoubleArray:
    """Return XYZ with white = 1, from those of 0 to 1 or of 0 to 100."""
    white = float(values[_WHITE, 1])
    for scale in (1, 100):
        if _LEAST_WHITE <= white / scale <= _MOST_WHITE:
            return values / scale
    expected = "expected about 0.9 (of 0 to 1) or 90 (of 0 to 100), relative to perfect white"
    remedy = "divide all by what that reads, or correct the order"
    raise InputError(f"the white patch (A4) has XYZ_Y {white:g}, {expected}; {remedy}")


def _checked(reference: DoubleArray) -> DoubleArray:
    """Return the reference. Raises InputError unless its greys get darker from patch to patch and
    are grey for D50.
    """
    grey = reference[_WHITE:]
    darker = (np.diff(grey[:, 1]) < 0).all() and _LEAST_WHITE <= grey[0, 1] <= _MOST_WHITE
    if reference.min() < 0 or not darker:
        expected = "from white, about 0.9 of perfect white, to black; correct scale or order"
        raise InputError(f"the grey row (A4 to F4) does not get darker {expected}")
    tint = np.median(xyz_to_lab(grey)[:, 1:], axis=0)
    if np.hypot(*tint) > _TINTED:
        found = f"(a* {tint[0]:.0f}, b* {tint[1]:.0f}), as for another light than D50"
        raise InputError(f"the grey row has a tint {found}; adapt the colours to D50")
    return reference


def _table(text: str) -> tuple[list[str], list[list[str]]]:
    """Return field names and rows of the first table."""
    words = [quoted or bare for quoted, bare in re.findall(r'"([^"]*)"|([^"\s]+)', text)]
    try:
        begin = words.index("BEGIN_DATA_FORMAT")
        fields = words[begin + 1 : words.index("END_DATA_FORMAT", begin)]
        begin = words.index("BEGIN_DATA")
        words = words[begin + 1 : words.index("END_DATA", begin)]
    except ValueError:
        raise InputError("is not a CGATS file (no BEGIN_DATA_FORMAT and BEGIN_DATA)") from None
    if not fields or len(words) % len(fields):
        raise InputError(f"{len(words)} values do not fill rows of {len(fields)} fields")
    starts = range(0, len(words), len(fields))
    return fields, [words[start : start + len(fields)] for start in starts]


def _order(names: list[str]) -> list[int]:
    """Return the index in reading order of each patch, [] unless the names are those of all
    patches.
    """
    matches = filter(None, map(_PLACE.fullmatch, names))
    places = [(match[1].upper(), int(match[2])) for match in matches]
    by_column = [(number - 1) * COLUMNS + "ABCDEF".index(letter) for letter, number in places]
    by_row = ["ABCDEF".index(letter) * COLUMNS + number - 1 for letter, number in places]
    numbered = [int(name) - 1 for name in names if re.fullmatch(r"[0-9]{1,3}", name)]
    for order in (by_column, by_row, numbered):
        if sorted(order) == list(range(PATCHES)):
            return order
    return []
