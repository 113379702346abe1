"""Files that list a sensor's defective pixels: text with one place per line, or JSON."""

import json
from dataclasses import replace
from pathlib import Path

from shared import Mosaic
from shared.errors import InputError
from shared.figures import parsed_json
from shared.reading import MAX_DOCUMENT, read_text

Places = tuple[tuple[int, int], ...]
_BEYOND = 10**9  # rows or columns of any sensor
_EXPECTED = 'lines of "row, column", or JSON: a list of [row, column], or an object with such a list as "defects"'


def read_defects(path: Path | str) -> Places:
    """Sensor (row, column) of each pixel in the list, counted from 0. In a text, "#" begins a comment.

    Raises InputError that names the file, and the line that is wrong.
    """
    try:
        text = read_text(path, MAX_DOCUMENT, "a list of defects")
    except InputError as error:
        raise InputError(f"{path}: {error}; expected {_EXPECTED}") from None
    return _from_json(path, text) if text.lstrip().startswith(("[", "{")) else _from_lines(path, text)


def with_defects(mosaic: Mosaic, places: Places) -> Mosaic:
    """The mosaic with `places` added to its calibration's defects. Raises InputError for a place outside of it."""
    rows, columns = mosaic.shape
    for row, column in places:
        if row >= rows or column >= columns:
            raise InputError(
                f"the list of defects has row {row}, column {column}, the shot {rows} rows and {columns} columns: "
                "it belongs to another sensor, or has columns before rows"
            )
    calibration = replace(mosaic.calibration, defects=mosaic.calibration.defects + places)
    return Mosaic(mosaic.samples, mosaic.pattern, calibration, mosaic.metadata)


def _from_json(path: Path | str, text: str) -> Places:
    try:
        document = parsed_json(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    listed = document.get("defects") if isinstance(document, dict) else document
    if not isinstance(listed, list):
        raise InputError(f"{path}: expected {_EXPECTED}")
    for entry in listed:
        if not (
            isinstance(entry, list) and len(entry) == 2 and all(type(value) is int and 0 <= value < _BEYOND for value in entry)
        ):
            raise InputError(f"{path}: {json.dumps(entry)[:40]} is not [row, column], whole numbers from 0")
    return tuple((row, column) for row, column in listed)


def _from_lines(path: Path | str, text: str) -> Places:
    places = []
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not fields:
            continue
        if len(fields) != 2 or not all(field.isascii() and field.isdigit() and len(field) < 10 for field in fields):
            raise InputError(f"{path}: line {number} is {line.strip()[:40]!r}; expected {_EXPECTED}")
        places.append((int(fields[0]), int(fields[1])))
    return tuple(places)
