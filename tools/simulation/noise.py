"""Noise of a simulated camera: the paper's, additive and Gaussian (sigma), or a sensor's, by the
amount of light.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from ...shared.arrays import FloatArray
from ...shared.errors import InputError
from .sensor import TYPICAL_READ, TYPICAL_SHOT

_BITS = 12
_BLACK, _WHITE = 1 << (_BITS - 4), (1 << _BITS) - 1  # codes of the Bayer sensor


class BayerShot(NamedTuple):
    """Mosaic of a Bayer sensor.

    Attributes
    ----------
    samples : float32 (H, W)
        Scene units.
    shot, read : float
        Their noise, variance = shot * signal + read**2, scene units.
    """

    samples: FloatArray
    shot: float
    read: float


@dataclass(frozen=True)
class Protocol:
    """A kind of noise, at one strength: see `PaperProtocol` and `SensorProtocol`.

    Attributes
    ----------
    level : float
        How strong it is, in the unit of the kind.
    name, option, metavar, help : str
        Of the kind; its level's option and argument; what help texts say.
    default, usual : float, tuple of float
        Level of one shot where none is given; levels of an evaluation.
    unit : str
        Of the level, its name first.
    headroom, bits : bool, int
        Samples above white are kept; bits of a sample in an evaluation.
    conditions : str
        What the noise is, and what is equal for a Bayer camera.
    """

    level: float

    name: ClassVar[str]
    option: ClassVar[str]
    metavar: ClassVar[str]
    help: ClassVar[str]
    default: ClassVar[float]
    usual: ClassVar[tuple[float, ...]]
    unit: ClassVar[str]
    headroom: ClassVar[bool]
    bits: ClassVar[int]
    conditions: ClassVar[str]

    light = 1.0
    """Light that a shot records, as a multiple of the scene's."""

    @classmethod
    def levels(cls, wanted: Iterable[float] | None = None) -> tuple[Self, ...]:
        """Return the noise at each level once, in order of rising noise; None = the usual ones.

        Raises InputError.
        """
        levels = dict.fromkeys(cls.usual if wanted is None else wanted)
        return tuple(sorted(map(cls, levels), key=lambda noise: (-noise.light, noise.level)))

    @property
    def text(self) -> str:
        """The level in a sentence."""
        return f"{self.unit.partition(',')[0]} {self.level:g}"

    def scaled(self, unit: float) -> "Protocol":
        """Return the same noise for a sensor with other filters, `unit` of whose scene units are
        one of R, G and B filters'.
        """
        return self

    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """Return the shot of a Bayer sensor, in scene units under full light, from samples without
        noise.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class PaperProtocol(Protocol):
    """Additive Gaussian noise on every sample; nothing is clipped or quantised (section 4).

    `level` is its standard deviation, scene units of a camera with red, green and blue filters.

    Raises
    ------
    InputError
        For a negative one.
    """

    name = "paper"
    option = "sigma"
    metavar = "S"
    help = "additive Gaussian noise: its standard deviation, scene units"
    default = 0.0
    usual = (0.0, 0.01, 0.02, 0.03)
    unit = "sigma, scene units"
    headroom = True
    bits = 16
    conditions = "additive Gaussian, equally strong on every sample, nothing clipped or quantised"

    def __post_init__(self) -> None:
        if not 0 <= self.level < np.inf:
            raise InputError(f"`sigma` is {self.level}, expected 0 or more")

    @property
    def text(self) -> str:
        """The level in a sentence."""
        return super().text if self.level else "no noise"

    def scaled(self, unit: float) -> Protocol:
        """Return the same fraction of what a panchromatic pixel reads in white: see
        `Protocol.scaled`.
        """
        return replace(self, level=self.level * unit)

    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """Return a shot with the same noise on every sample: see `Protocol.bayer`."""
        if self.level:
            samples = samples + (self.level * rng.standard_normal(samples.shape)).astype(np.float32)
        return BayerShot(samples, 0.0, self.level)


@dataclass(frozen=True)
class SensorProtocol(Protocol):
    """Shot noise and read noise of a small modern sensor, or of the camera's calibration; clipped
    and quantised.

    Sparse-colour and Bayer camera have the same pixels and exposure time. A panchromatic pixel
    reads the sum of the channels and so gets more light; the Bayer camera has the gain that suits
    its smaller share.

    `level` is the amount of light, 1 = a full exposure.

    Raises
    ------
    InputError
        For one that is not positive.
    """

    name = "sensor"
    option = "light"
    metavar = "FACTOR"
    help = "shot and read noise: amount of light, 1 is a full exposure, 2 is one stop more"
    default = 1.0
    usual = (1.0, 1 / 4, 1 / 16)
    unit = "exposure"
    headroom = False
    bits = _BITS
    conditions = (
        "both cameras expose pixels of the same sensor for the same time: "
        f"{1 / TYPICAL_SHOT:,.0f} electrons per scene unit at exposure 1, read noise of "
        f"{TYPICAL_READ / TYPICAL_SHOT:.0f} electrons, {_BITS} bits; the Bayer camera amplifies "
        "more, for its white is a third of the panchromatic pixel's"
    )

    def __post_init__(self) -> None:
        if not 0 < self.level < np.inf:
            expected = "expected a positive factor; 1 is a full exposure"
            raise InputError(f"`light` is {self.level}, {expected}")

    @property
    def light(self) -> float:  # type: ignore[override]
        """Light that a shot records, as a multiple of the scene's."""
        return self.level

    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """Return a shot of the same electrons, whose white level is 1 scene unit times `level`: see
        `Protocol.bayer`.
        """
        light = samples * self.level
        counted: Any = rng.poisson(np.maximum(light, 0) / TYPICAL_SHOT) * TYPICAL_SHOT
        noisy = counted + rng.normal(0, 1, light.shape) * TYPICAL_READ
        codes = np.rint(noisy * (_WHITE - _BLACK) + _BLACK).clip(0, _WHITE)
        measured: FloatArray = ((codes - _BLACK) / (_WHITE - _BLACK)).astype(np.float32)
        return BayerShot(
            measured / np.float32(self.level), TYPICAL_SHOT / self.level, TYPICAL_READ / self.level
        )


PROTOCOLS: tuple[type[Protocol], ...] = PaperProtocol, SensorProtocol

Given = TypeVar("Given")


def chosen_protocol(levels: Mapping[str, Given | None]) -> tuple[type[Protocol], Given | None]:
    """Return the kind of noise that is asked for, and the level or levels given for it; None = the
    paper's, at its default.

    Parameters
    ----------
    levels : mapping
        What is given under the names of the levels (`Protocol.option`); None = nothing.

    Raises
    ------
    InputError
        Levels of both kinds are given.
    """
    chosen = [kind for kind in PROTOCOLS if levels.get(kind.option) is not None]
    if len(chosen) > 1:
        both = " and ".join(f"`{kind.option}`" for kind in chosen)
        raise InputError(f"{both} set different kinds of noise; give one of them")
    protocol = chosen[0] if chosen else PaperProtocol
    return protocol, levels.get(protocol.option)
