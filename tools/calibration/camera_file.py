"""Read a camera.json that is to be updated, and write one."""

import json
from pathlib import Path
from typing import Any

from shared import Camera, Mosaic, read_camera
from shared.errors import InputError
from shared.writing import keep_old, write_durably

from .assumed import Assumed


def read_known(path: Path) -> Camera:
    """Return the camera in a file that is to be updated. Raises InputError that names the file and what is damaged in it."""
    camera = read_camera(path)
    try:
        Assumed.of(camera.calibration, measured=camera.measured)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return camera


def check_same(path: Path, old: Camera, base: Mosaic) -> None:
    """Raise InputError, naming the file, if a frame is not from the camera in it: another sensor, pattern or white level."""
    try:
        old.check(base.pattern, base.calibration)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if old.calibration.white_level != base.calibration.white_level:
        raise InputError(
            f"{path}: the shots have white level {base.calibration.white_level}, the camera file {old.calibration.white_level}"
        )


def write_camera(path: Path, camera: Camera, *, overwrite: bool = False) -> Path | None:
    """Write the file atomically. With `overwrite` it may replace one, which is kept beside it, see `keep_old`.

    Returns the name of the old file; None if there was none. Raises OutputError.
    """
    kept = keep_old(path) if overwrite and path.exists() else None
    write_durably(path, (_text(camera.to_json()) + "\n").encode(), overwrite=overwrite)
    return kept


def _text(value: Any, indent: str = "") -> str:
    """Return JSON with a line per field and per row of a matrix, so that a diff shows the changed figures."""
    deeper = indent + "  "
    if isinstance(value, dict) and value:
        rows = [f"{deeper}{json.dumps(key)}: {_text(entry, deeper)}" for key, entry in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple | str | dict):
        rows = [f"{deeper}{_text(entry, deeper)}" for entry in value]
        return "[\n" + ",\n".join(rows) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
