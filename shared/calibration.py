"""The calibration of one sensor: the weights of Eq. 7, noise, black and white level, colour,
defects.

Scene units: linear camera RGB in which 1.0 is the scene's white (the white level of its source,
black subtracted). A panchromatic pixel reads sum_i gamma_i channel_i (Eq. 7), so the full scale of
every pixel of the sensor is sum_i gamma_i scene units.
"""

import hashlib
import json
import math
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import lights as two_lights
from .arrays import DoubleArray, FloatArray, IndexArray
from .colorimetry import is_pair
from .errors import InputError
from .figures import built, numbers, shown, whole
from .pattern import PANCHROMATIC, CfaPattern
from .reading import MAX_PIXELS
from .shading import Shading

SCHEMA = 1
OPTIONAL = "neutral_estimated", "shading", "lights"
"""Fields that a JSON object has only where they are not empty."""
BITS = range(8, 17)
_Limits = tuple[float, float]
_KINDS = {"channels": str, "sensor": str, "camera": str, "neutral_estimated": bool}

# What a camera can have, with orders of magnitude to spare. Single precision computes with squares
# and quotients of these figures: beyond the limits a render would overflow, without an error.
NOISE_RANGE = (1e-12, 1e3)  # 0 is allowed too: the paper's noise has no shot noise
_LEAST_RANGE = 16  # codes from black to white
# One in 24 of a sensor of 24 megapixels; looking for more in a list takes longer than a render.
_MOST_DEFECTS = 1 << 20


@dataclass(frozen=True)
class NoiseModel:
    """Poisson-Gaussian noise per plane (the channels, then panchromatic): variance = shot * signal
    + read**2, in scene units.

    Attributes
    ----------
    shot : tuple[float, ...]
        Variance per scene unit of signal, 0 or more, one value per plane: the scene units that one
        electron adds.
    read : tuple[float, ...]
        Standard deviation of the read noise in scene units, 0 or more, one value per plane.

    Raises
    ------
    InputError
        When a value is negative or not finite, and when the two have different lengths.

    Examples
    --------
    >>> from panchroma.shared import NoiseModel
    >>> noise = NoiseModel(shot=(2e-4, 2e-4, 2e-4, 2e-4), read=(6e-4, 6e-4, 6e-4, 6e-4))
    >>> round(noise.sigma(3.0), 4)  # of a panchromatic sample at full scale
    0.0245
    >>> NoiseModel.gaussian(0.01, planes=4).sigma(3.0)
    0.01
    """

    shot: tuple[float, ...]
    read: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("shot", "read"):
            values = numbers(f"calibration: noise.{name}", getattr(self, name))
            if min(values, default=0.0) < 0:
                raise InputError(f"calibration: noise.{name} has a negative figure: {values}")
            object.__setattr__(self, name, values)
        if len(self.shot) != len(self.read):
            reason = f"noise.shot has {len(self.shot)} planes, noise.read {len(self.read)}"
            raise InputError(f"calibration: {reason}")

    @classmethod
    def gaussian(cls, sigma: float, planes: int) -> "NoiseModel":
        """Noise as in the paper: additive Gaussian with one standard deviation (scene units) on all
        planes.
        """
        return cls((0.0,) * planes, (sigma,) * planes)

    def sigma(self, signal: float, plane: int = -1) -> float:
        """Standard deviation sigma_z of a sample of one plane (by default panchromatic) at a signal
        level; both in scene units.
        """
        return math.sqrt(self.shot[plane] * max(signal, 0.0) + self.read[plane] ** 2)

    def variance(
        self, signal: FloatArray, plane: int | IndexArray = -1, gain: float | FloatArray = 1.0
    ) -> FloatArray:
        """Variance of samples, float32 like `signal`, scene units squared.

        Parameters
        ----------
        plane : int | IndexArray, optional
            Of all samples, or of each along the last axis.
        gain : float | FloatArray, optional
            By which samples with this noise were multiplied, > 0; float32.

        Examples
        --------
        >>> import numpy as np
        >>> from panchroma.shared import NoiseModel
        >>> noise = NoiseModel(shot=(0.25, 0.5), read=(0.0, 1.0))
        >>> noise.variance(np.array([-1.0, 2.0], np.float32), np.array([0, 1])).tolist()
        [0.0, 2.0]
        """
        shot, read = (np.array(figures, np.float32)[plane] for figures in (self.shot, self.read))
        return gain * (shot * signal.clip(0) + gain * read**2)

    def in_units_of(self, unit: float) -> "NoiseModel":
        """Return the noise of samples in units of `unit` scene units, > 0."""
        return NoiseModel(*(np.array((self.shot, self.read)) / unit).tolist())

    def possible(self) -> "NoiseModel":
        """The model with figures that a calibration may have: less than that is nothing, and more
        is as good as the most.
        """
        least, most = NOISE_RANGE
        figures = np.array((self.shot, self.read))
        return NoiseModel(*np.where(figures < least, 0.0, np.minimum(figures, most)).tolist())

    @property
    def of_colours(self) -> bool:
        """True if the samples of any channel have noise."""
        return any(self.shot[:-1] + self.read[:-1])


@dataclass(frozen=True)
class SensorCalibration:
    """The calibration of one sensor with any number C of channels; every field is checked
    (InputError names the field).

    Attributes
    ----------
    channels : str
        The letters of the channels, in the order of all per-channel fields and of
        `CfaPattern.channels`.
    gamma : tuple[float, ...]
        The C weights of Eq. 7, positive. By default all 1.
    noise : NoiseModel | None
        Per plane (channels, then panchromatic), scene units; None = unknown.
    black_level : tuple[float, ...]
        Sensor codes, per plane. By default those of `of_bits(16)`.
    white_level : int
        The code that reads `full_scale` scene units. By default that of `of_bits(16)`.
    camera_to_xyz : tuple[tuple[float, ...], ...] | None
        3 x C, scene units -> CIE XYZ (D50 white), under the light in which `neutral` was seen; None
        = uncalibrated.
    neutral : tuple[float, ...] | None
        Reading of a white surface in each channel under the light of the shot, up to scale; None =
        unknown.
    neutral_estimated : bool
        The neutral is an estimate from the picture, not a measurement or the setting of a camera.
    defects : tuple[tuple[int, int], ...]
        Sensor (row, column) of the pixels that do not measure light, in reading order.
    sensor : str
        A name for people.
    camera : str
        Id of the camera file that the calibration came from ("" = none); it stays when fields are
        replaced.
    shading : Shading | None
        Of lens and sensor; None = unknown, treated as none. Noise and levels are those before its
        gain.
    lights : Lights | None
        The colours under two lights; None = one. `camera_to_xyz` follows from them and from
        `neutral`, see `colours_under`, and so does `gamma` if they have one each.

    Examples
    --------
    >>> from panchroma.shared import SensorCalibration
    >>> calibration = SensorCalibration.of_bits(12, gamma=(0.9, 1.1, 0.8))
    >>> calibration.black_level, calibration.white_level
    ((256.0, 256.0, 256.0, 256.0), 3839)
    >>> round(calibration.full_scale, 2)  # scene units at the white level: the sum of gamma
    2.8
    >>> SensorCalibration.from_json(calibration.to_json()) == calibration
    True
    """

    channels: str = "RGB"
    gamma: tuple[float, ...] = ()
    noise: NoiseModel | None = None
    black_level: tuple[float, ...] = ()
    white_level: int = 61439  # for 16 bits, with headroom
    camera_to_xyz: tuple[tuple[float, ...], ...] | None = None
    neutral: tuple[float, ...] | None = None
    neutral_estimated: bool = False
    defects: tuple[tuple[int, int], ...] = ()
    sensor: str = ""
    camera: str = ""
    shading: Shading | None = None
    lights: two_lights.Lights | None = None

    def __post_init__(self) -> None:
        store = partial(object.__setattr__, self)
        for name, kind in _KINDS.items():
            if not isinstance(value := getattr(self, name), kind):
                raise InputError(f"calibration: {name} is {shown(value)}, expected {kind.__name__}")
        letters, count, planes = self.channels, len(self.channels), len(self.channels) + 1
        if not re.fullmatch("[A-Z]{2,}", letters) or len({*letters, PANCHROMATIC}) != planes:
            expected = "expected two or more different letters A to Z; W stands for panchromatic"
            raise InputError(f"calibration: channels is {letters!r}, {expected}")
        self._set("gamma", count, two_lights.GAMMA_RANGE, default=1.0)
        self._set("black_level", planes, (-math.inf, math.inf), default=4096.0)
        store("white_level", whole("calibration: white_level", self.white_level))
        black, white = self.black_level, self.white_level
        if not 0 <= min(black) <= max(black) <= white - _LEAST_RANGE <= 65535 - _LEAST_RANGE:
            levels = f"black_level {black} and white_level {shown(white)}"
            apart = f"at least {_LEAST_RANGE} codes below white, which is 65535 at most"
            raise InputError(f"calibration: {levels}, expected 0 <= black, {apart}")
        shot = self.noise.shot if self.noise else None
        gain = self.shading.gain if self.shading else None
        for name, values in (("noise", shot), ("shading", gain)):
            if values is not None and len(values) != planes:
                expected = f"expected {planes} ({letters}W)"
                raise InputError(f"calibration: {name} has {len(values)} planes, {expected}")
        for name in ("shot", "read") if self.noise else ():
            figures = filter(None, getattr(self.noise, name))
            _check_range(f"noise.{name}", figures, NOISE_RANGE, "0, or ")
        if self.neutral is not None:
            self._set("neutral", count, two_lights.COLOUR_RANGE)
        elif self.neutral_estimated:
            raise InputError("calibration: neutral_estimated is true, but there is no neutral")
        if self.lights is not None:
            store("lights", two_lights.checked_lights(self.lights, letters))
            store("camera_to_xyz", two_lights.colours_under(self.lights, self.neutral))
            store("gamma", two_lights.gamma_under(self.lights, self.neutral) or self.gamma)
        if self.camera_to_xyz is not None:
            store("camera_to_xyz", two_lights.checked_matrix(self.camera_to_xyz, count))
        store("defects", _places(self.defects))

    @classmethod
    def of_bits(cls, bits: int, *, headroom: bool = True, **fields: Any) -> "SensorCalibration":
        """A calibration for samples of `bits` bits (8 to 16), with the black level at a sixteenth
        of the range of codes.

        Parameters
        ----------
        headroom : bool, optional
            True puts the white level below the highest code, by as much as the black level is above
            0, so that additive noise is clipped at neither end. False puts it at the highest code,
            where a real sensor clips.
        fields : Any
            Any other fields by name; levels given here replace those of `bits`.

        Raises
        ------
        InputError
            For any other number of bits, and for invalid fields.
        """
        if bits not in BITS:
            raise InputError(f"samples of {bits} bits: expected {BITS[0]} to {BITS[-1]}")
        black, highest = 1 << (bits - 4), (1 << bits) - 1
        fields.setdefault("black_level", (black,) * (len(fields.get("channels", cls.channels)) + 1))
        fields.setdefault("white_level", highest - black if headroom else highest)
        return cls(**fields)

    def remarks(self, focal_length: float | None) -> tuple[str, ...]:
        """Remarks on a shot at this focal length, millimetres: shading from another one, and a
        picture of two colours.
        """
        remarks = [self.shading.zoomed(focal_length)] if self.shading else []
        if is_pair(self.channels):
            own, rest = tuple(self.channels)
            shows = f"a picture shows {own} against {rest}, all other light"
            remarks.append(f"its sensor has one kind of colour filter: {shows}")
        return tuple(filter(None, remarks))

    @property
    def knows_white(self) -> bool:
        """True if it states what white reads: by the neutral, or by the matrix of the one light
        that it knows.
        """
        return self.neutral is not None or (self.camera_to_xyz is not None and self.lights is None)

    @property
    def full_scale(self) -> float:
        """Scene units at the white level of every pixel: sum_i gamma_i."""
        return math.fsum(self.gamma)

    @property
    def grey(self) -> float:
        """Chromaticity of grey in every channel, gamma_bar (Eqs. 8-9)."""
        return 1.0 / self.full_scale

    @property
    def bits(self) -> int:
        """Bits of a sample: as many as the white level needs."""
        return self.white_level.bit_length()

    @cached_property
    def id(self) -> str:
        """Digest of the content, 16 hexadecimal digits, which tells calibrations apart.

        `camera` is left out: a calibration taken unchanged from a camera file has that file's id.
        """
        content = self.to_json()
        del content["camera"]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]

    def without_estimates(self) -> "SensorCalibration":
        """Return the calibration without a neutral that is only an estimate from one picture."""
        neutral = None if self.neutral_estimated else self.neutral
        return replace(self, neutral=neutral, neutral_estimated=False)

    def scale(self) -> DoubleArray:
        """Scene units per sensor code of each plane; float64 (C + 1,)."""
        return self.full_scale / (self.white_level - np.array(self.black_level))

    def check_pattern(self, pattern: CfaPattern) -> None:
        """Raise InputError unless the pattern has the channels of this calibration."""
        if pattern.channels != self.channels:
            both = f"the pattern has channels {pattern.channels}, the calibration {self.channels}"
            raise InputError(f"{both}: they belong to different sensors")

    def to_json(self) -> dict[str, Any]:
        """The calibration as a JSON object; `from_json` turns it back."""
        document = {"schema": SCHEMA, **asdict(self)}
        for name in OPTIONAL:
            if not document[name]:
                del document[name]
        if self.lights:
            del document["camera_to_xyz"]
            for light in document["lights"]:
                if light["gamma"] is None:
                    del light["gamma"]
        return document

    @classmethod
    def from_json(cls, document: Any) -> "SensorCalibration":
        """The calibration in a JSON object made by `to_json`.

        Raises
        ------
        InputError
            That names the field.
        """
        if not isinstance(document, dict):
            reason = f"expected a JSON object, found {type(document).__name__}"
            raise InputError(f"calibration: {reason}")
        given = dict(document)
        if (schema := given.pop("schema", None)) != SCHEMA or schema is True:
            raise InputError(f"calibration: schema is {schema!r}, this version reads {SCHEMA}")
        if unknown := sorted(set(given) - {field.name for field in fields(cls)}):
            raise InputError(f"calibration: unknown field {unknown[0]!r}")
        if given.get("noise") is not None:
            given["noise"] = built(NoiseModel, given["noise"], "calibration: noise")
        if "shading" in given:
            given["shading"] = built(Shading, given["shading"], "calibration: shading")
        if (lights := given.get("lights")) is not None:
            if given.get("camera_to_xyz") is not None:
                why = "has lights and camera_to_xyz, which follows from them: leave one of them out"
                raise InputError(f"calibration: {why}")
            lights = lights if isinstance(lights, list | tuple) else [lights]
            kind, name = two_lights.CalibratedLight, "calibration: lights"
            given["lights"] = tuple(built(kind, light, name) for light in lights)
        return cls(**given)

    def _set(self, name: str, count: int, limits: _Limits, default: float | None = None) -> None:
        """Check a list of numbers. default: of all of them, for the empty tuple: null, 0 or [] in a
        document are mistakes.
        """
        values = getattr(self, name)
        if default is not None and isinstance(values, tuple) and not values:
            values = (default,) * count
        object.__setattr__(self, name, numbers(f"calibration: {name}", values, count))
        _check_range(name, getattr(self, name), limits)


def derived_channel(
    luminance: NDArray[Any] | float, colours: NDArray[Any], gamma: NDArray[Any], derived: int
) -> NDArray[Any]:
    """Return the channel without filters by Eq. 7, (l - sum_(i != d) gamma_i c_i) / gamma_d, (...).

    Parameters
    ----------
    luminance : NDArray[Any] | float
        l, (...); 1 if the colours are chromaticities.
    colours : NDArray[Any]
        (..., C); what they say of this channel is not used.
    gamma : NDArray[Any]
        (C,), the weights of Eq. 7.
    derived : int
        The channel, see `CfaPattern.derived`.
    """
    others = np.delete(colours, derived, axis=-1) @ np.delete(gamma, derived)
    return np.asarray((luminance - others) / gamma[derived])


def _check_range(name: str, values: Iterable[float], limits: _Limits, also: str = "") -> None:
    """Raise InputError that names the field unless all values lie in `limits`; also: what else is
    expected, for the message.
    """
    low, high = limits
    for value in values:
        if not low <= value <= high:
            expected = f"expected {also}{low:g} to {high:g}"
            raise InputError(f"calibration: {name} holds {value:g}, {expected}")


def _places(values: Any) -> tuple[tuple[int, int], ...]:
    """Check a list of pixel places and return it sorted, without duplicates; raises InputError."""
    try:
        places = sorted({(whole("row", row), whole("column", column)) for row, column in values})
        if not all(0 <= min(place) <= max(place) < MAX_PIXELS for place in places):
            raise ValueError
    except (TypeError, ValueError, InputError):
        reason = "defects is not a list of [row, column] that a sensor has"
        raise InputError(f"calibration: {reason}") from None
    if len(places) > _MOST_DEFECTS:
        most = f"{_MOST_DEFECTS} at most; measure the sensor anew"
        raise InputError(f"calibration: defects holds {len(places)} pixels, expected {most}")
    return tuple(places)
