"""How scenes are photographed for a comparison: the same light for every camera, noise by protocol and seed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.sensor import simulate_additive, simulate_sensor, typical_noise

from .rivals.bayer import bayer_exposure, bayer_mosaic

Kind = Literal["paper", "sensor"]
KINDS: tuple[Kind, ...] = ("paper", "sensor")
ORDER = "RGGB"  # of the Bayer sensor, and of the blocks
CROP = 6  # pixels: every scene is cut to whole periods of the paper's pattern, whatever periods are compared
_BITS = 12


@dataclass(frozen=True, eq=False)
class BayerShot:
    """What a Bayer sensor measured: samples float32 (H, W), in scene units; their noise has variance shot * signal + read**2."""

    samples: FloatArray
    shot: float
    read: float
    order: str = ORDER


@dataclass(frozen=True)
class Protocol:
    """Noise and its seed; `level` below is what the noise depends on.

    paper: level = standard deviation of additive Gaussian noise on every sample, scene units; nothing is clipped or quantised.
    sensor: level = exposure, the fraction of the scene's light that arrives. Both cameras have the same pixels and the same time:
    shot noise and read noise of a small modern sensor, clipping, 12 bits. The panchromatic pixel reads the sum of the channels, so
    it has more light because it takes more; the Bayer camera has the gain that suits its lesser light.
    Raises InputError for another kind, and a negative seed.
    """

    kind: Kind = "paper"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"unknown protocol {self.kind!r}; one of {', '.join(KINDS)}")
        if self.seed < 0:
            raise InputError(f"the seed is {self.seed}, expected 0 or more")

    def check_level(self, level: float) -> None:
        """Raise InputError for a level that is no noise, or no exposure."""
        if self.kind == "paper" and not 0 <= level < np.inf:
            raise InputError(f"sigma is {level}, expected 0 or more")
        if self.kind == "sensor" and not 0 < level < np.inf:
            raise InputError(f"exposure is {level}, expected a positive factor")

    def in_order(self, levels: list[float]) -> list[float]:
        """Each level once, the least noise first."""
        return sorted(set(levels), reverse=self.kind == "sensor")

    def sparse_shot(self, rgb: FloatArray, level: float, period: int) -> Mosaic:
        """A shot of the sparse-colour sensor; its calibration knows the noise. Divide a render of it by `gain`."""
        pattern = CfaPattern.bayer(period, ORDER)
        if self.kind == "paper":
            return simulate_additive(rgb, pattern, SensorCalibration(), level, self._rng())
        return simulate_sensor(rgb, pattern, _camera(), level, self._rng())

    def bayer_shot(self, rgb: FloatArray, level: float) -> BayerShot:
        """A shot of the Bayer sensor, already divided by `gain`."""
        if self.kind == "paper":
            return BayerShot(bayer_mosaic(rgb, level, self._rng(), ORDER), 0.0, level)
        noise = NoiseModel(*(figures[:1] for figures in (typical_noise(_camera()).shot, typical_noise(_camera()).read)))
        samples = bayer_exposure(rgb, noise, level, (int(_camera().black_level[0]), _camera().white_level), self._rng(), ORDER)
        return BayerShot(samples / np.float32(level), noise.shot[0] / level, noise.read[0] / level)

    def gain(self, level: float) -> float:
        """Light that a sparse shot recorded, as a multiple of the scene's."""
        return level if self.kind == "sensor" else 1.0

    @property
    def conditions(self) -> str:
        """In words, for people: what the noise is, and what is equal for both cameras."""
        if self.kind == "paper":
            return "additive Gaussian, equally strong on every sample, nothing clipped or quantised"
        shot, read = (figures[0] for figures in (typical_noise(_camera()).shot, typical_noise(_camera()).read))
        return (
            f"both cameras expose pixels of the same sensor for the same time: {1 / shot:,.0f} electrons per scene unit at "
            f"exposure 1, read noise of {read / shot:.0f} electrons, {_BITS} bits; the Bayer camera amplifies more, for its white "
            "is a third of the panchromatic pixel's; in bright light it could expose longer instead, which is not tried here"
        )

    def describe(self, level: float) -> str:
        """A level in words."""
        if self.kind == "paper":
            return f"sigma {level:g}" if level else "no noise"
        return "exposure 1" if level == 1 else f"exposure 1/{1 / level:g}" if level < 1 else f"exposure {level:g}"

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)  # the same for every scene, as in `panchroma simulate`


def cut(rgb: FloatArray, largest: int | None = None) -> FloatArray:
    """A scene (H, W, 3) cut to whole multiples of CROP pixels; with `largest` to the middle, at most so many each way."""
    rows, columns = (min(size, largest or size) // CROP * CROP for size in rgb.shape[:2])
    top, left = ((size - kept) // 2 if largest else 0 for size, kept in zip(rgb.shape[:2], (rows, columns), strict=True))
    return np.ascontiguousarray(rgb[top : top + rows, left : left + columns])


def _camera() -> SensorCalibration:
    return SensorCalibration.of_bits(_BITS, headroom=False)
