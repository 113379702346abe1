"""Shading from flat frames: what they show, and which of them are refused."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import DoubleArray
from panchroma.shared.errors import InputError
from panchroma.tools.calibration.measured_shading import measure_shading
from panchroma.tools.calibration.photon_transfer import measure_flats
from panchroma.tools.simulation.lens import lens_shading
from panchroma.tools.simulation.sensor import simulate_sensor
from tests.tools.calibration.known_camera import stating

SHAPE = 300, 450
PATTERN, KODAK = CfaPattern.bayer(6), CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW")
Over = Callable[[DoubleArray, DoubleArray], DoubleArray]
"""Something over the frame, by rows and columns from the middle, in half diagonals."""


def places(shape: tuple[int, int]) -> tuple[DoubleArray, DoubleArray]:
    """Rows (H, 1) and columns (1, W) from the middle, in half diagonals."""
    down, right = ((np.arange(size) - size / 2) / (np.hypot(*shape) / 2) for size in shape)
    return down[:, None], right[None]


def flats(
    light: float = 0.6,
    lens: tuple[float, float] = (2.0, 0.15),
    surface: Over | None = None,
    focal: tuple[float | None, ...] = (None, None),
    pattern: CfaPattern = PATTERN,
    shape: tuple[int, int] = SHAPE,
    saturated: float = 0.0,
) -> list[tuple[str, Mosaic]]:
    """Flat frames of a surface whose light, of all or of each channel, is given over places from -1
    to 1, half the diagonal.

    saturated: share of the red samples that are clipped, the brightest ones.
    """
    light_at = np.ones(shape) if surface is None else surface(*places(shape))
    rgb = np.atleast_3d(light_at) * np.ones(3, np.float32)
    sensor = SensorCalibration.of_bits(12, headroom=False, shading=lens_shading(*lens, 4, shape))
    says, red, frames = replace(sensor, shading=None), pattern.filter_map(shape) == 0, []
    for seed, length in enumerate(focal):
        metadata, random = CaptureMetadata(focal_length=length), np.random.default_rng(seed)
        taken = simulate_sensor(rgb.astype(np.float32), pattern, sensor, light, random)
        codes = taken.codes.copy()
        codes[red & (codes > np.quantile(codes[red], 1 - saturated))] = 4095
        frames.append((f"flat{seed}.dng", Mosaic(codes, pattern, says, metadata)))
    return frames


@pytest.mark.parametrize(
    ("lens", "pattern"), [((2.0, 0.15), PATTERN), ((0.5, 0.05), KODAK), ((0.0, 0.2), PATTERN)]
)
def test_a_shading_is_measured(lens: tuple[float, float], pattern: CfaPattern) -> None:
    result = measure_shading(flats(lens=lens, focal=(50.0, 50.0), pattern=pattern))
    truth = lens_shading(*lens, 4, SHAPE)
    for plane in range(4):
        error = result.shading.of_plane(SHAPE, plane) / truth.of_plane(SHAPE, plane) - 1
        assert np.sqrt((error**2).mean()) < 0.005
        assert np.abs(error).max() < 6 * result.error
    assert result.shading.focal_length == 50
    assert result.shading.residual < 0.003


def test_even_frames_have_no_shading() -> None:
    # The latter are clipped, and do not count.
    found = measure_shading([*flats(lens=(0.0, 0.0)), *flats(3.0)])
    assert found.shading is None
    assert found.words.startswith("no shading: 2 flat frames, even to ±")


def falls_off(row: float, column: float) -> Over:
    return lambda down, right: 0.9 / (1 + (down - row) ** 2 + (right - column) ** 2) ** 2


def test_a_centre_a_little_off_the_middle_is_a_lens() -> None:
    """Over that falls off, red more and blue less."""

    def coloured(down: DoubleArray, right: DoubleArray) -> DoubleArray:
        square = ((down - 0.05) ** 2 + (right - 0.08) ** 2)[..., None]
        light = falls_off(0.05, 0.08)(down, right)[..., None]
        return np.asarray(light * (1 - np.array([0.15, 0.0, -0.15]) * square))

    assert measure_shading(flats(lens=(0.0, 0.0), surface=coloured)).shading is not None


def test_windows_full_of_listed_defects_do_not_count() -> None:
    def listing(down: int, right: int) -> list[tuple[str, Mosaic]]:
        places = tuple(product(range(down), range(right)))
        return [(name, stating(mosaic, defects=places)) for name, mosaic in flats()]

    shading = measure_shading(listing(45, 45)).shading
    assert shading.colour == pytest.approx(measure_shading(flats()).shading.colour, rel=0.05)
    assert np.isfinite(measure_flats(listing(150, 225)).points.mean).all()
    with pytest.raises(InputError, match="most of their windows are without samples of each"):
        measure_shading(listing(*SHAPE[:1], 400))


def test_frames_that_fall_off_differently_are_refused() -> None:
    wide, other = flats(), flats(light=0.5, lens=(1.0, 0.05))
    message = r"the light of (flat0|other)\.dng falls off in another way than that of all together"
    with pytest.raises(InputError, match=message):
        measure_shading([*wide, ("other.dng", other[0][1])])
    dim = flats(light=0.02)[0][1]  # counts little, and its black level may be wrong
    lifted = replace(dim, samples=dim.codes + np.uint16(4))
    assert measure_shading([*wide, ("dim.dng", lifted)]).frames == 3


def to_the_right(down: DoubleArray, right: DoubleArray) -> DoubleArray:
    return 1 + 0.09 * right + 0 * down


def test_light_that_is_a_little_tilted_does_less_harm_than_a_lens_that_is_not_corrected() -> None:
    surface: Over = lambda down, right: 1 + 0.03 * down + 0 * right  # noqa: E731
    assert measure_shading(flats(surface=surface)).shading is not None


def coloured(down: DoubleArray, right: DoubleArray) -> DoubleArray:
    return np.stack([1 + 0.05 * right, 1 - 0.05 * right, 1 + 0 * right], 2) + 0 * down[..., None]


def waves(down: DoubleArray, right: DoubleArray) -> DoubleArray:
    return np.asarray(1 + 0.05 * np.sin(20 * right) * np.cos(15 * down))


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ({"light": 3.0}, "all are clipped; flat[01].dng is least so, in .* samples of W; expose"),
        ({"saturated": 0.1}, "all are clipped; flat[01].dng is least so, in .* samples of R"),
        ({"light": 0.02}, "too dark, and tell the shading only to"),
        ({"light": 0.0003}, "dark"),
        ({"surface": lambda down, right: (right > -0.75) + 0 * down}, "cut masked borders off"),
        ({"surface": to_the_right}, r"the light is tilted: 1[3-7]\.. % brighter at the right"),
        ({"surface": coloured}, "the light is tilted in [RG], compared with W: [78].. % brighter"),
        ({"surface": falls_off(0.1, 0.28), "lens": (0, 0.1)}, "around a place that is 1[4-6] % of"),
        ({"surface": waves}, "in [RGBW] they differ by .* from any smooth"),
        ({"shape": (300, 84)}, "84 x 300 pixels do not tell it; along each side it takes 90"),
        ({"focal": (35.0, 50.0)}, "flat0.dng is taken at 35 mm, flat1.dng at 50 mm"),
    ],
)
def test_flats_that_do_not_tell_it_are_refused(frames: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"^flat frames: .*{words}"):
        measure_shading(flats(**frames))
