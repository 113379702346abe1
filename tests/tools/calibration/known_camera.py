"""A camera whose truth is known, for tests: its frames, and where the built-in chart lies in
them.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration, write_dng
from panchroma.tools.calibration.chart.place import COLUMNS, PATCH, ROWS, ChartPlace
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.drawn.charts import CORNERS, chart_scene, color_checker_xyz
from panchroma.tools.simulation.load import load_scene
from panchroma.tools.simulation.perspective import apply_homography, homography, rectangle
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from tests.data import photograph

NOISE = NoiseModel((2e-4, 2.2e-4, 1.8e-4, 2.4e-4), (6e-4, 7e-4, 8e-4, 9e-4))
TRUTH = SensorCalibration(
    gamma=(0.9, 1.1, 0.8),
    noise=NOISE,
    black_level=(256.0, 257.0, 255.0, 258.0),
    white_level=4095,
    sensor="bench",
)
# What a shot says of itself before calibration.
BLIND = replace(TRUTH, gamma=(1.0, 1.0, 1.0), noise=None)


PATTERNS = {
    **{f"K = {period}": CfaPattern.bayer(period) for period in (4, 6, 8)},
    "Kodak's tile": CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW"),
    "RG/BW": CfaPattern.of_letters("RG/BW"),
}
WIDTH, HEIGHT = 600, 400
REFERENCE = color_checker_xyz()


@cache
def chart() -> Scene:
    """The built-in chart, drawn once."""
    return chart_scene(WIDTH, HEIGHT)


def frame(
    rgb: ArrayLike,
    period: int = 6,
    seed: int = 0,
    says: SensorCalibration = BLIND,
    pattern: CfaPattern | None = None,
    truth: SensorCalibration = TRUTH,
) -> Mosaic:
    """A frame of the true sensor looking at (H, W, C), whose file says `says`. pattern: None =
    Bayer blocks of this period.
    """
    pattern = pattern or CfaPattern.bayer(period)
    light, random = np.asarray(rgb, np.float32), np.random.default_rng(seed)
    taken = simulate_sensor(light, pattern, truth, 1.0, random)
    return Mosaic(taken.codes, pattern, says)


def shot_of(name: str, period: int) -> Mosaic:
    """A shot simulated from a photograph, which states neither black level nor shading."""
    says, pattern = SensorCalibration.of_bits(12), CfaPattern.bayer(period)
    rgb = load_scene(str(photograph(name))).rgb
    taken = simulate_additive(rgb, pattern, says, 0.003, np.random.default_rng(0))
    return Mosaic(taken.codes, pattern, says)


def edited(mosaic: Mosaic, edit: Callable[[np.ndarray], ArrayLike]) -> Mosaic:
    """The frame with other codes; edit: gets them as float64, a copy."""
    codes = np.rint(edit(mosaic.codes.astype(float))).clip(0, 65535)
    return replace(mosaic, samples=codes.astype(np.uint16))


def stating(mosaic: Mosaic, **facts: Any) -> Mosaic:
    """The frame with other statements in its calibration, `shading=None` for example."""
    return replace(mosaic, calibration=replace(mosaic.calibration, **facts))


def save(path: Path, mosaic: Mosaic) -> Path:
    """Write the frame as a DNG with a black preview."""
    write_dng(path, mosaic, np.zeros((20, 30, 3), np.uint8))
    return path


def cgats(values: ArrayLike, columns: str = "XYZ_X XYZ_Y XYZ_Z", names: Sequence[str] = ()) -> str:
    """A CGATS file; names: of the patches, by default A1 to F4 in reading order."""
    names = names or [f"{'ABCDEF'[index % 6]}{index // 6 + 1}" for index in range(24)]
    texts = [" ".join(f"{value:.6f}" for value in row) for row in np.asarray(values)]
    rows = [f"{name} {text}" for name, text in zip(names, texts, strict=True)]
    begin = f"CTI3\nBEGIN_DATA_FORMAT\nSAMPLE_ID {columns}\nEND_DATA_FORMAT\nBEGIN_DATA\n"
    return begin + "\n".join(rows) + "\nEND_DATA\n"


def true_place() -> ChartPlace:
    """The chart in its scene."""
    to_frame = homography(rectangle(0, 0, COLUMNS, ROWS), np.array(CORNERS) * (WIDTH, HEIGHT))
    edge = (1 - PATCH) / 2
    x, y = apply_homography(to_frame, *rectangle(edge, edge, COLUMNS - edge, ROWS - edge).T)
    return ChartPlace(tuple(zip(x.tolist(), y.tolist(), strict=True)))
