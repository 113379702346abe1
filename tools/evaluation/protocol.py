"""How scenes are photographed for a comparison: the same light for both cameras, with noise by protocol and seed."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.sensor import simulate_additive, simulate_sensor, typical_noise
from tools.camera.filters import Filters

from .rivals.bayer import bayer_exposure, bayer_mosaic

Kind = Literal["paper", "sensor"]
KINDS: tuple[Kind, ...] = ("paper", "sensor")
ORDER = "RGGB"  # of the Bayer sensor, and of the blocks
CROP = 6  # pixels: every scene is cut to whole periods of the paper's pattern, whatever periods are compared
_BITS = 12
_CAMERA = SensorCalibration.of_bits(_BITS, headroom=False)
_NOISE = typical_noise(_CAMERA)
_DEFAULTS: dict[Kind, tuple[float, ...]] = {"paper": (0.0, 0.01, 0.02, 0.03), "sensor": (1.0, 1 / 4, 1 / 16)}


@dataclass(frozen=True, eq=False)
class BayerShot:
    """What a Bayer sensor measured.

    samples: float32 (H, W), scene units.
    shot, read: their noise, variance = shot * signal + read**2, scene units.
    order: filters of the first two rows.
    """

    samples: FloatArray
    shot: float
    read: float
    order: str = ORDER


@dataclass(frozen=True)
class Protocol:
    """Kind of noise, and its seed. A `level` is how strong the noise is.

    paper: level = standard deviation of additive Gaussian noise on every sample, scene units of a camera with red, green and blue
        filters. Nothing is clipped or quantised.
    sensor: level = exposure, the fraction of the scene's light that arrives. Both cameras have the same pixels and exposure time:
    shot noise and read noise of a small modern sensor, clipping, 12 bits. A panchromatic pixel reads the sum of the channels and so
    gets more light; the Bayer camera has the gain that suits its smaller share.
    Raises InputError for another kind, or a negative seed.
    """

    kind: Kind = "paper"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"unknown protocol {self.kind!r}; one of {', '.join(KINDS)}")
        if self.seed < 0:
            raise InputError(f"the seed is {self.seed}, expected 0 or more")

    def levels(self, wanted: Iterable[float] | None = None) -> tuple[float, ...]:
        """Noise levels in order of rising noise, each once; the usual ones for None. Raises InputError for an impossible level."""
        levels = _DEFAULTS[self.kind] if wanted is None else tuple(wanted)
        for level in levels:
            if self.kind == "paper" and not 0 <= level < np.inf:
                raise InputError(f"sigma is {level}, expected 0 or more")
            if self.kind == "sensor" and not 0 < level < np.inf:
                raise InputError(f"exposure is {level}, expected a positive factor")
        return tuple(sorted(set(levels), reverse=self.kind == "sensor"))

    def sparse_shot(self, light: FloatArray, level: float, pattern: CfaPattern, filters: Filters) -> Mosaic:
        """Shot of the sparse-colour sensor; its calibration states the noise. A render divided by `gain` is in the filters' units.

        Under the same light the noise is the same fraction of what a panchromatic pixel reads in white, whatever the filters are.

        light: the scene, (H, W, N), scene units.
        level: of the noise.
        pattern, filters: of the sensor.
        """
        read, channels, gamma = filters.of(light), filters.channels, filters.gamma
        if self.kind == "paper":
            return simulate_additive(read, pattern, SensorCalibration(channels, gamma), level * filters.unit, self._rng())
        camera = SensorCalibration.of_bits(_BITS, headroom=False, channels=channels, gamma=gamma, noise=filters.noise)
        return simulate_sensor(read, pattern, camera, level, self._rng())

    def bayer_shot(self, rgb: FloatArray, level: float) -> BayerShot:
        """Shot of the Bayer sensor, already divided by `gain`. rgb: the scene, (H, W, 3), scene units."""
        if self.kind == "paper":
            return BayerShot(bayer_mosaic(rgb, level, self._rng(), ORDER), 0.0, level)
        samples = bayer_exposure(rgb, _NOISE, level, (int(_CAMERA.black_level[0]), _CAMERA.white_level), self._rng(), ORDER)
        return BayerShot(samples / np.float32(level), _NOISE.shot[0] / level, _NOISE.read[0] / level)

    def gain(self, level: float) -> float:
        """Light that a sparse-colour shot recorded, as a multiple of the scene's."""
        return level if self.kind == "sensor" else 1.0

    @property
    def conditions(self) -> str:
        """Description for people: what the noise is, and what is equal for both cameras."""
        if self.kind == "paper":
            return "additive Gaussian, equally strong on every sample, nothing clipped or quantised"
        shot, read = _NOISE.shot[0], _NOISE.read[0]
        return (
            f"both cameras expose pixels of the same sensor for the same time: {1 / shot:,.0f} electrons per scene unit at "
            f"exposure 1, read noise of {read / shot:.0f} electrons, {_BITS} bits; the Bayer camera amplifies more, for its white "
            "is a third of the panchromatic pixel's; in bright light it could expose longer instead, which is not tried here"
        )

    def describe(self, level: float) -> str:
        """Name of a level for people."""
        if self.kind == "paper":
            return f"sigma {level:g}" if level else "no noise"
        return f"exposure {fraction(level)}"

    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)  # the same for every scene, as in `panchroma simulate`


def fraction(exposure: float) -> str:
    """An exposure for people: 1/4 for 0.25."""
    return f"1/{1 / exposure:g}" if exposure < 1 else f"{exposure:g}"


def cut(rgb: FloatArray, largest: int | None = None) -> FloatArray:
    """A scene (H, W, N) cut to whole multiples of CROP pixels; with `largest` the middle, at most that many pixels each way."""
    rows, columns = (min(size, largest or size) // CROP * CROP for size in rgb.shape[:2])
    top, left = ((size - kept) // 2 if largest else 0 for size, kept in zip(rgb.shape[:2], (rows, columns), strict=True))
    return np.ascontiguousarray(rgb[top : top + rows, left : left + columns])
