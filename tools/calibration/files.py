"""The files of one calibration: frames, sorted by kind, and the camera.json that is updated or
written.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Any

from ...shared import Camera, InputError, Mosaic, OutputError, read_camera
from ...shared.figures import numbers
from ...shared.reading import File, file_name, naming
from ...shared.writing import write_durably
from ..batch.folders import DNGS, Search, file_key, search
from ..batch.jobs import identity
from ..io.backup import keep_old

Files = dict[str, list[str]]
"""The files to calibrate from: paths of each of `KINDS`, then of the charts under each of two
lights, by its name.
"""
KINDS = "shots", "dark", "flat"


def sort_files(requested: Mapping[str, Sequence[str]]) -> tuple[Files, list[Search]]:
    """Sort files by kind; returns also what was found and left out in folders.

    Raises InputError for a folder that cannot be read or has no DNG, for a file of two kinds, and
    for a shot under neither light.

    Parameters
    ----------
    requested : Mapping[str, Sequence[str]]
        Files, and folders with DNGs in them or below: of each of `KINDS`, then of the charts under
        each of two lights. Of shots, what is named dark* or flat*, or lies in a subfolder of such a
        name, is a dark or a flat frame.
    """
    files: Files = {kind: [] for kind in requested}
    searches, kind_of = [], dict[object, str]()
    # shots come last: a folder of them may hold frames that are named as another kind
    for kind in sorted(requested, key="shots".__eq__):
        result = search(requested[kind], DNGS)
        for folder, fault in result.failures:
            raise InputError(f"{folder}: {fault}")
        searches.append(result)
        for source in result.sources:
            folders = source.below.parts if source.below and kind == "shots" else ()
            names = [folder.lower() for folder in reversed(folders)]
            kinds = (other for name in names for other in KINDS[1:] if name.startswith(other))
            key, found = file_key(source.name), next(kinds, kind)
            if key not in kind_of:
                files[found].append(source.name)
            elif kind_of[key] != found and (kind != "shots" or not source.from_folder):
                both = f"{kind_of[key]} and as {found}"
                raise InputError(f"{source.name}: is given as {both}; a frame is of one kind")
            kind_of.setdefault(key, found)
    if len(requested) > len(KINDS) and files["shots"]:
        remedy = "name it after one of the two `chart_light`"
        raise InputError(f"{files['shots'][0]}: shows a chart under neither light; {remedy}")
    return files, searches


def check_output(output: Path, files: Files, *, replace_existing: bool) -> None:
    """Raise OutputError if the camera file cannot be written to `output`. Call it before the
    measurements.
    """
    try:
        is_file = not output.exists() or output.is_file()
    except OSError as error:  # a name that is too long
        raise OutputError(f"{output}: cannot be written ({error.strerror})") from None
    if output.is_dir():
        example = f"`output` names the camera file, for example {output / 'camera.json'}"
        raise OutputError(f"{output}: is a folder; {example}")
    if not is_file:
        raise OutputError(f"{output}: is a pipe or a device, not a file; choose another name")
    if not output.parent.is_dir():
        raise OutputError(f"{output}: the folder {output.parent} does not exist; create it first")
    if output.exists() and identity(output) in map(identity, chain(*files.values())):
        raise OutputError(f"{output}: is an input; choose another name")
    if output.exists() and not replace_existing:
        remedy = "`update` puts the new entries into it, `overwrite` replaces it"
        raise OutputError(f"{output}: exists already; {remedy}")


def read_known(path: File) -> Camera:
    """Return the camera in a file that is to be updated.

    Raises InputError that names the file and what is damaged in it.
    """
    camera = read_camera(path)
    planes = len(camera.calibration.black_level)
    names = "gamma.half_width_95", "noise.shot_error", "noise.read_error"
    for name in (*names, "black_level.standard_error"):
        entry, key = name.split(".")
        if (stated := camera.measured.get(entry, {}).get(key)) is not None:
            number = planes - 1 if entry == "gamma" else planes
            numbers(f"{file_name(path)}: measured.{name}", stated, number)
    return camera


def check_same(path: str | Path, old: Camera, base: Mosaic) -> None:
    """Raise InputError, naming the file, if a frame is not from the camera in it: another sensor,
    pattern, size or white level.
    """
    with naming(path):
        old.check(base.pattern, base.calibration)
        old.check_size(base.shape)
    known, stated = old.calibration.white_level, base.calibration.white_level
    if known != stated:
        raise InputError(f"{path}: the shots have white level {stated}, the camera file {known}")


def write_camera(path: File, camera: Camera, *, overwrite: bool = False) -> Path | None:
    """Write the file atomically. With `overwrite` it may replace one, which is kept beside it, see
    `keep_old`.

    Raises OutputError.

    Returns the name of the old file; None if there was none.
    """
    kept = None
    if overwrite and isinstance(path, str | PathLike) and Path(path).exists():
        kept = keep_old(Path(path))
    write_durably(path, (_text(camera.to_json()) + "\n").encode(), overwrite=overwrite)
    return kept


def _text(value: Any, indent: str = "") -> str:
    """Return JSON with a line per field and per row of a matrix, so that a diff shows the changed
    figures.
    """
    deeper = indent + "  "
    if isinstance(value, dict) and value:
        fields = ((json.dumps(key), _text(entry, deeper)) for key, entry in value.items())
        rows = [f"{deeper}{name}: {text}" for name, text in fields]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    is_list = isinstance(value, list | tuple) and value
    if is_list and isinstance(value[0], list | tuple | str | dict):
        rows = [f"{deeper}{_text(entry, deeper)}" for entry in value]
        return "[\n" + ",\n".join(rows) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
