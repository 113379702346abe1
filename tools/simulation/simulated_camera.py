"""The simulated camera: from a scene to its shot, and to the truth that a picture of the shot is
compared with.

The built-in sensor, and what it looks at, are to try capture and viewfinder without a camera.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import NamedTuple

import numpy as np

from ...shared import Camera, CfaPattern, Mosaic, SensorCalibration
from ...shared.arrays import FloatArray
from ...shared.errors import InputError
from ..io.scene import Scene
from .drawn.builtin import builtin_scene
from .filters import Filters, filters_for
from .lens import NO_LENS, Lens
from .protocols import PaperProtocol, Protocol, SensorProtocol
from .sensor import simulate_additive, simulate_sensor, typical_noise
from .simulated_burst import SimulatedFrame

BITS = 12
"""Bits of a sample, unless others are asked for."""
FULL_EXPOSURE = SensorProtocol(1.0)
_SWING = 16  # the frame moves on a circle; its radius is the shorter side divided by this
_SEED = 0


class Exposed(NamedTuple):
    """Shot of a simulated camera.

    Attributes
    ----------
    mosaic : Mosaic
        The shot.
    truth : FloatArray
        Scene in the units of a render of the shot, without lens and noise, float32 (H, W, C);
        nothing is clipped.
    white : float
        What the scene's white reads in the shot, scene units: amount of light times exposure. It is
        the peak of every measure of a picture of this shot, so that figures fall with the light.
    notes : tuple[str, ...]
        Remarks for the user on the scene.
    """

    mosaic: Mosaic
    truth: FloatArray
    white: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class SimulatedCamera:
    """A camera that photographs scenes.

    Attributes
    ----------
    pattern : CfaPattern
        Its filters.
    sensor : SensorCalibration
        Its calibration; gamma, noise and colours are replaced where they are not known, see
        `before`.
    measured : bool
        Whether the sensor has gamma and noise of its own; otherwise they follow from the filters.
    protocol : Protocol
        The noise, and the amount of light.
    lens : Lens
        How it shades.
    """

    pattern: CfaPattern
    sensor: SensorCalibration
    measured: bool = False
    protocol: Protocol = FULL_EXPOSURE
    lens: Lens = NO_LENS

    @classmethod
    def of(
        cls,
        pattern: CfaPattern,
        known: Camera | None = None,
        protocol: Protocol = FULL_EXPOSURE,
        *,
        bits: int | None = None,
        lens: Lens = NO_LENS,
    ) -> "SimulatedCamera":
        """The camera in a camera file, or else one with the channels of the pattern.

        bits: of a sample; None = those of the file, or 12. pattern, protocol, lens: see above.
        Raises InputError for any other number of bits.
        """
        drawn = SensorCalibration(pattern.channels, sensor="simulated")
        sensor = known.calibration if known else drawn
        if known is None or bits is not None:
            bits, headroom = BITS if bits is None else bits, protocol.headroom
            # A sensor clips at white, so nothing lies above it.
            levels = SensorCalibration.of_bits(bits, headroom=headroom, channels=sensor.channels)
            sensor = replace(sensor, black_level=levels.black_level, white_level=levels.white_level)
        return cls(pattern, sensor, known is not None, protocol, lens)

    def before(self, scene: Scene, filters: Filters) -> SensorCalibration:
        """The calibration for a scene: colours that it does not know follow from the scene and the
        filters.
        """
        known = self.sensor
        if not self.measured:
            known = replace(known, gamma=filters.gamma, noise=typical_noise(known, filters.unit))
        to_xyz, neutral = filters.colours(scene)
        if known.neutral is None:
            known = replace(known, neutral=neutral, neutral_estimated=scene.neutral_estimated)
        return replace(known, camera_to_xyz=known.camera_to_xyz or to_xyz)

    def shoot(
        self, scene: Scene, rng: np.random.Generator, frame: SimulatedFrame | None = None
    ) -> Exposed:
        """Photograph a scene.

        Raises InputError when the scene has not the channels of the pattern.

        Parameters
        ----------
        rng : np.random.Generator
            Source of the noise.
        frame : SimulatedFrame | None, optional
            The frame of a burst of the scene that is taken: its light, exposure and capture data;
            None = the scene itself.
        """
        frame = frame or SimulatedFrame(scene.rgb)
        filters = filters_for(self.pattern, scene)
        seen, white = filters.of(frame.rgb), self.protocol.light * frame.exposure
        shape = seen.shape[0], seen.shape[1]
        calibration = self.lens.calibrated(self.before(scene, filters), shape)
        metadata = frame.metadata(scene.metadata)
        truth = seen if white == 1 else seen * np.float32(white)
        if isinstance(self.protocol, PaperProtocol):
            sigma = self.protocol.level
            mosaic = simulate_additive(truth, self.pattern, calibration, sigma, rng, metadata)
        else:
            mosaic = simulate_sensor(seen, self.pattern, calibration, white, rng, metadata)
        return Exposed(mosaic, truth, white, scene.notes)


def built_in_sensor(pattern: CfaPattern, camera: Camera | None) -> SensorCalibration:
    """Calibration of the sensor in a camera file, or of one with this pattern.

    Raises InputError when its filters are unknown.
    """
    scene = builtin_scene(1, 1)
    known = SimulatedCamera.of(pattern, camera).before(scene, filters_for(pattern, scene))
    return known if known.noise else replace(known, noise=typical_noise(known))


def usual_gamma(pattern: CfaPattern) -> tuple[float, ...]:
    """Gamma of filters that are mixtures of red, green and blue; otherwise 1 for each channel."""
    try:
        return filters_for(pattern, builtin_scene(1, 1)).gamma
    except InputError:
        return (1.0,) * len(pattern.channels)


def moving_scene(
    pattern: CfaPattern, calibration: SensorCalibration, shape: tuple[int, int], turn: int
) -> Iterator[Mosaic]:
    """Endless frames, (H, W) = shape, of the built-in scene, over which the sensor circles once in
    `turn` frames; with noise.
    """
    height, width = shape
    swing = max(min(shape) // _SWING, 2)
    scene = builtin_scene(width + 2 * swing, height + 2 * swing)
    light = filters_for(pattern, scene).of(scene.rgb)
    rng = np.random.default_rng(_SEED)
    for number in count():
        angle = 2 * math.pi * number / turn
        top, left = round(swing * (1 - math.cos(angle))), round(swing * (1 + math.sin(angle)))
        window = light[top : top + height, left : left + width]
        yield simulate_sensor(window, pattern, calibration, 1.0, rng)
