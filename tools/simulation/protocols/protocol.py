"""What a protocol of noise says: how light becomes samples, and its own words in options, figures and reports."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray


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
