"""camera.json: the calibration of one camera, its filter pattern, and how each entry was measured.

The file is the JSON object of a calibration with three more fields, "pattern", "size" and
"measured". All are optional, so a bare calibration is a valid camera file; channels that either
the calibration or the pattern names are those of both.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from .calibration import SensorCalibration
from .errors import InputError
from .figures import parsed_json, shown, size
from .lights import without_gamma
from .mosaic import Mosaic
from .pattern import CfaPattern
from .reading import MAX_DOCUMENT, File, naming, read_text
from .white_balance import balanced, estimate_neutral

MEASURABLE = ("gamma", "noise", "black_level", "defects", "colour", "shading")
"""The entries of a calibration that "measured" may describe; "colour" is camera_to_xyz and neutral,
or lights.
"""


@dataclass(frozen=True)
class Camera:
    """The content of a camera file.

    Attributes
    ----------
    calibration : SensorCalibration
        The calibration; its field `camera` is set to its own id.
    pattern : CfaPattern | None
        The filter pattern that the camera was measured with; None = unknown.
    measured : Mapping[str, Mapping[str, Any]]
        Entry (one of MEASURABLE) -> how it was measured, a JSON object for people and reports.
    size : tuple[int, int] | None
        (rows, columns) of the frames that it was measured on; None = unknown.

    Raises
    ------
    InputError
        When pattern and calibration have different channels, when `measured` names an unknown
        entry, and for a `size` that no frame has.

    Examples
    --------
    >>> import json
    >>> from pathlib import Path
    >>> from panchroma.shared import Camera, CfaPattern, SensorCalibration, read_camera
    >>> camera = Camera(SensorCalibration.of_bits(12, gamma=(0.9, 1.1, 0.8), sensor="bench"),
    ...     CfaPattern.bayer(6))
    >>> Path("camera.json").write_text(json.dumps(camera.to_json())) > 0
    True
    >>> read_camera("camera.json") == camera
    True
    """

    calibration: SensorCalibration
    pattern: CfaPattern | None = None
    measured: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        named = replace(self.calibration, camera=self.calibration.id)
        object.__setattr__(self, "calibration", named)
        if self.pattern is not None:
            self.calibration.check_pattern(self.pattern)
        for entry, how in self.measured.items():
            if entry not in MEASURABLE:
                known = f"one of {', '.join(MEASURABLE)}"
                raise InputError(f"camera: measured has an unknown entry {entry!r}; {known}")
            if not isinstance(how, Mapping):
                raise InputError(f"camera: measured.{entry} is {shown(how)}, expected an object")
        if self.size is not None:
            object.__setattr__(self, "size", size("camera: size", self.size))
            for defect in self.calibration.defects:
                if defect[0] >= self.size[0] or defect[1] >= self.size[1]:
                    where = f"row {defect[0]}, column {defect[1]}"
                    raise InputError(f"camera: the defect at {where} lies outside `size`")

    def calibrated(self, mosaic: Mosaic) -> Mosaic:
        """The shot with this camera's calibration; what it does not know of colours, noise, defects
        and lens stays the shot's.

        A camera with two lights knows no white: that of the shot counts, or, where nobody has
        measured it, an estimate.

        Raises
        ------
        InputError
            When the shot has another sensor, pattern, or number of bits, and when it has another
            size and the camera has defects or shading, which would be elsewhere in it; the message
            names both.
        """
        self.check(mosaic.pattern, mosaic.calibration)
        if self.calibration.defects or self.calibration.shading:
            self.check_size(mosaic.shape)
        known, own = self.calibration, mosaic.calibration
        colours = own if known.camera_to_xyz is None and known.neutral is None else known
        white = known if colours is known and known.knows_white else own
        # A shot of a picture says 1, 1, 1, for pictures are balanced; sensors are not.
        of_picture = known.lights and white.neutral and len(set(white.neutral)) == 1
        measured = None if of_picture else white.neutral
        # What this camera's file does not state stays that of the shot; what was measured to be
        # absent does not.
        unknown = {"noise", "defects", "sensor", "shading"} - self.measured.keys()
        kept = {name: getattr(known, name) or getattr(own, name) for name in unknown}
        # The gamma of this file counts more than that of the shot's lights.
        lights = known.lights if colours is known else without_gamma(own.lights)
        kept |= {"camera_to_xyz": colours.camera_to_xyz, "lights": lights}
        estimated = white.neutral_estimated and measured is not None
        calibration = replace(known, **kept, neutral=measured, neutral_estimated=estimated)
        result = Mosaic(mosaic.codes, mosaic.pattern, calibration, mosaic.metadata)
        if not (known.lights and measured is None and (seen := estimate_neutral(result))):
            return result
        return replace(result, calibration=balanced(calibration, np.array(seen), estimated=True))

    def check(self, pattern: CfaPattern, calibration: SensorCalibration) -> None:
        """Raise InputError unless a shot with this pattern and calibration can come from this
        camera; the message names both.
        """
        sensor, other = self.calibration.sensor, calibration.sensor
        if sensor and other and sensor != other:
            ours = f"the camera file of sensor {sensor!r}"
            raise InputError(f"the shot is from sensor {other!r}, {ours}")
        self.check_pattern(pattern)
        if calibration.bits != self.calibration.bits:
            ours = f"the camera file {self.calibration.bits}"
            raise InputError(f"the shot has {calibration.bits} bits, {ours}")

    def check_pattern(self, pattern: CfaPattern) -> None:
        """Raise InputError unless this camera was measured with this pattern; the message names
        both.
        """
        self.calibration.check_pattern(pattern)
        if self.pattern is not None and self.pattern.letters_from() != pattern.letters_from():
            patterns = f"the pattern is {_shown(pattern)}, the camera file's {_shown(self.pattern)}"
            raise InputError(f"{patterns}: they belong to different sensors")

    def check_size(self, shape: tuple[int, int]) -> None:
        """Raise InputError unless this camera was measured on frames of this shape, or does not
        say; the message names both.
        """
        if self.size and self.size != shape:
            (rows, columns), (height, width) = shape, self.size
            known = f"those of the camera file {width} x {height}"
            raise InputError(f"the frames have {columns} x {rows} pixels, {known}")

    def to_json(self) -> dict[str, Any]:
        """The camera as a JSON object, the content of camera.json; `from_json` turns it back."""
        document = self.calibration.to_json()
        del document["camera"]  # the file's own id
        if self.pattern is not None:
            document["pattern"] = asdict(self.pattern)
        if self.size is not None:
            document["size"] = list(self.size)
        if self.measured:
            entries = [entry for entry in MEASURABLE if entry in self.measured]
            document["measured"] = {entry: dict(self.measured[entry]) for entry in entries}
        return document

    @classmethod
    def from_json(cls, document: Any) -> "Camera":
        """The camera in a JSON object made by `to_json`.

        Raises
        ------
        InputError
            That names the field.
        """
        if not isinstance(document, dict):
            raise InputError(f"camera: expected a JSON object, found {type(document).__name__}")
        given = dict(document)
        measured, pattern = given.pop("measured", {}), given.pop("pattern", None)
        shape = given.pop("size", None)
        if not isinstance(measured, dict):
            raise InputError(f"camera: measured is {shown(measured)}, expected an object")
        if isinstance(pattern, dict) and "channels" in given:
            pattern = {"channels": given["channels"], **pattern}
        known = None if pattern is None else CfaPattern.from_json(pattern)
        if known is not None:
            given.setdefault("channels", known.channels)
        return cls(SensorCalibration.from_json(given), known, measured, shape)


def read_camera(path: File) -> Camera:
    """The camera in a camera file.

    Raises
    ------
    InputError
        That names the file and what is wrong with it.

    Examples
    --------
    >>> from pathlib import Path
    >>> from panchroma.shared import read_camera
    >>> document = '{"schema": 1, "gamma": [0.9, 1.1, 0.8], "white_level": 60000}'
    >>> Path("camera.json").write_text(document) > 0
    True
    >>> read_camera("camera.json").calibration.gamma
    (0.9, 1.1, 0.8)
    """
    with naming(path):
        return Camera.from_json(parsed_json(read_text(path, MAX_DOCUMENT, "a camera file")))


def _shown(pattern: CfaPattern) -> str:
    return f"{pattern.channels} period {pattern.period} ({' '.join(pattern.letters_from())})"
