"""A burst: frames of one scene that a hand-held camera takes one after the other, each as light on its sensor."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shared import CaptureMetadata
from shared.arrays import FloatArray
from shared.errors import InputError

from .motion import MOST_DEGREES, RADIUS, Motion, displaced, reach

MOST_FRAMES, MOST_PIXELS, MOST_STOPS = 1000, 1000.0, 10.0
STILL = Motion()
_TIME = 1 / 60  # seconds: exposure time of a bracket, where the scene does not know its own

# The thing that moves through a scene on its own.
_SIZE = 0.2  # diameter, part of the frame's shorter side
_COLOUR = (2.0, 0.8, 0.2)  # of the scene's mean luminance, in an order that is drawn
_TEXTURES = 8  # places of the scene, of which the one with the most contrast is taken
_STEPS = (5.0, 20.0)  # pixels of the sensor from frame to frame


@dataclass(frozen=True)
class SimulatedBurst:
    """How a burst is taken.

    frames: their number, 1 to MOST_FRAMES. The first is the reference, which has not moved.
    pixels: of the sensor, by which the others are at most displaced.
    degrees: by which they are at most rotated.
    moving: whether a thing moves through the scene.
    stops: exposure of each frame, 0 = the scene's own; () = all of them are.
    Raises InputError for figures that are negative, not finite or too large, and for another number of stops than frames.
    """

    frames: int
    pixels: float = 0.0
    degrees: float = 0.0
    moving: bool = False
    stops: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= MOST_FRAMES:
            raise InputError(f"`burst` is {self.frames}, expected 1 to {MOST_FRAMES} frames")
        if not 0 <= self.pixels <= MOST_PIXELS:
            raise InputError(f"`motion` is {self.pixels} pixels, expected 0 to {MOST_PIXELS:g}")
        if not 0 <= self.degrees <= MOST_DEGREES:
            raise InputError(f"`rotation` is {self.degrees} degrees, expected 0 to {MOST_DEGREES:g}")
        if self.stops and len(self.stops) != self.frames:
            raise InputError(f"`bracket` has {len(self.stops)} figures for {self.frames} frames, expected one for each")
        if not all(abs(stop) <= MOST_STOPS for stop in self.stops):
            raise InputError(f"`bracket` is {self.stops} stops, expected -{MOST_STOPS:g} to {MOST_STOPS:g}")

    @property
    def largest(self) -> Motion:
        """A motion that is at least as large as any of the burst."""
        return Motion((self.pixels, self.pixels), -math.radians(self.degrees))


@dataclass(frozen=True, eq=False)
class MovingThing:
    """A thing that moves evenly through a scene on its own: an opaque disc with a texture of the scene, in one strong colour.

    texture: its light, (h, w, C); the disc is in the middle, surrounded by at least `RADIUS` pixels.
    row, column: of its centre in the first frame, pixels.
    radius: pixels.
    step: pixels down and across from one frame to the next.
    """

    texture: FloatArray
    row: float
    column: float
    radius: float
    step: tuple[float, float]

    @classmethod
    def drawn(cls, rgb: FloatArray, margin: int, frames: int, pixel: int, rng: np.random.Generator) -> "MovingThing":
        """A thing that stays within a scene for some frames.

        rgb: the scene, (H, W, C).
        margin: pixels at its border, of which the thing keeps clear.
        frames: number of frames.
        pixel: pixels of the scene, each way, that are one of the sensor.
        """
        shape = np.array(rgb.shape[:2])
        radius = _SIZE / 2 * float((shape - 2 * margin).min())
        room = shape - 2 * (margin + radius)  # for its centre
        angle, speed = rng.uniform(0, 2 * math.pi), rng.uniform(*_STEPS) * pixel
        way = speed * max(frames - 1, 1) * np.array([math.sin(angle), math.cos(angle)])
        way *= min(1.0, *(room / np.maximum(np.abs(way), 1e-9)))
        row, column = margin + radius + np.maximum(-way, 0) + rng.uniform(size=2) * (room - np.abs(way))
        down, across = way / max(frames - 1, 1)
        side = 2 * (math.ceil(radius) + RADIUS + 1) + 1
        around = np.pad(rgb.mean(axis=2), (0, side), mode="symmetric")  # for scenes smaller than the texture
        places = rng.integers(np.maximum(shape - side + 1, 1), size=(_TEXTURES, 2))
        grey = max((around[top : top + side, left : left + side] for top, left in places), key=np.std)[::-1, ::-1].copy()
        grey *= rgb.mean() / max(float(grey.mean()), 1e-9)
        texture = grey[..., None] * rng.permutation(np.resize(_COLOUR, rgb.shape[2])).astype(np.float32)
        return cls(texture, float(row), float(column), radius, (float(down), float(across)))

    def place(self, frame: int) -> tuple[float, float]:
        """Row and column of its centre in a frame, counted from 0, as the reference sees it."""
        return self.row + frame * self.step[0], self.column + frame * self.step[1]

    def before(self, rgb: FloatArray, frame: int) -> FloatArray:
        """The scene with the thing in front of it, (H, W, C), when a frame, counted from 0, is taken."""
        row, column = self.place(frame)
        half = self.texture.shape[0] // 2
        whole = round(row), round(column)
        down, across = row - whole[0], column - whole[1]
        texture = displaced(self.texture, Motion((down, across))).clip(0)
        places = np.arange(-half, half + 1)
        distance = np.hypot(places[:, None] - down, places - across)
        covers = np.clip(self.radius + 0.5 - distance, 0, 1).astype(np.float32)[..., None]
        seen = rgb.copy()
        rows, columns = (slice(max(at - half, 0), at + half + 1) for at in whole)
        inside = tuple(
            slice(max(half - at, 0), max(half - at, 0) + n) for at, n in zip(whole, seen[rows, columns].shape, strict=False)
        )
        seen[rows, columns] += covers[inside] * (texture[inside] - seen[rows, columns])
        return seen


@dataclass(frozen=True, eq=False)
class SimulatedFrame:
    """One frame of a burst.

    rgb: the light that it sees, float32 (H, W, C), scene units, whatever its exposure is.
    motion: where it sees what the reference sees, pixels of the sensor.
    stops: its exposure; None = it is no part of a bracket.
    thing: (row, column, radius) of the moving thing at this time, pixels, as the reference would see it; None = there is none.
    """

    rgb: FloatArray
    motion: Motion = STILL
    stops: float | None = None
    thing: tuple[float, float, float] | None = None

    @property
    def exposure(self) -> float:
        """Factor by which its light is multiplied."""
        return 1.0 if self.stops is None else 2.0**self.stops

    def metadata(self, scene: CaptureMetadata) -> CaptureMetadata:
        """Capture data of the frame: those of the scene, with an exposure time that tells the frames of a bracket apart."""
        if self.stops is None:
            return scene
        return replace(scene, exposure_time=(scene.exposure_time or _TIME) * self.exposure)


def reduced(rgb: FloatArray, pixel: int) -> FloatArray:
    """The means of `pixel` x `pixel` pixels, float32 (H // pixel, W // pixel, C): a sensor of larger pixels.

    >>> import numpy as np
    >>> reduced(np.arange(15, dtype=np.float32).reshape(3, 5, 1), 2)[..., 0].tolist()
    [[3.0, 5.0]]
    """
    if pixel == 1:
        return rgb
    rows, columns = rgb.shape[0] // pixel, rgb.shape[1] // pixel
    whole = rgb[: rows * pixel, : columns * pixel]
    mean = np.zeros((rows, columns, rgb.shape[2]), np.float32)
    for row in range(pixel):
        for column in range(pixel):
            mean += whole[row::pixel, column::pixel]
    mean /= pixel**2
    return mean


def tremor(burst: SimulatedBurst, rng: np.random.Generator) -> list[Motion]:
    """How a burst's frames have moved: a random walk from the first frame on, which stays within the burst's limits.

    >>> import numpy as np
    >>> first, second = tremor(SimulatedBurst(2, pixels=3), np.random.default_rng(1))
    >>> first.none, 0 < math.hypot(*second.shift) <= 3
    (True, True)
    """
    walk = [(0.0, 0.0, 0.0)]  # down, across, degrees clockwise
    while len(walk) < burst.frames:
        steps = rng.normal(0, [burst.pixels / 2, burst.pixels / 2, burst.degrees / 2]).tolist()
        down, across, degrees = (last + step for last, step in zip(walk[-1], steps, strict=True))
        if math.hypot(down, across) <= burst.pixels and abs(degrees) <= burst.degrees:
            walk.append((down, across, degrees))
    return [Motion((down, across), -math.radians(degrees)) for down, across, degrees in walk]


def burst_frames(rgb: FloatArray, burst: SimulatedBurst, rng: np.random.Generator, pixel: int = 1) -> Iterator[SimulatedFrame]:
    """Yield the frames of a burst, the reference first. They see true scene everywhere, so they are smaller than it.

    rgb: the scene, float32 (H, W, C), scene units.
    rng: source of the motions, and of the thing that moves.
    pixel: pixels of the scene, each way, that are one of the sensor: the scene moves at its full size, and is averaged then.
    Raises InputError if nothing is left between the margins that the motion needs, or not one such pixel fits into the scene.

    >>> import numpy as np
    >>> light = np.full((200, 300, 3), 0.5, np.float32)
    >>> [frame.rgb.shape for frame in burst_frames(light, SimulatedBurst(2, pixels=3), np.random.default_rng(1), pixel=2)]
    [(82, 132, 3), (82, 132, 3)]
    """
    whole = [count // pixel * pixel for count in rgb.shape[:2]]  # the centre of the scene is that of the frames
    if not all(whole):
        raise InputError(f"the scene has {rgb.shape[1]} x {rgb.shape[0]} pixels: `reduce={pixel}` leaves nothing of it")
    scene = rgb[: whole[0], : whole[1]]
    margin = -(-reach(burst.largest.times(pixel), scene.shape) // pixel)
    rows, columns = (count // pixel - 2 * margin for count in whole)
    if min(rows, columns) < 1:
        raise InputError(
            f"a burst with this motion loses {margin} pixels on each side of a scene of {whole[1] // pixel} x {whole[0] // pixel}: "
            "nothing is left; take a larger picture, or less motion"
        )
    walk = tremor(burst, rng)
    thing = MovingThing.drawn(scene, margin * pixel, burst.frames, pixel, rng) if burst.moving else None
    for number, motion in enumerate(walk):
        stops = burst.stops[number] if burst.stops else None
        frame = SimulatedFrame(scene, motion, stops, _on_sensor(thing, number, margin, pixel) if thing else None)
        light = thing.before(scene, number) if thing else scene
        if not motion.none:
            light = displaced(light, motion.times(pixel)).clip(0)  # interpolation overshoots
        light = light[margin * pixel : whole[0] - margin * pixel, margin * pixel : whole[1] - margin * pixel]
        yield replace(frame, rgb=reduced(light, pixel))


def _on_sensor(thing: MovingThing, number: int, margin: int, pixel: int) -> tuple[float, float, float]:
    """(row, column, radius) of the thing in pixels of the sensor, without the margin."""
    row, column = ((place - (pixel - 1) / 2) / pixel - margin for place in thing.place(number))
    return row, column, thing.radius / pixel


def motion_text(frames: Mapping[str, SimulatedFrame], shape: tuple[int, int]) -> str:
    """The true motion of a burst as JSON, to measure alignment with.

    frames: by the names of their files.
    shape: rows and columns of each.
    """
    described: dict[str, Any] = {
        "convention": "a point (y, x) of the reference, from `centre`, is at y' = cos(a) y - sin(a) x + down, "
        "x' = cos(a) x + sin(a) y + across of a frame, from `centre`; a = degrees, counter-clockwise; "
        "pixels, rows down and columns to the right",
        "centre": [(count - 1) / 2 for count in shape],
        "reference": next(iter(frames)),
        "frames": {
            name: {
                "down": frame.motion.shift[0],
                "across": frame.motion.shift[1],
                "degrees": math.degrees(frame.motion.angle),
                **({} if frame.stops is None else {"stops": frame.stops}),
                **({} if frame.thing is None else {"thing": dict(zip(("row", "column", "radius"), frame.thing, strict=True))}),
            }
            for name, frame in frames.items()
        },
    }
    if any(frame.thing for frame in frames.values()):
        described["thing"] = (
            "what moves on its own: row, column and radius of its disc as the reference would see it, from pixel (0, 0)"
        )
    return json.dumps(described, indent=1) + "\n"
