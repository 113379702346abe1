"""Files that list a sensor's defective pixels, one place per line."""

from dataclasses import replace
from pathlib import Path

from shared import Mosaic
from shared.errors import InputError
from shared.reading import MAX_DOCUMENT, read_text

Places = tuple[tuple[int, int], ...]
_EXPECTED = 'lines of "row, column", counted from 0'
_DIGITS = 9  # of a row or column, at most


def read_defects(path: Path | str) -> Places:
    """Sensor (row, column) of each pixel in the list, counted from 0. "#" begins a comment.

    Raises InputError that names the file, and the line that is wrong.
    """
    try:
        text = read_text(path, MAX_DOCUMENT, "a list of defects")
    except InputError as error:
        raise InputError(f"{path}: {error}; expected {_EXPECTED}") from None
    places = []
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not fields:
            continue
        if len(fields) != 2 or not all(field.isascii() and field.isdigit() and len(field) <= _DIGITS for field in fields):
            raise InputError(f"{path}: line {number} is {line.strip()[:40]!r}; expected {_EXPECTED}")
        places.append((int(fields[0]), int(fields[1])))
    return tuple(places)


def with_defects(mosaic: Mosaic, places: Places) -> Mosaic:
    """The mosaic with `places` added to its calibration's defects. Raises InputError for a place outside of it."""
    rows, columns = mosaic.shape
    for row, column in places:
        if row >= rows or column >= columns:
            raise InputError(
                f"the list of defects has row {row}, column {column}, the shot {rows} rows and {columns} columns: "
                "it belongs to another sensor, or has columns before rows"
            )
    return mosaic.calibrated(replace(mosaic.calibration, defects=mosaic.calibration.defects + places))
