"""The simulated camera: from a scene to its shot, and to the truth that a picture of the shot is
compared with.

The built-in sensor, and what it looks at, are to try capture and viewfinder without a camera.

A burst is frames of one scene that a hand-held camera takes one after the other, each as light on
its sensor. A camera that has moved sees the scene by splines of the fifth order. They change waves
of up to 0.7 of the highest frequency by less than 3 % of a scene between 0 and 2.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, repeat
from typing import Any, NamedTuple

import numpy as np

from ...shared import Camera, CaptureMetadata, CfaPattern, FloatArray, InputError, Mosaic
from ...shared.calibration import SensorCalibration
from ..io.scene import Scene
from .drawn.builtin import builtin_scene
from .filters import Filters, filters_for
from .lens import Lens
from .protocols import PaperProtocol, Protocol, SensorProtocol
from .sensor import simulate_additive, simulate_sensor, typical_noise

MOST_FRAMES, MOST_PIXELS, MOST_STOPS = 1000, 1000.0, 10.0
_TIME = 1 / 60  # seconds: exposure time of a bracket, where the scene does not know its own
RADIUS = 12
"""Pixels up to which a sample has an influence on interpolated ones that can be measured."""


class CameraMotion(NamedTuple):
    """A motion of the camera.

    shift: down and across, pixels. angle: radians; positive turns the picture counter-clockwise.
    """

    shift: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def times(self, factor: float) -> "CameraMotion":
        """Return the same motion for a frame with `factor` times as many pixels a side."""
        return CameraMotion((self.shift[0] * factor, self.shift[1] * factor), self.angle)


STILL = CameraMotion()


@dataclass(frozen=True)
class SimulatedBurst:
    """Parameters of a simulated burst.

    Raises InputError for figures that are negative, not finite or too large, and for another number
    of stops than frames.

    Attributes
    ----------
    frames : int
        Their number, 1 to MOST_FRAMES. The first is the reference, which has not moved.
    pixels : float
        Of the sensor, by which the others are at most displaced.
    degrees : float
        By which they are at most rotated.
    stops : tuple[float, ...]
        Exposure of each frame, 0 = the scene's own; () = all of them are.
    """

    frames: int
    pixels: float = 0.0
    degrees: float = 0.0
    stops: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= MOST_FRAMES:
            raise InputError(f"`burst` is {self.frames}, expected 1 to {MOST_FRAMES} frames")
        if not 0 <= self.pixels <= MOST_PIXELS:
            raise InputError(f"`motion` is {self.pixels} pixels, expected 0 to {MOST_PIXELS:g}")
        if self.stops and len(self.stops) != self.frames:
            counts = f"{len(self.stops)} figures for {self.frames} frames"
            raise InputError(f"`bracket` has {counts}, expected one for each")
        if not all(abs(stop) <= MOST_STOPS for stop in self.stops):
            expected = f"expected -{MOST_STOPS:g} to {MOST_STOPS:g}"
            raise InputError(f"`bracket` is {self.stops} stops, {expected}")

    @classmethod
    def of(
        cls, frames: int | None, motion: float = 0.0, bracket: Sequence[float] = ()
    ) -> "SimulatedBurst":
        """The burst that is asked for; one frame if `frames` is None.

        Raises InputError for the motion or the exposures of no burst.
        """
        for name, value in (("motion", motion), ("bracket", bracket)):
            if frames is None and value:
                raise InputError(f"`{name}` needs `burst`: it is about the frames of a series")
        return cls(1 if frames is None else frames, motion, stops=tuple(bracket))


@dataclass(frozen=True, eq=False)
class SimulatedFrame:
    """One frame of a burst.

    Attributes
    ----------
    rgb : FloatArray
        The light that it sees, float32 (H, W, C), scene units, whatever its exposure is.
    motion : CameraMotion
        Where it sees what the reference sees, pixels of the sensor.
    stops : float | None
        Its exposure; None = it is no part of a bracket.
    """

    rgb: FloatArray
    motion: CameraMotion = STILL
    stops: float | None = None

    @property
    def exposure(self) -> float:
        """Factor by which its light is multiplied."""
        return 1.0 if self.stops is None else 2.0**self.stops

    def metadata(self, scene: CaptureMetadata) -> CaptureMetadata:
        """Capture data of the frame: those of the scene, with an exposure time that tells the
        frames of a bracket apart.
        """
        if self.stops is None:
            return scene
        return replace(scene, exposure_time=(scene.exposure_time or _TIME) * self.exposure)


def reduced(rgb: FloatArray, pixel: int) -> FloatArray:
    """The means of `pixel` x `pixel` pixels, float32 (H // pixel, W // pixel, C): a sensor of
    larger pixels.

    Examples
    --------
    >>> import numpy as np
    >>> reduced(np.arange(15, dtype=np.float32).reshape(3, 5, 1), 2)[..., 0].tolist()
    [[3.0, 5.0]]
    """
    rows, columns = rgb.shape[0] // pixel, rgb.shape[1] // pixel
    total: FloatArray = np.zeros((rows, columns, rgb.shape[2]), np.float32)
    for row, column in np.ndindex(pixel, pixel):
        total += rgb[row : rows * pixel : pixel, column : columns * pixel : pixel]
    return total / np.float32(pixel**2)


def tremor(burst: SimulatedBurst, rng: np.random.Generator) -> list[CameraMotion]:
    """Motions of a burst's frames: a random walk from the first frame on, which stays within the
    burst's limits.

    Examples
    --------
    >>> import numpy as np
    >>> first, second = tremor(SimulatedBurst(2, pixels=3), np.random.default_rng(1))
    >>> first == CameraMotion(), 0 < math.hypot(*second.shift) <= 3
    (True, True)
    """
    walk = [(0.0, 0.0, 0.0)]  # down, across, degrees clockwise
    while len(walk) < burst.frames:
        steps = rng.normal(0, [burst.pixels / 2, burst.pixels / 2, burst.degrees / 2]).tolist()
        down, across, degrees = (last + step for last, step in zip(walk[-1], steps, strict=True))
        if math.hypot(down, across) <= burst.pixels and abs(degrees) <= burst.degrees:
            walk.append((down, across, degrees))
    return [CameraMotion((down, across), -math.radians(degrees)) for down, across, degrees in walk]


def burst_frames(
    rgb: FloatArray, burst: SimulatedBurst, rng: np.random.Generator, pixel: int = 1
) -> Iterator[SimulatedFrame]:
    """Yield the frames of a burst, the reference first. They see true scene everywhere, so they are
    smaller than it.

    Raises InputError if nothing is left between the margins that the motion needs, or not one such
    pixel fits into the scene.

    Parameters
    ----------
    rgb : FloatArray
        The scene, float32 (H, W, C), scene units.
    rng : np.random.Generator
        Source of the motions.
    pixel : int, optional
        Pixels of the scene, each way, that are one of the sensor: the scene moves at its full size,
        and is averaged then.

    Examples
    --------
    >>> import numpy as np
    >>> light = np.full((200, 300, 3), 0.5, np.float32)
    >>> [frame.rgb.shape for frame in burst_frames(light, SimulatedBurst(2, pixels=3),
    ...     np.random.default_rng(1), pixel=2)]
    [(82, 132, 3), (82, 132, 3)]
    """
    if pixel < 1:
        raise InputError(f"`reduce` is {pixel}, expected 1 or more")
    # the centre of the scene is that of the frames
    rows, columns = (count // pixel for count in rgb.shape[:2])
    scene = rgb[: rows * pixel, : columns * pixel]
    largest = CameraMotion((burst.pixels, burst.pixels), -math.radians(burst.degrees))
    margin = -(-reach(largest.times(pixel), scene.shape) // pixel)
    if min(rows, columns) <= 2 * margin:
        size = f"{rgb.shape[1]} x {rgb.shape[0]} pixels"
        remedy = "take a larger picture, a smaller `reduce` or less motion"
        raise InputError(f"of a scene of {size} nothing is left; {remedy}")
    inner = tuple(slice(margin * pixel, (size - margin) * pixel) for size in (rows, columns))
    for motion, stops in zip(tremor(burst, rng), burst.stops or repeat(None), strict=False):
        light = displaced(scene, motion.times(pixel)).clip(0)  # interpolation overshoots
        yield SimulatedFrame(reduced(light[inner], pixel), motion, stops)


def displaced(rgb: FloatArray, motion: CameraMotion) -> FloatArray:
    """Return the light on a sensor after a motion: see `offline.burst.in_frame` for where it is.

    rgb: the light before it. motion: of the camera, pixels of this picture.

    Returns
    -------
    float32 (H, W, C)
        Beyond its borders the outermost pixels go on: it is true `reach` pixels from the border and
        further inside. Interpolation may overshoot at sharp edges, below zero too.
    """
    if motion == STILL:
        return rgb
    from scipy.ndimage import affine_transform  # takes longer to load than all of ours

    cosine, sine = math.cos(motion.angle), math.sin(motion.angle)
    back = np.array([[cosine, sine], [-sine, cosine]])
    centre = (np.array(rgb.shape[:2]) - 1) / 2
    offset = centre - back @ (centre + motion.shift)
    result = np.empty_like(rgb)
    for light, output in zip(np.moveaxis(rgb, 2, 0), np.moveaxis(result, 2, 0), strict=True):
        affine_transform(light, back, offset, output=output, order=5, mode="nearest")
    return result


def reach(motion: CameraMotion, shape: tuple[int, ...]) -> int:
    """Return how far from the border `displaced` depends on what is beyond it, pixels; 0 for no
    motion.
    """
    if motion == STILL:
        return 0
    half = np.array(shape[:2]) / 2
    sine, less = abs(math.sin(motion.angle)), 1 - math.cos(motion.angle)
    moved = half * less + half[::-1] * sine + np.abs(motion.shift)
    return math.ceil(moved.max() + RADIUS)


def motion_text(frames: Mapping[str, SimulatedFrame], shape: tuple[int, int]) -> str:
    """The true motion of a burst as JSON, to measure alignment with.

    frames: by the names of their files. shape: rows and columns of each.
    """
    moved = {}
    for name, frame in frames.items():
        (down, across), angle = frame.motion
        stops = {} if frame.stops is None else {"stops": frame.stops}
        moved[name] = {"down": down, "across": across, "degrees": math.degrees(angle), **stops}
    described: dict[str, Any] = {
        "convention": "a point (y, x) of the reference, from `centre`, is at y' = cos(a) y - "
        "sin(a) x + down, x' = cos(a) x + sin(a) y + across of a frame, from `centre`; a = "
        "degrees, counter-clockwise; pixels, rows down and columns to the right",
        "centre": [(count - 1) / 2 for count in shape],
        "reference": next(iter(frames)),
        "frames": moved,
    }
    return json.dumps(described, indent=1) + "\n"


BITS = 12
"""Bits of a sample, unless others are asked for."""
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
    """

    mosaic: Mosaic
    truth: FloatArray
    white: float


@dataclass(eq=False)
class SimulatedCamera:
    """A camera that photographs scenes: that in a camera file, or else one with the channels of the
    pattern.

    Raises InputError for any other number of bits than a sensor has.

    Attributes
    ----------
    pattern : CfaPattern
        Its filters.
    known : Camera | None, optional
        Of the camera file; None = there is none, and gamma and noise follow from the filters, see
        `before`.
    protocol : Protocol, optional
        The noise, and the amount of light.
    bits : int | None, optional
        Of a sample; None = those of the file, or 12.
    lens : Lens, optional
        How it shades.
    """

    pattern: CfaPattern
    known: Camera | None = None
    protocol: Protocol = field(default_factory=SensorProtocol)
    bits: int | None = None
    lens: Lens = field(default_factory=Lens)

    def __post_init__(self) -> None:
        drawn = SensorCalibration(self.pattern.channels, sensor="simulated")
        # simulated pixels are all whole, and defects elsewhere than in a frame of another size
        sensor = replace(self.known.calibration, defects=()) if self.known else drawn
        if self.known is None or self.bits is not None:
            bits, headroom = BITS if self.bits is None else self.bits, self.protocol.headroom
            # A sensor clips at white, so nothing lies above it.
            levels = SensorCalibration.of_bits(bits, headroom=headroom, channels=sensor.channels)
            sensor = replace(sensor, black_level=levels.black_level, white_level=levels.white_level)
        self._sensor = sensor

    def before(self, scene: Scene, filters: Filters) -> SensorCalibration:
        """The calibration for a scene: colours that it does not know follow from the scene and the
        filters.
        """
        known = self._sensor
        if self.known is None:
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
        truth = seen if white == 1 else seen * np.float32(white)
        if isinstance(self.protocol, PaperProtocol):
            mosaic = simulate_additive(truth, self.pattern, calibration, self.protocol.level, rng)
        else:
            mosaic = simulate_sensor(seen, self.pattern, calibration, white, rng)
        return Exposed(replace(mosaic, metadata=frame.metadata(scene.metadata)), truth, white)


def built_in_sensor(pattern: CfaPattern, camera: Camera | None) -> SensorCalibration:
    """Calibration of the sensor in a camera file, or of one with this pattern.

    Raises InputError when its filters are unknown.
    """
    scene = builtin_scene(1, 1)
    known = SimulatedCamera(pattern, camera).before(scene, filters_for(pattern, scene))
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
