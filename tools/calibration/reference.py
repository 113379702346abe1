"""Reference colours of a chart: the built-in ColorChecker, or a CGATS file (.ti3, .cie), the format of Argyll CMS."""

import re
from pathlib import Path
from string import Template

import numpy as np

from shared.arrays import DoubleArray
from shared.colorimetry import lab_to_xyz
from shared.errors import InputError
from shared.reading import MAX_DOCUMENT, read_text

from .chart.place import COLUMNS, PATCHES

_TI3 = Path(__file__).with_name("chart.ti3")  # CGATS requires its declarations (KEYWORD) of non-standard keywords
_PLACE = re.compile(r"([A-F])0?([1-4])", re.IGNORECASE)
_COLUMNS = (("XYZ_X", "XYZ_Y", "XYZ_Z"), ("LAB_L", "LAB_A", "LAB_B"))
_WORD = re.compile(r'"([^"]*)"|([^"\s]+)')
_LARGEST = 1000  # XYZ on a scale of 100, or L*a*b*: no chart has larger values


def read_reference(path: Path) -> DoubleArray:
    """Read a CGATS file with XYZ (0..100) or L*a*b* of 24 patches; return XYZ (24, 3), D50 with white = 1, in reading order.

    Patches are named by column and row (A1 dark skin, A4 white, F4 black, as in Argyll's ColorChecker.cie) or numbered in reading
    order; without names they are in reading order. Raises InputError that names the file and what is wrong with it.
    """
    try:
        text = read_text(path, MAX_DOCUMENT, "a CGATS file", otherwise="latin-1")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    fields, rows = _table(text, path)
    columns = next((names for names in _COLUMNS if names[0] in fields), None)
    if columns is None:
        raise InputError(f"{path}: has neither XYZ_X, XYZ_Y, XYZ_Z nor LAB_L, LAB_A, LAB_B")
    if len(rows) != PATCHES or any(column not in fields for column in columns):
        raise InputError(f"{path}: {len(rows)} patches with {', '.join(columns)}, expected {PATCHES}")
    try:
        values = np.array([[float(row[fields.index(column)]) for column in columns] for row in rows])
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    if not np.isfinite(values).all() or np.abs(values).max() > _LARGEST:
        raise InputError(f"{path}: a colour is beyond {_LARGEST}; expected XYZ of 0..100, or L*a*b*")
    label = next((name for name in ("SAMPLE_LOC", "SAMPLE_NAME", "SAMPLE_ID") if name in fields), None)
    order = [_index(row[fields.index(label)]) if label else number for number, row in enumerate(rows)]
    if sorted(order) != list(range(PATCHES)):
        raise InputError(f"{path}: {label} does not name each of the patches A1 to F4 (or 1 to {PATCHES}) once")
    ordered = np.empty_like(values)
    ordered[order] = values
    return ordered / 100 if columns == _COLUMNS[0] else lab_to_xyz(ordered)


def ti3(reference: DoubleArray, camera: DoubleArray) -> str:
    """Return a .ti3 file, from which Argyll's colprof makes a profile.

    reference: (24, 3), XYZ (D50), white = 1.
    camera: (24, 3), camera RGB, 1 = white.

    colprof accepts device values from 0 to 100. A camera's values have no fixed scale: if one exceeds 1, all are scaled down.
    """
    camera = np.maximum(camera, 0) / max(1.0, float(camera.max()))
    rows = []
    for index, values in enumerate(100 * np.concatenate([reference, camera], axis=1)):
        name = f"{'ABCDEF'[index % COLUMNS]}{index // COLUMNS + 1}"
        rows.append(" ".join([name, *(f"{value:.6f}" for value in values)]))
    return Template(_TI3.read_text("utf-8")).substitute(number=PATCHES, rows="\n".join(rows))


def _table(text: str, path: Path) -> tuple[list[str], list[list[str]]]:
    """Return field names and rows of the first table."""
    words = [quoted or bare for quoted, bare in _WORD.findall(text)]
    try:
        begin = words.index("BEGIN_DATA_FORMAT")
        fields = words[begin + 1 : words.index("END_DATA_FORMAT", begin)]
        begin = words.index("BEGIN_DATA")
        words = words[begin + 1 : words.index("END_DATA", begin)]
    except ValueError:
        raise InputError(f"{path}: is not a CGATS file (no BEGIN_DATA_FORMAT and BEGIN_DATA)") from None
    if not fields or len(words) % len(fields):
        raise InputError(f"{path}: {len(words)} values do not fill rows of {len(fields)} fields")
    return fields, [words[start : start + len(fields)] for start in range(0, len(words), len(fields))]


def _index(name: str) -> int:
    """Return the index, in reading order, of a patch's name; -1 = not a name."""
    if place := _PLACE.fullmatch(name):
        return (int(place[2]) - 1) * COLUMNS + "ABCDEF".index(place[1].upper())
    return int(name) - 1 if re.fullmatch(r"[0-9]{1,3}", name) else -1
