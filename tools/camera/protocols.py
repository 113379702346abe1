"""The protocols of noise: how light becomes samples, and a protocol's own words in options, figures and reports.

A new one is a subclass of `Protocol`, and its place in `PROTOCOLS`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.sensor import TYPICAL_READ, TYPICAL_SHOT, simulate_additive, simulate_sensor

_BITS = 12
_BLACK, _WHITE = 1 << (_BITS - 4), (1 << _BITS) - 1  # codes of the Bayer sensor

Given = TypeVar("Given")


@dataclass(frozen=True, eq=False)
class BayerShot:
    """What a Bayer sensor measured.

    samples: float32 (H, W), scene units.
    shot, read: their noise, variance = shot * signal + read**2, scene units.
    """

    samples: FloatArray
    shot: float
    read: float


@dataclass(frozen=True, eq=False)
class SensorLight:
    """The light that falls on a sparse-colour sensor.

    seen: what its filters read under full light, float32 (H, W, C), scene units.
    exposure: factor by which the light is multiplied, positive.
    pattern, calibration: of the sensor.
    metadata: capture data of the shot.
    """

    seen: FloatArray
    exposure: float
    pattern: CfaPattern
    calibration: SensorCalibration
    metadata: CaptureMetadata


@dataclass(frozen=True)
class Protocol(ABC):
    """A kind of noise, at one strength. Checked when made.

    level: how strong it is, in the unit of the protocol.

    Said by each subclass:
    version: raised whenever its shots change, so that kept results of an evaluation are made again.
    name: of the protocol, in --protocol and in evaluation.json.
    option: name of its level, as an option and as an argument. metavar, help: of that option.
    summary: what the noise is, for people who choose.
    default: level of one shot, where none is given. usual: levels of an evaluation.
    unit: of the level, its name first.
    headroom: samples above white are kept, as `SensorCalibration.of_bits` understands it.
    bits: of a sample in an evaluation.
    equal_noise: "Every pattern photographs the same scenes under the same light, ...".
    conditions: what the noise is, and what is equal for a sparse-colour and a Bayer camera.
    """

    level: float

    version: ClassVar[int] = 1
    name: ClassVar[str]
    option: ClassVar[str]
    metavar: ClassVar[str]
    help: ClassVar[str]
    summary: ClassVar[str]
    default: ClassVar[float]
    usual: ClassVar[tuple[float, ...]]
    unit: ClassVar[str]
    headroom: ClassVar[bool]
    bits: ClassVar[int]
    equal_noise: ClassVar[str]
    conditions: ClassVar[str]

    @classmethod
    def levels(cls, wanted: Iterable[float] | None = None) -> tuple[Self, ...]:
        """The protocol at each level once, in order of rising noise; None = the usual ones. Raises InputError as the class does."""
        return tuple(sorted(map(cls, dict.fromkeys(cls.usual if wanted is None else wanted)), key=lambda each: each.noisiness))

    @classmethod
    def places(cls, levels: Sequence["Protocol"]) -> list[float]:
        """Where levels lie along the axis of a plot: as a rule evenly."""
        return [float(place) for place in range(len(levels))]

    @property
    def axis(self) -> str:
        """Name of the level along an axis."""
        return self.unit.partition(",")[0]

    @property
    def tick(self) -> str:
        """The level beside an axis."""
        return f"{self.level:g}"

    @property
    def text(self) -> str:
        """The level in a sentence."""
        return f"{self.axis} {self.tick}"

    @property
    def noisiness(self) -> float:
        """Rises with the noise."""
        return self.level

    @property
    def light(self) -> float:
        """Light that a shot records, as a multiple of the scene's."""
        return 1.0

    @property
    def noisy(self) -> bool:
        """There is noise at this level."""
        return True

    @property
    def clear(self) -> bool:
        """There may be so little noise at this level that methods made for clean pictures are at their best."""
        return True

    @property
    def identity(self) -> list[str | float]:
        """What tells its shots apart from others at the same level, as JSON values."""
        return [self.name, self.version]

    def scaled(self, unit: float) -> "Protocol":
        """The same noise for a sensor with other filters. unit: its scene units that are one of red, green and blue filters'."""
        return self

    @abstractmethod
    def expose(self, light: SensorLight, rng: np.random.Generator) -> Mosaic:
        """The shot of a sparse-colour sensor under this light. rng: source of the noise."""

    @abstractmethod
    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """The shot of a Bayer sensor under the same light, in scene units under full light.

        samples: without noise, float32 (H, W), scene units.
        rng: source of the noise.
        """


def dimmed(light: FloatArray, factor: float) -> FloatArray:
    """Light times a factor; the same array for 1."""
    return light if factor == 1 else light * np.float32(factor)


@dataclass(frozen=True)
class PaperProtocol(Protocol):
    """Additive Gaussian noise on every sample; nothing is clipped or quantised (section 4).

    level: its standard deviation, scene units of a camera with red, green and blue filters.
    Raises InputError for a negative one.
    """

    name = "paper"
    option = "sigma"
    metavar = "S"
    help = "standard deviation of the noise of the protocol paper, scene units"
    summary = "additive Gaussian noise, no clipping"
    default = 0.0
    usual = (0.0, 0.01, 0.02, 0.03)
    unit = "sigma, scene units"
    headroom = True
    bits = 16
    equal_noise = "with noise that is the same fraction of what a panchromatic pixel reads in white"
    conditions = "additive Gaussian, equally strong on every sample, nothing clipped or quantised"

    def __post_init__(self) -> None:
        if not 0 <= self.level < np.inf:
            raise InputError(f"`sigma` is {self.level}, expected 0 or more")

    @classmethod
    def places(cls, levels: Sequence[Protocol]) -> list[float]:
        """Where levels lie along the axis of a plot: in proportion."""
        return [each.level for each in levels]

    @property
    def text(self) -> str:
        """The level in a sentence."""
        return super().text if self.level else "no noise"

    @property
    def noisy(self) -> bool:
        """There is noise at this level."""
        return self.level > 0

    @property
    def clear(self) -> bool:
        """There is no noise at this level."""
        return self.level == 0

    def scaled(self, unit: float) -> Protocol:
        """The same fraction of what a panchromatic pixel reads in white. unit: see `Protocol.scaled`."""
        return replace(self, level=self.level * unit)

    def expose(self, light: SensorLight, rng: np.random.Generator) -> Mosaic:
        """A shot in scene units, float32. Arguments: see `Protocol.expose`."""
        seen = dimmed(light.seen, light.exposure)
        return simulate_additive(seen, light.pattern, light.calibration, self.level, rng, light.metadata)

    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """The same noise on every sample. Arguments: see `Protocol.bayer`."""
        if self.level:
            samples = samples + (self.level * rng.standard_normal(samples.shape)).astype(np.float32)
        return BayerShot(samples, 0.0, self.level)


@dataclass(frozen=True)
class SensorProtocol(Protocol):
    """Shot noise and read noise of a small modern sensor, or of the camera's calibration; clipped at full scale and quantised.

    Sparse-colour and Bayer camera have the same pixels and exposure time. A panchromatic pixel reads the sum of the channels and so
    gets more light; the Bayer camera has the gain that suits its smaller share.

    level: amount of light, 1 = a full exposure.
    Raises InputError for one that is not positive.
    """

    name = "sensor"
    option = "light"
    metavar = "FACTOR"
    help = "amount of light of the protocol sensor, 2 is one stop more"
    summary = "shot and read noise, clipped at full scale"
    default = 1.0
    usual = (1.0, 1 / 4, 1 / 16)
    unit = "exposure"
    headroom = False
    bits = _BITS
    equal_noise = "on the same pixels, with the same exposure time"
    conditions = (
        f"both cameras expose pixels of the same sensor for the same time: {1 / TYPICAL_SHOT:,.0f} electrons per scene unit at "
        f"exposure 1, read noise of {TYPICAL_READ / TYPICAL_SHOT:.0f} electrons, {_BITS} bits; the Bayer camera amplifies more, "
        "for its white is a third of the panchromatic pixel's; "
        "in bright light it could expose longer instead, which is not tried here"
    )

    def __post_init__(self) -> None:
        if not 0 < self.level < np.inf:
            raise InputError(f"`light` is {self.level}, expected a positive factor; 1 is a full exposure")

    @property
    def tick(self) -> str:
        """The level beside an axis: 1/4 for 0.25."""
        return f"1/{1 / self.level:g}" if self.level < 1 else f"{self.level:g}"

    @property
    def noisiness(self) -> float:
        """Falls with the light."""
        return -self.level

    @property
    def light(self) -> float:
        """Light that a shot records, as a multiple of the scene's."""
        return self.level

    def expose(self, light: SensorLight, rng: np.random.Generator) -> Mosaic:
        """A shot in codes, uint16. Arguments: see `Protocol.expose`."""
        return simulate_sensor(light.seen, light.pattern, light.calibration, light.exposure, rng, light.metadata)

    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """Noise of the same electrons; its white level is 1 scene unit times `level`. Arguments: see `Protocol.bayer`."""
        light = samples * self.level
        counted: Any = rng.poisson(np.maximum(light, 0) / TYPICAL_SHOT) * TYPICAL_SHOT
        noisy = counted + rng.normal(0, 1, light.shape) * TYPICAL_READ
        codes = np.rint(noisy * (_WHITE - _BLACK) + _BLACK).clip(0, _WHITE)
        measured: FloatArray = ((codes - _BLACK) / (_WHITE - _BLACK)).astype(np.float32)
        return BayerShot(measured / np.float32(self.level), TYPICAL_SHOT / self.level, TYPICAL_READ / self.level)


PROTOCOLS: dict[str, type[Protocol]] = {each.name: each for each in (PaperProtocol, SensorProtocol)}


def chosen_protocol(name: str | None, levels: Mapping[str, Given | None]) -> tuple[type[Protocol], Given | None]:
    """The protocol that is asked for, and the level or levels that are given for it; None where its own default is meant.

    name: in PROTOCOLS; None = that of the level which is given, or else the paper's.
    levels: what is given under the names of the protocols' levels (`Protocol.option`).
    Raises InputError for an unknown protocol, and for the level of another one.
    """
    given = [option for option, level in levels.items() if level is not None]
    if name is None:
        name = next((each.name for each in PROTOCOLS.values() if each.option in given), PaperProtocol.name)
    if name not in PROTOCOLS:
        raise InputError(f"`protocol` is {name!r}, expected one of {', '.join(PROTOCOLS)}")
    chosen = PROTOCOLS[name]
    if others := [option for option in given if option != chosen.option]:
        raise InputError(
            f"`{others[0]}` is not a level of `protocol` {name}, whose noise is set by `{chosen.option}`; give the one or the other"
        )
    return chosen, levels.get(chosen.option)
