"""How noisy a mosaic is: as its calibration knows."""

from shared.calibration import NoiseModel
from shared.mosaic import Mosaic

from .settings import NoiseSettings


def noise_of(mosaic: Mosaic, settings: NoiseSettings) -> NoiseModel | None:
    """The calibration's noise model; None where it is unknown."""
    return mosaic.calibration.noise
