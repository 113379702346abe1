"""The simulated camera: from a scene to its shot, and to the truth that a picture of the shot is compared with."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from shared import Camera, CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.sensor import simulate_additive, simulate_sensor
from tools.scenes.scene import Scene

from .filters import Filters, filters_for
from .lens import NO_LENS, SimulatedLens

BITS = 12
"""Bits of a sample, unless others are asked for."""
TRUTH = ".truth.tif"
"""What the name of a file that holds the truth of a shot ends in, behind the stem of the shot."""


@dataclass(frozen=True, eq=False)
class Exposed:
    """What a simulated camera recorded of a scene.

    mosaic: the shot.
    seen: what its filters would read at every pixel under full light, without lens and noise, float32 (H, W, C), scene units.
    white: what the scene's white reads in the shot, scene units: amount of light times exposure. It is the peak of every measure of
        a picture of this shot, so that figures fall with the light.
    """

    mosaic: Mosaic
    seen: FloatArray
    white: float

    @cached_property
    def truth(self) -> FloatArray:
        """What the shot sees, in the units of a render of it, float32 (H, W, C); nothing is clipped."""
        return _dimmed(self.seen, self.white)


@dataclass(frozen=True)
class SimulatedCamera:
    """A camera that photographs scenes.

    pattern: its filters.
    sensor: its calibration; gamma, noise and colours are replaced where they are not known, see `before`.
    measured: whether the sensor has gamma and noise of its own; otherwise they follow from the filters.
    lens: what its lens does.
    sigma: standard deviation of additive Gaussian noise, scene units, without clipping; None = shot and read noise of the sensor,
        clipped and quantised.
    light: amount of light, 1 = a full exposure.
    """

    pattern: CfaPattern
    sensor: SensorCalibration
    measured: bool = False
    lens: SimulatedLens = NO_LENS
    sigma: float | None = None
    light: float = 1.0

    @classmethod
    def of(
        cls,
        pattern: CfaPattern,
        known: Camera | None = None,
        *,
        bits: int | None = None,
        lens: SimulatedLens = NO_LENS,
        sigma: float | None = None,
        light: float = 1.0,
    ) -> "SimulatedCamera":
        """The camera in a camera file, or else one with the channels of the pattern.

        bits: of a sample; None = those of the file, or 12.
        pattern, lens, sigma, light: see above.
        Raises InputError for any other number of bits.
        """
        sensor = known.calibration if known else SensorCalibration(pattern.channels, sensor="simulated")
        if known is None or bits is not None:
            # A sensor clips at white, so nothing lies above it.
            levels = SensorCalibration.of_bits(BITS if bits is None else bits, headroom=sigma is not None, channels=sensor.channels)
            sensor = replace(sensor, black_level=levels.black_level, white_level=levels.white_level)
        return cls(pattern, sensor, known is not None, lens, sigma, light)

    def before(self, scene: Scene, filters: Filters) -> SensorCalibration:
        """The calibration before a scene, whose colours, as its filters see them, replace unknown ones."""
        known = self.sensor if self.measured else replace(self.sensor, gamma=filters.gamma, noise=filters.noise)
        to_xyz, neutral = filters.colours(scene)
        if known.neutral is None:
            known = replace(known, neutral=neutral, neutral_estimated=scene.neutral_estimated)
        return replace(known, camera_to_xyz=known.camera_to_xyz or to_xyz)

    def shoot(
        self,
        scene: Scene,
        rng: np.random.Generator,
        *,
        light: FloatArray | None = None,
        metadata: CaptureMetadata | None = None,
        exposure: float = 1.0,
    ) -> Exposed:
        """Photograph a scene.

        rng: source of the noise.
        light: the part of its light, or the moved or reduced light, that the sensor sees, (H, W, N); None = all of it.
        metadata: capture data of the shot; None = the scene's.
        exposure: factor by which the light is multiplied besides the camera's amount of light.
        Raises InputError when the scene has not the channels of the pattern.
        """
        filters = filters_for(self.pattern, scene)
        seen, white = filters.of(scene.rgb if light is None else light), self.light * exposure
        calibration = self.lens.before(self.before(scene, filters), (seen.shape[0], seen.shape[1]))
        metadata = scene.metadata if metadata is None else metadata
        if self.sigma is None:
            mosaic = simulate_sensor(seen, self.pattern, calibration, white, rng, metadata)
        else:
            mosaic = simulate_additive(_dimmed(seen, white), self.pattern, calibration, self.sigma, rng, metadata)
        return Exposed(mosaic, seen, white)


def _dimmed(light: FloatArray, factor: float) -> FloatArray:
    return light if factor == 1 else light * np.float32(factor)
