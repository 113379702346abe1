"""Shading from flat frames: what they show, and which of them are refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import DoubleArray
from shared.errors import InputError
from shared.sensor import simulate_sensor
from tools.calibration.shading import measure_shading
from tools.scenes.lens import lens_shading

SHAPE = (300, 450)
PATTERN = CfaPattern.bayer(6)
Light = Callable[[DoubleArray, DoubleArray], DoubleArray]


def flats(
    light: float = 0.6,
    lens: tuple[float, float] = (2.0, 0.15),
    surface: Light | None = None,
    focal: tuple[float | None, ...] = (None, None),
    pattern: CfaPattern = PATTERN,
) -> list[Mosaic]:
    """Flat frames of a surface whose light is given over places from -1 to 1, half the diagonal."""
    down, right = ((np.arange(size) - size / 2) / (np.hypot(*SHAPE) / 2) for size in SHAPE)
    even = np.ones(SHAPE) if surface is None else surface(down[:, None], right[None])
    rgb = np.repeat(even[..., None], 3, axis=2).astype(np.float32)
    shading = lens_shading(*lens, 4, SHAPE)
    sensor = SensorCalibration.of_bits(12, headroom=False, shading=shading)
    frames = []
    for seed, length in enumerate(focal):
        taken = simulate_sensor(rgb, pattern, sensor, light, np.random.default_rng(seed), CaptureMetadata(focal_length=length))
        frames.append(replace(taken, calibration=replace(taken.calibration, shading=None)))
    return frames


@pytest.mark.parametrize("lens", [(2.0, 0.15), (0.5, 0.05), (0.0, 0.2)])
@pytest.mark.parametrize("tile", [None, ("WBWG", "BWGW", "WGWR", "GWRW")])
def test_a_lens_is_measured(lens: tuple[float, float], tile: tuple[str, ...] | None) -> None:
    pattern = CfaPattern(tile) if tile else PATTERN
    found = measure_shading(flats(lens=lens, focal=(50.0, 50.0), pattern=pattern))
    assert found.shading is not None
    truth = lens_shading(*lens, 4, SHAPE)
    order = ["RGBW".index(letter) for letter in pattern.channels + "W"]
    errors = [found.shading.of_plane(SHAPE, plane) / truth.of_plane(SHAPE, plane) - 1 for plane in range(4)]
    assert order == sorted(order)
    assert max(float(np.sqrt((error**2).mean())) for error in errors) < 0.005
    assert max(float(np.abs(error).max()) for error in errors) < 6 * found.error
    assert found.shading.focal_length == 50
    assert found.shading.residual < 0.003


def test_even_frames_have_none() -> None:
    found = measure_shading(flats(lens=(0.0, 0.0)))
    assert found.shading is None
    assert found.words.startswith("no shading: the flat frames are even to ±")


def test_clipped_frames_are_left_out() -> None:
    found = measure_shading([*flats(), *flats(3.0)])
    assert found.frames == 2


def falls_off(row: float, column: float) -> Light:
    return lambda down, right: 0.9 / (1 + (down - row) ** 2 + (right - column) ** 2) ** 2


def test_a_centre_a_little_off_the_middle_is_a_lens() -> None:
    found = measure_shading(flats(lens=(0.0, 0.1), surface=falls_off(0.02, 0.04)))
    assert found.shading is not None


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ({"light": 3.0}, "% of the panchromatic samples or more are clipped; expose less"),
        ({"light": 0.02}, "too dark, and tell the shading only to"),
        ({"light": 0.0003}, "dark"),
        ({"surface": lambda down, right: 1 + 0.06 * right + 0 * down}, r"the light is tilted: (9|10|11)\.. % brighter on one side"),
        ({"surface": lambda down, right: 1 - 0.06 * down + 0 * right, "lens": (0, 0)}, "the light is tilted"),
        ({"surface": falls_off(0.1, 0.28), "lens": (0, 0.1)}, "around a place that is 1[4-6] % of the diagonal off the middle"),
        ({"surface": lambda down, right: 1 + 0.05 * np.sin(20 * right) * np.cos(15 * down)}, "from any smooth shading"),
        ({"focal": (35.0, 50.0)}, "their focal lengths are 35 to 50 mm"),
    ],
)
def test_flats_that_do_not_tell_it_are_refused(frames: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"^flat frames: .*{words}"):
        measure_shading(flats(**frames))
