"""The noise of a real sensor: shot noise, read noise, clipping, quantisation."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from shared import Mosaic
from shared.arrays import FloatArray
from shared.errors import InputError

from ..sensor import TYPICAL_READ, TYPICAL_SHOT, simulate_sensor
from .protocol import BayerShot, Protocol, SensorLight

_BITS = 12
_BLACK, _WHITE = 1 << (_BITS - 4), (1 << _BITS) - 1  # codes of the Bayer sensor


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
    help = "shot and read noise: amount of light, 1 is a full exposure, 2 is one stop more"
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
