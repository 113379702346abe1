"""Write camera.json: merge new parts into an existing file, keep the old file, report the difference."""

import json
import os
from collections.abc import Container, Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from shared import Camera, Mosaic, read_camera
from shared.calibration import NoiseModel, SensorCalibration
from shared.errors import InputError, OutputError
from shared.writing import write_durably

from .observations import KEPT, Observations

_FIELDS = {
    "gamma": ("gamma",),
    "noise": ("noise",),
    "black_level": ("black_level",),
    "defects": ("defects",),
    "colour": ("camera_to_xyz", "neutral"),
    "shading": ("shading",),
    "aberration": ("aberration",),
}
_ERRORS = {"gamma": "half_width_95", "noise": "shot_error", "colour": "leave_one_out_dE2000"}
_LONG = 8  # longer lists are not spelt out in the difference


def read_known(path: Path) -> tuple[Camera, Observations]:
    """Return the camera in a file, and the observations that the file keeps. Raises InputError that names the file."""
    camera = read_camera(path)
    try:
        return camera, Observations.of_camera(camera)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


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


def unsupported(old: Camera, known: Observations) -> list[str]:
    """Return the measured parts of a camera file without the figures that they came from: an earlier version kept none."""
    supported = {
        "gamma": known.charts or known.scenes,
        "noise": known.flats or (known.charts and _from_chart(old.measured.get("noise", {}))),
        "black_level": known.dark,
        "defects": known.dark or known.flats,
        "colour": known.charts,
        "shading": True,  # replaced as a whole
        "aberration": True,
    }
    return [part for part in old.measured if not supported[part]]


def merged(old: Camera, new: Camera, fixed: Container[str]) -> Camera:
    """Return `old` with the parts that `new` has measured. Noise is in scene units, so a new gamma rescales an old noise model.

    fixed: parts of `old` that `new` was not concluded from; they stay where they are better known.
    """
    before, after = old.calibration, new.calibration
    parts = [part for part in new.measured if part not in fixed or not _better(part, old.measured[part], new.measured[part])]
    changes: dict[str, Any] = {name: getattr(after, name) for part in parts for name in _FIELDS[part]}
    if "gamma" in parts and "noise" not in parts and before.noise is not None:
        ratio = after.full_scale / before.full_scale
        shot, read = (tuple(ratio * figure for figure in figures) for figures in (before.noise.shot, before.noise.read))
        changes["noise"] = NoiseModel(shot, read)
    calibration: SensorCalibration = replace(before, **changes, sensor=before.sensor or after.sensor)
    return Camera(calibration, new.pattern or old.pattern, {**old.measured, **{part: new.measured[part] for part in parts}})


def difference(old: Camera, new: Camera) -> list[str]:
    """Return one line per changed field: name, old value, new value."""
    before, after = _flat(old.to_json()), _flat(new.to_json())
    names = [name for name in sorted({*before, *after}) if before.get(name) != after.get(name) and f".{KEPT}." not in name]
    changes = [(name, _short(before.get(name, "(none)")), _short(after.get(name, "(none)"))) for name in names]
    # Long lists may change and keep their length; numbers that look alike have not changed for people.
    return [f"{name}: {was} -> {now}" for name, was, now in changes if was != now or now.endswith("entries")]


def write_camera(path: Path, camera: Camera, *, overwrite: bool = False) -> Path | None:
    """Write the file atomically. With `overwrite` it may replace one, which is kept beside it; returns its new name, or None.

    The name is the first free one of NAME.bak, NAME.bak2, ...: no earlier copy is ever replaced. Raises OutputError.
    """
    kept = _kept_copy(path) if overwrite and path.exists() else None
    write_durably(path, (_text(camera.to_json()) + "\n").encode(), overwrite=overwrite)
    return kept


def _kept_copy(path: Path) -> Path:
    """Copy a file to the first free one of NAME.bak, NAME.bak2, ..., and return that. Raises OutputError."""
    content = path.read_bytes()
    for number in count(1):
        spare = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        try:
            write_durably(spare, content)
        except OutputError:
            if os.path.lexists(spare):  # also when another process was faster
                continue
            raise
        break
    return spare


def _from_chart(noise: Mapping[str, Any]) -> bool:
    return "chart" in str(noise.get("from"))


def _better(part: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Return whether a part of an earlier version's file is better known than the new one, by the figures recorded for people."""
    if part == "noise" and _from_chart(old) != _from_chart(new):
        return _from_chart(new)
    try:
        known, found = (np.max(np.array(facts[_ERRORS[part]], np.float64)) for facts in (old, new))
    except (KeyError, TypeError, ValueError):
        return False
    return bool(known < found)


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
