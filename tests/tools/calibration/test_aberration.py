"""Lateral chromatic aberration from edges: what they show, and which shots are refused."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError
from shared.sensor import simulate_sensor
from tests.tools.calibration.known_camera import stating
from tools.calibration.aberration import AberrationResult, measure_aberration
from tools.calibration.edges import fill_along_edges, find_edges
from tools.camera.lens import lens_aberration
from tools.rendering.in_memory import filled_luminance

SHAPE = (400, 600)
PATTERN, KODAK = CfaPattern.bayer(6), CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW")
Field = Callable[[DoubleArray, DoubleArray], DoubleArray]


@cache
def discs(seed: int, channels: int = 3) -> FloatArray:
    """A scene of many discs of any colour, one over the other."""
    rng = np.random.default_rng(seed)
    scene = np.full((*SHAPE, channels), 0.3)
    for _ in range(500):
        (y, x), radius = rng.uniform((0, 0), SHAPE), rng.uniform(4, 30)
        top, left = max(int(y - radius) - 1, 0), max(int(x - radius) - 1, 0)
        window = np.s_[top : int(y + radius) + 3, left : int(x + radius) + 3]
        down, right = np.mgrid[: scene[window].shape[0], : scene[window].shape[1]]
        inside = (radius - np.hypot(down + top - y, right + left - x)).clip(-0.5, 0.5)[..., None] + 0.5
        colour = rng.uniform(0.1, 0.9) * rng.uniform(0.6, 1.0, channels)
        scene[window] += inside * (colour - scene[window])
    return ndimage.gaussian_filter(scene, (0.6, 0.6, 0)).astype(np.float32)


def shot(
    seed: int = 0,
    lens: tuple[float, float] | None = (1.0, -0.5),
    pattern: CfaPattern = PATTERN,
    light: float = 1.0,
    altered: Callable[[FloatArray], FloatArray] = lambda scene: scene,
    focal: float | None = None,
) -> Mosaic:
    """A shot whose calibration does not know the lens."""
    count = len(pattern.channels)
    aberration = None if lens is None else lens_aberration(*lens, count, SHAPE)
    sensor = SensorCalibration.of_bits(12, headroom=False, channels=pattern.channels, aberration=aberration)
    scene, noise, metadata = altered(discs(seed, count)), np.random.default_rng(seed), CaptureMetadata(focal_length=focal)
    taken = simulate_sensor(scene, pattern, sensor, light, noise, metadata)
    return stating(taken, aberration=None)


def measured(*shots: Mosaic) -> AberrationResult:
    return measure_aberration([find_edges(f"{number}.dng", each, filled_luminance) for number, each in enumerate(shots)])


@pytest.mark.parametrize(("lens", "pattern"), [((1.0, -0.5), PATTERN), ((-0.6, 0.8), KODAK), ((4.0, -3.0), PATTERN)])
def test_a_lens_is_measured(lens: tuple[float, float], pattern: CfaPattern) -> None:
    shots = [shot(0, lens, pattern, focal=35.0), *([] if pattern.is_scattered else [shot(1, lens, pattern)])]
    found = measured(*shots)
    assert (found.aberration.size, found.aberration.focal_length) == (SHAPE, 35)
    away = np.abs(found.corner - [lens[0], 0, lens[1]])
    assert (away <= 3 * found.error).all()
    assert away.max() < 0.2 + 0.1 * max(map(abs, lens))
    np.testing.assert_allclose(found.aberration.corner(SHAPE), found.corner, atol=1e-3)
    assert found.words.startswith(f"lateral chromatic aberration: R {found.corner[0]:+.2f}, B {found.corner[2]:+.2f} pixels")
    radius, displacement, error = np.moveaxis(found.rings[3:7, 0], -1, 0)
    away = np.abs(displacement - lens[0] * (radius + radius**3) / 2)
    assert (away < 0.1 * abs(lens[0]) + 5 * error).all()


def test_shots_without_it_have_none() -> None:
    found = measured(shot(0, None), shot(1, None))
    assert found.aberration is None
    assert np.abs(found.corner).max() < 3 * found.error.max() < 0.6
    assert found.words.startswith("no lateral chromatic aberration: known to ±0.")


def test_what_a_shot_says_of_itself_does_not_count() -> None:
    frames = shot(), stating(shot(), aberration=lens_aberration(-2, 1, 3, SHAPE))
    first, second = (find_edges("0.dng", each, filled_luminance) for each in frames)
    np.testing.assert_array_equal(first.sample, second.sample)
    np.testing.assert_array_equal(first.luminance(first.down, first.right), second.luminance(first.down, first.right))


def test_four_channels() -> None:
    pattern = CfaPattern.with_block(("RG", "EB"), 6, channels="RGEB")
    found = measured(shot(0, (1.2, -0.6), pattern), shot(1, (1.2, -0.6), pattern))
    assert (np.abs(found.corner - np.array([0.6, 0, -0.6, -1.2])) <= 3.5 * found.error).all()  # from G, not from E


def moved(down: Field, right: Field) -> Callable[[FloatArray], FloatArray]:
    """What displaces red by so many pixels, and blue as much the other way; places are in half diagonals."""

    def altered(scene: FloatArray) -> FloatArray:
        places = np.indices(SHAPE).astype(float)
        y, x = (each - (length - 1) / 2 for each, length in zip(places, SHAPE, strict=True))
        half = np.hypot(*SHAPE) / 2
        scene = scene.copy()
        for channel, sign in ((0, 1), (2, -1)):
            away = sign * np.stack([down(y / half, x / half), right(y / half, x / half)])
            scene[..., channel] = ndimage.map_coordinates(scene[..., channel], places + away, order=3, mode="mirror")
        return scene

    return altered


def in_the_middle(scene: FloatArray) -> FloatArray:
    """A scene whose edges are all near the middle."""
    y, x = (each - (length - 1) / 2 for each, length in zip(np.indices(SHAPE), SHAPE, strict=True))
    near = np.hypot(y, x) < 0.45 * np.hypot(*SHAPE) / 2
    return np.where(near[..., None], scene, scene.mean(axis=(0, 1))).astype(np.float32)


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([{"altered": in_the_middle}], "hardly any edges are farther from the middle than 60 % of half the diagonal"),
        ([{"lens": None, "light": 0.1}], "shots with edges: they tell the displacement in the corners, 0."),
        ([{"altered": moved(lambda y, x: 0 * y, lambda y, x: 0 * x + 0.9)}], "a colour is displaced by 0."),
        ([{"altered": moved(lambda y, x: -1.5 * x, lambda y, x: 1.5 * y)}], "and turned by 1."),
        ([{"lens": (2.0, -1.5)}] * 2 + [{"lens": (-2.0, 1.5)}], ".dng shows a displacement in the corners that is "),
        ([{"focal": 35.0}, {"focal": 50.0}], "is taken at 35 mm, 1.dng at 50 mm; take all at one focal length"),
        ([{"light": 9.0}], "of the frame have clipped samples; expose less"),
        ([{"light": 1e-3}], "it is dark; expose more"),
        ([{"altered": lambda scene: 0 * scene + 0.4}], "it has hardly any edges, or is too small"),
    ],
)
def test_what_edges_do_not_tell_is_refused(frames: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        measured(*(shot(seed, **{"lens": None, **frame}) for seed, frame in enumerate(frames)))


def test_frames_of_two_sizes_and_small_frames_are_refused() -> None:
    with pytest.raises(InputError, match=r"1\.dng has 600 x 360 pixels, 0\.dng 600 x 400: take all alike"):
        measured(shot(0), replace(shot(1), samples=shot(1).codes[:360]))
    with pytest.raises(InputError, match="it has hardly any edges, or is too small"):
        measured(replace(shot(), samples=shot().codes[:48, :60]))


@pytest.mark.parametrize("degrees", [0, 90, 20])
def test_holes_are_filled_along_straight_edges(degrees: float) -> None:
    y, x = np.mgrid[:46, :46] - 22.5
    across = np.cos(np.radians(degrees)) * x + np.sin(np.radians(degrees)) * y
    edge = (0.5 + 0.4 * np.tanh(across / 1.2)).astype(np.float32)
    holes = ~PATTERN.panchromatic_mask(edge.shape, (2, 3))
    damaged = np.where(holes, ndimage.uniform_filter(edge, 5), edge)[None]
    inner = np.s_[0, 4:-4, 4:-4]
    before, after = (float(np.abs(each[inner] - edge[4:-4, 4:-4]).max()) for each in (damaged, fill_along_edges(damaged, holes)))
    assert after < 0.1 * before
