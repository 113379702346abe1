"""camera.json: what is known of one camera. Its calibration, the filter pattern it was measured with, and how it was measured.

The file is the calibration's JSON object with two more fields, "pattern" and "measured", both optional: a calibration written by
hand is a camera file too.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from .calibration import SensorCalibration
from .errors import InputError
from .mosaic import Mosaic
from .pattern import CfaPattern
from .reading import MAX_DOCUMENT, read_whole

MEASURABLE = ("gamma", "noise", "black_level", "defects", "colour")
"""The parts of a calibration that "measured" may tell of; "colour" is camera_to_xyz and neutral."""


@dataclass(frozen=True)
class Camera:
    """One camera, as camera.json keeps it.

    calibration: its `camera` names this file. pattern: the filter pattern; None where the file does not say. measured: part (see
    MEASURABLE) -> how it was measured, a JSON object for people and reports.
    Raises InputError when pattern and calibration name different channels, or `measured` an unknown part.
    """

    calibration: SensorCalibration
    pattern: CfaPattern | None = None
    measured: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "calibration", replace(self.calibration, camera=self.calibration.id))
        if self.pattern is not None:
            self.calibration.check_pattern(self.pattern)
        for part, how in self.measured.items():
            if part not in MEASURABLE:
                raise InputError(f"camera: measured has an unknown part {part!r}; one of {', '.join(MEASURABLE)}")
            if not isinstance(how, Mapping):
                raise InputError(f"camera: measured.{part} is {how!r}, expected an object")

    def calibrated(self, mosaic: Mosaic) -> Mosaic:
        """The shot with this camera's calibration in place of its own; where this one knows no colours or noise, the shot's stay.

        Raises InputError, naming both, when the shot is another sensor's, has another pattern, or another number of bits.
        """
        self.check(mosaic.pattern, mosaic.calibration)
        known, own = self.calibration, mosaic.calibration
        colours = own if known.camera_to_xyz is None and known.neutral is None else known
        calibration = replace(
            known,
            noise=known.noise or own.noise,
            sensor=known.sensor or own.sensor,
            camera_to_xyz=colours.camera_to_xyz,
            neutral=colours.neutral,
        )
        return Mosaic(mosaic.codes, mosaic.pattern, calibration, mosaic.metadata)

    def check(self, pattern: CfaPattern, calibration: SensorCalibration) -> None:
        """Raise InputError, naming both, unless a shot with this pattern and calibration may come from this camera."""
        sensor, other = self.calibration.sensor, calibration.sensor
        if sensor and other and sensor != other:
            raise InputError(f"the shot is from sensor {other!r}, the camera file of sensor {sensor!r}")
        self.check_pattern(pattern)
        if calibration.bits != self.calibration.bits:
            raise InputError(f"the shot has {calibration.bits} bits, the camera file {self.calibration.bits}")

    def check_pattern(self, pattern: CfaPattern) -> None:
        """Raise InputError, naming both, unless the pattern is the one that this camera was measured with."""
        self.calibration.check_pattern(pattern)
        if self.pattern is not None and self.pattern.letters_from() != pattern.letters_from():
            raise InputError(
                f"the pattern is {_shown(pattern)}, the camera file's {_shown(self.pattern)}: they belong to different sensors"
            )

    def to_json(self) -> dict[str, Any]:
        """A JSON object from which `from_json` makes an equal camera."""
        document = self.calibration.to_json()
        del document["camera"]  # It would be the file's own id.
        if self.pattern is not None:
            document["pattern"] = {
                "tile": list(self.pattern.tile),
                "origin": list(self.pattern.origin),
                "channels": self.pattern.channels,
            }
        if self.measured:
            document["measured"] = {part: dict(self.measured[part]) for part in MEASURABLE if part in self.measured}
        return document

    @classmethod
    def from_json(cls, document: Any) -> "Camera":
        """Inverse of `to_json`; raises InputError that names the field."""
        if not isinstance(document, dict):
            raise InputError(f"camera: expected a JSON object, found {type(document).__name__}")
        given = dict(document)
        pattern, measured = given.pop("pattern", None), given.pop("measured", {})
        if not isinstance(measured, dict):
            raise InputError(f"camera: measured is {measured!r}, expected an object")
        return cls(SensorCalibration.from_json(given), None if pattern is None else _pattern(pattern), measured)


def read_camera(path: Path | str) -> Camera:
    """The camera in a file; raises InputError that names the file and what is wrong in it."""
    try:
        text = read_whole(path, MAX_DOCUMENT, "a camera file")
        try:
            document = json.loads(text.decode("utf-8"))
        except (ValueError, RecursionError) as error:  # ValueError: no UTF-8, no JSON, or a number of thousands of digits
            raise InputError(f"is not JSON ({error})") from None
        return Camera.from_json(document)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _pattern(given: Any) -> CfaPattern:
    """A pattern out of JSON, or an InputError that names the field."""
    if not isinstance(given, dict):
        raise InputError(f"camera: pattern is {given!r}, expected an object")
    if unknown := sorted(set(given) - {"tile", "origin", "channels"}):
        raise InputError(f"camera: pattern has an unknown field {unknown[0]!r}")
    tile, origin, channels = given.get("tile"), given.get("origin", [0, 0]), given.get("channels", "")
    if not isinstance(tile, list) or not all(isinstance(row, str) for row in tile):
        raise InputError("camera: pattern.tile is not a list of strings")
    if not isinstance(origin, list) or len(origin) != 2 or not all(type(value) is int for value in origin):
        raise InputError("camera: pattern.origin is not [row, column]")
    if not isinstance(channels, str):
        raise InputError(f"camera: pattern.channels is {channels!r}, expected letters")
    return CfaPattern(tuple(tile), (origin[0], origin[1]), channels)


def _shown(pattern: CfaPattern) -> str:
    return f"{pattern.channels} period {pattern.period} ({' '.join(pattern.letters_from())})"
