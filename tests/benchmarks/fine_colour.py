"""Draw fine colour before and after: python -m tests.benchmarks.fine_colour [-o PICTURE.jpg]

Crops of the built-in scene, which has coloured print, edges without luminance, and small leaves. From left to right: the truth;
`best` without anything that it does for fine colour; with what the samples at the colour sites say; with the network as well. One
block of rows each: without noise, sigma 0.01, and over-exposed by a stop.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from offline import BEST, PAPER, render
from shared import Mosaic, SensorCalibration
from shared.arrays import ByteArray, FloatArray
from tests.benchmarks.harness import PATTERN, options
from tools.io.display import ColourTransform
from tools.io.samples import quantise
from tools.simulation.drawn.builtin import builtin_scene
from tools.simulation.sensor import simulate_additive, simulate_sensor

SIZE = 1200, 800
CROPS = ((655, 912), (560, 1020), (595, 690), (300, 300))  # row, column
HEIGHT, WIDTH = 84, 140
ENLARGED, GAP = 2, 6
SITES = replace(BEST, learned=PAPER.learned)
PLAIN = BEST.switched(False)


def shots(scene: FloatArray) -> Iterator[tuple[Mosaic, float]]:
    """A mosaic, and the gain that makes it as bright as the scene."""
    random, calibration = np.random.default_rng(0), SensorCalibration.of_bits(12, headroom=False)
    for sigma in (0.0, 0.01):
        yield simulate_additive(scene, PATTERN, calibration, sigma, random), 1.0
    yield simulate_sensor(scene, PATTERN, calibration, 2.0, random), 0.5


def strips(scene: FloatArray) -> Iterator[ByteArray]:
    """One row of crops for each place and shot."""
    transform = ColourTransform.to_space(SensorCalibration(camera_to_xyz=builtin_scene(8, 8).camera_to_xyz), "srgb")
    for mosaic, gain in shots(scene):
        pictures = [scene, *(gain * render(mosaic, settings).rgb for settings in (PLAIN, SITES, BEST))]
        for row, column in CROPS:
            crops = [picture[row : row + HEIGHT, column : column + WIDTH] for picture in pictures]
            shown = [quantise(transform.apply(crop.astype(np.float32)), 8).astype(np.uint8) for crop in crops]
            large = [each.repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1) for each in shown]
            apart = [np.pad(each, ((0, 0), (0, GAP), (0, 0)), constant_values=255) for each in large]
            yield np.concatenate(apart, axis=1)[:, :-GAP]


def main() -> None:
    """Draw the picture."""
    from PIL import Image

    output = options(__doc__, output="fine_colour.jpg").output
    framed = [np.pad(row, ((0, GAP), (0, 0), (0, 0)), constant_values=255) for row in strips(builtin_scene(*SIZE).rgb)]
    Image.fromarray(np.concatenate(framed)).save(output, quality=90, subsampling=0)
    print(output)


if __name__ == "__main__":
    main()
