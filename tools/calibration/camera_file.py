"""Write camera.json: merge new parts into an existing file, keep the old file, report the difference."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from shared import Camera, read_camera
from shared.calibration import NoiseModel, SensorCalibration
from shared.errors import InputError
from shared.writing import write_durably

_FIELDS = {
    "gamma": ("gamma",),
    "noise": ("noise",),
    "black_level": ("black_level",),
    "defects": ("defects",),
    "colour": ("camera_to_xyz", "neutral"),
}
_LONG = 8  # longer lists are not spelt out in the difference


def merged(old: Camera, new: Camera) -> Camera:
    """Return `old` with the parts that `new` has measured. Noise is in scene units, so a new gamma rescales an old noise model.

    Raises InputError, naming both, if the two are different sensors or patterns.
    """
    if new.pattern is not None:
        old.check(new.pattern, new.calibration)
    before, after = old.calibration, new.calibration
    if before.white_level != after.white_level:
        raise InputError(f"the shots have white level {after.white_level}, the camera file {before.white_level}")
    changes: dict[str, Any] = {name: getattr(after, name) for part in new.measured for name in _FIELDS[part]}
    if "gamma" in new.measured and "noise" not in new.measured and before.noise is not None:
        ratio = after.full_scale / before.full_scale
        shot, read = (tuple(ratio * figure for figure in figures) for figures in (before.noise.shot, before.noise.read))
        changes["noise"] = NoiseModel(shot, read)
    calibration: SensorCalibration = replace(before, **changes, sensor=before.sensor or after.sensor)
    return Camera(calibration, new.pattern or old.pattern, {**old.measured, **new.measured})


def difference(old: Camera, new: Camera) -> list[str]:
    """Return one line per changed field: name, old value, new value."""
    before, after = _flat(old.to_json()), _flat(new.to_json())
    changes = ((name, before.get(name, "(none)"), after.get(name, "(none)")) for name in sorted({*before, *after}))
    return [f"{name}: {_short(was)} -> {_short(now)}" for name, was, now in changes if was != now]


def write_camera(path: Path, camera: Camera, *, overwrite: bool = False) -> None:
    """Write the file atomically. With `overwrite` it may replace one, which is kept as NAME.bak. Raises OutputError."""
    if overwrite and path.exists():
        write_durably(path.with_name(path.name + ".bak"), path.read_bytes(), overwrite=True)
    write_durably(path, (_text(camera.to_json()) + "\n").encode(), overwrite=overwrite)


def updated(path: Path, new: Camera) -> tuple[Camera, list[str]]:
    """Return the camera in a file with the newly measured parts, and the difference to the file. Raises InputError."""
    old = read_camera(path)
    try:
        result = merged(old, new)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return result, difference(old, result)


def _text(value: Any, indent: str = "") -> str:
    """Return JSON with a line per field and per row of a matrix, so that a diff shows the changed figures."""
    deeper = indent + "  "
    if isinstance(value, dict) and value:
        rows = [f"{deeper}{json.dumps(key)}: {_text(entry, deeper)}" for key, entry in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple | str):
        rows = [f"{deeper}{_text(entry, deeper)}" for entry in value]
        return "[\n" + ",\n".join(rows) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _flat(document: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a JSON object with one level: nested keys are joined by dots."""
    flat: dict[str, Any] = {}
    for key, value in document.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: json.loads(json.dumps(value))}
    return flat


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > _LONG:
        return f"{len(value)} entries"
    if isinstance(value, list):
        return "[" + ", ".join(_short(entry) for entry in value) + "]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
