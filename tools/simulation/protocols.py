"""Noise of a simulated camera: the paper's, additive and Gaussian (sigma), or a sensor's, by the
amount of light.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ...shared import FloatArray, InputError
from ...shared.calibration import NOISE_RANGE
from .sensor import TYPICAL_READ, TYPICAL_SHOT

_BITS = 12
_BLACK, _WHITE = 1 << (_BITS - 4), (1 << _BITS) - 1  # codes of the Bayer sensor
_MOST_LIGHT = 1e6  # of it nothing but the truth, in single precision, has a limit


class BayerShot(NamedTuple):
    """Mosaic of a Bayer sensor.

    samples: scene units. shot, read: their noise, variance = shot * signal + read**2, scene units.
    """

    samples: FloatArray
    shot: float
    read: float


@dataclass(frozen=True)
class PaperProtocol:
    """Additive Gaussian noise on every sample; nothing is clipped or quantised (section 4).

    `level` is its standard deviation, scene units of a camera with red, green and blue filters.

    Raises InputError for a negative one.
    """

    level: float = 0.0

    name, option, unit = "paper", "sigma", "sigma, scene units"
    conditions = "additive Gaussian, equally strong on every sample, nothing clipped or quantised"
    light = 1.0
    """Light that a shot records, as a multiple of the scene's."""
    headroom, bits = True, 16
    """Samples above white are kept; bits of a sample in an evaluation."""

    @classmethod
    def levels(cls, wanted: Iterable[float] | None = None) -> tuple["Protocol", ...]:
        """Return the noise at each level once, the weakest first; None = the usual ones.

        Raises InputError.
        """
        return tuple(map(cls, sorted(set(wanted or (0.0, 0.01, 0.02, 0.03)))))

    def __post_init__(self) -> None:
        if not 0 <= self.level <= NOISE_RANGE[1]:
            raise InputError(f"`sigma` is {self.level}, expected 0 to {NOISE_RANGE[1]:g}")

    @property
    def text(self) -> str:
        """The level in a sentence."""
        return f"sigma {self.level:g}" if self.level else "no noise"

    def scaled(self, unit: float) -> "PaperProtocol":
        """Return the same noise for a sensor with other filters, `unit` of whose scene units are
        one of R, G and B filters': the same fraction of what a panchromatic pixel reads in white.
        """
        return replace(self, level=self.level * unit)

    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """Return the shot of a Bayer sensor, in scene units under full light, from samples without
        noise.
        """
        if self.level:
            samples = samples + (self.level * rng.standard_normal(samples.shape)).astype(np.float32)
        return BayerShot(samples, 0.0, self.level)


@dataclass(frozen=True)
class SensorProtocol:
    """Shot noise and read noise of a small modern sensor, or of the camera's calibration; clipped
    and quantised.

    Sparse-colour and Bayer camera have the same pixels and exposure time. A panchromatic pixel
    reads the sum of the channels and so gets more light; the Bayer camera has the gain that suits
    its smaller share.

    `level` is the amount of light, 1 = a full exposure.

    Raises InputError for one that is not positive.
    """

    level: float = 1.0

    name, option, unit = "sensor", "light", "exposure"
    conditions = (
        "both cameras expose pixels of the same sensor for the same time: "
        f"{1 / TYPICAL_SHOT:,.0f} electrons per scene unit at exposure 1, read noise of "
        f"{TYPICAL_READ / TYPICAL_SHOT:.0f} electrons, {_BITS} bits; the Bayer camera amplifies "
        "more, for its white is a third of the panchromatic pixel's"
    )
    headroom, bits = False, _BITS

    @classmethod
    def levels(cls, wanted: Iterable[float] | None = None) -> tuple["Protocol", ...]:
        """Return the noise at each level once, the brightest first: see `PaperProtocol.levels`."""
        return tuple(map(cls, sorted(set(wanted or (1.0, 1 / 4, 1 / 16)), reverse=True)))

    def __post_init__(self) -> None:
        if not 0 < self.level <= _MOST_LIGHT:
            expected = f"expected a factor above 0, {_MOST_LIGHT:g} at most; 1 is a full exposure"
            raise InputError(f"`light` is {self.level}, {expected}")

    @property
    def light(self) -> float:
        """Light that a shot records, as a multiple of the scene's."""
        return self.level

    @property
    def text(self) -> str:
        """The level in a sentence."""
        return f"exposure {self.level:g}"

    def scaled(self, unit: float) -> "SensorProtocol":
        """Return the noise itself: electrons are counted behind any filter."""
        return self

    def bayer(self, samples: FloatArray, rng: np.random.Generator) -> BayerShot:
        """Return a shot of the same electrons, whose white level is 1 scene unit times `level`: see
        `PaperProtocol.bayer`.
        """
        light = samples * self.level
        counted: Any = rng.poisson(np.maximum(light, 0) / TYPICAL_SHOT) * TYPICAL_SHOT
        noisy = counted + rng.normal(0, 1, light.shape) * TYPICAL_READ
        codes = np.rint(noisy * (_WHITE - _BLACK) + _BLACK).clip(0, _WHITE)
        measured: FloatArray = ((codes - _BLACK) / (_WHITE - _BLACK)).astype(np.float32)
        shot, read = TYPICAL_SHOT / self.level, TYPICAL_READ / self.level
        return BayerShot(measured / np.float32(self.level), shot, read)


Protocol = PaperProtocol | SensorProtocol
"""A kind of noise, at one strength (`level`, in the unit of the kind)."""

Given = TypeVar("Given")


def chosen_protocol(
    sigma: Given | None, light: Given | None
) -> tuple[type[PaperProtocol] | type[SensorProtocol], Given | None]:
    """Return the kind of noise that is asked for, and the level or levels given for it; None = the
    paper's, at its default.

    sigma, light: levels of the two kinds; None = nothing. Raises InputError: levels of both kinds
    are given.
    """
    if sigma is not None and light is not None:
        raise InputError("`sigma` and `light` set different kinds of noise; give one of them")
    return (PaperProtocol, sigma) if light is None else (SensorProtocol, light)
