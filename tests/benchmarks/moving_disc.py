"""A disc that moves through the frames of a simulated burst on its own."""

import math
from dataclasses import replace

import numpy as np

from panchroma.shared.arrays import FloatArray
from panchroma.tools.simulation.burst import SimulatedFrame

COLOUR = (2.0, 0.8, 0.2)  # of the scene's mean luminance
STEP = 12.0  # pixels from frame to frame
SIZE = 0.1  # radius, part of the frame's shorter side

Disc = tuple[float, float, float]
"""Row, column and radius, pixels."""


def with_disc(frames: list[SimulatedFrame], rng: np.random.Generator) -> tuple[list[SimulatedFrame], list[Disc]]:
    """Return the frames with an opaque, textured disc in front of the scene, and where it is in each."""
    rows, columns = frames[0].rgb.shape[:2]
    radius = SIZE * min(rows, columns)
    angle = rng.uniform(0, 2 * math.pi)
    way = STEP * np.array([math.sin(angle), math.cos(angle)])
    middle = np.array([rows, columns]) / 2
    texture = 1 + 0.5 * rng.standard_normal((rows, columns)).clip(-1.5, 1.5)
    light: FloatArray = (texture[..., None] * COLOUR * frames[0].rgb.mean()).astype(np.float32)
    discs, seen = list[Disc](), list[SimulatedFrame]()
    for number, frame in enumerate(frames):
        row, column = (middle + (number - (len(frames) - 1) / 2) * way).tolist()
        distance = np.hypot(np.arange(rows)[:, None] - row, np.arange(columns) - column)
        covers = np.clip(radius + 0.5 - distance, 0, 1).astype(np.float32)[..., None]
        shift = round(row - middle[0]), round(column - middle[1])
        moved = np.roll(light, shift, (0, 1))
        seen.append(replace(frame, rgb=frame.rgb + covers * (moved - frame.rgb)))
        discs.append((row, column, radius))
    return seen, discs
