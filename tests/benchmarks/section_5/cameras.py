"""Cameras with other filters, photographing one scene under the same light."""

import string
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.sensor import simulate_additive, simulate_sensor
from tools.camera.filters import Filters, filters_for
from tools.evaluation.scene_sets import cut
from tools.scenes.scene import Scene


@dataclass(frozen=True)
class Level:
    """Noise: the paper's, additive, of this `sigma` beside R, G and B filters; or a sensor's in this part of the `light`."""

    sigma: float = 0.0
    light: float = 0.0

    def __str__(self) -> str:
        return f"sensor, light {self.light:g}" if self.light else f"sigma {self.sigma:g}" if self.sigma else "no noise"


@dataclass(frozen=True, eq=False)
class Camera:
    """A pattern in front of a scene, with the filters that it needs."""

    pattern: CfaPattern
    filters: Filters

    @classmethod
    def of(cls, block: str, period: int, scene: Scene) -> "Camera":
        """The camera with one block, rows separated by "/", in every `period` pixels."""
        letters = "".join(sorted(set(block) - set("/W"), key=("RGB" + string.ascii_uppercase).index))
        pattern = CfaPattern.with_block(tuple(block.split("/")), period, channels=letters)
        return cls(pattern, filters_for(pattern, scene))

    def shot(self, light: FloatArray, level: Level) -> Mosaic:
        """Photograph the scene's light, (H, W, N). Additive noise is the same part of what a panchromatic pixel reads in white."""
        filters, random = self.filters, np.random.default_rng(0)
        if level.light:
            sensor = SensorCalibration.of_bits(
                12, headroom=False, channels=filters.channels, gamma=filters.gamma, noise=filters.noise
            )
            return simulate_sensor(filters.of(light), self.pattern, sensor, level.light, random)
        camera = SensorCalibration(filters.channels, filters.gamma)
        return simulate_additive(filters.of(light), self.pattern, camera, level.sigma * filters.unit, random)

    def render(self, light: FloatArray, level: Level, method: Callable[[Mosaic], FloatArray]) -> FloatArray:
        """Photograph the light and render the shot: float32 (H, W, C), what each filter reads, as bright as the scene."""
        return method(self.shot(light, level)) / np.float32(level.light or 1.0)

    def to_scene(self) -> FloatArray:
        """Matrix (C, N) from what the filters read to the scene's channels: the (pseudo-)inverse of how these are mixed."""
        return np.linalg.pinv(np.array(self.filters.matrix)).T.astype(np.float32)


def middle(scene: Scene, size: int) -> Scene:
    """The middle of a scene, at most size x size pixels."""
    return replace(scene, rgb=cut(scene.rgb, size))


Rows = dict[tuple[str, str], list[list[float]]]
"""Figures of a table: by noise and by what is tried, one list for each scene."""


def print_table(title: str, measures: Sequence[str], rows: Rows) -> None:
    """Print a table in Markdown: the means over the scenes."""
    print(f"\n### {title}\n\n| | | {' | '.join(measures)} |\n|{'---|' * (len(measures) + 2)}")
    for (level, name), found in rows.items():
        print(f"| {level} | {name} | {' | '.join(f'{figure:.3g}' for figure in np.mean(found, axis=0))} |")
    print(flush=True)
