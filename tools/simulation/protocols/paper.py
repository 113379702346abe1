"""The paper's protocol: additive Gaussian noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared import Mosaic
from shared.arrays import FloatArray
from shared.errors import InputError

from ..sensor import simulate_additive
from .protocol import BayerShot, Protocol, SensorLight, dimmed


@dataclass(frozen=True)
class PaperProtocol(Protocol):
    """Additive Gaussian noise on every sample; nothing is clipped or quantised (section 4).

    level: its standard deviation, scene units of a camera with red, green and blue filters.
    Raises InputError for a negative one.
    """

    name = "paper"
    option = "sigma"
    metavar = "S"
    help = "additive Gaussian noise: its standard deviation, scene units"
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
