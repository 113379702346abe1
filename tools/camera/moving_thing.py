"""A thing that moves through a scene on its own: an opaque disc with a texture of the scene, in one strong colour."""

import math
from dataclasses import dataclass

import numpy as np

from shared.arrays import FloatArray
from shared.motion import Motion

from .motion import RADIUS, displaced

_SIZE = 0.2  # diameter, part of the frame's shorter side
_COLOUR = (2.0, 0.8, 0.2)  # of the scene's mean luminance, in an order that is drawn
_TEXTURES = 8  # places of the scene, of which the one with the most contrast is taken
_STEPS = (5.0, 20.0)  # pixels of the sensor from frame to frame


@dataclass(frozen=True, eq=False)
class MovingThing:
    """A disc that moves evenly.

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
