"""Shading from flat frames and aberration from edges: what they show, and which of them are refused."""

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
from tools.calibration.shading import measure_shading
from tools.camera.lens import lens_aberration, lens_shading
from tools.rendering.in_memory import filled_luminance

SHAPE, SHARP = (300, 450), (400, 600)  # of flat frames, and of shots with edges
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
    """Flat frames of a surface whose light, of all or of each channel, is given over places from -1 to 1, half the diagonal.

    saturated: share of the red samples that are clipped, the brightest ones.
    """
    light_at = np.ones(shape) if surface is None else surface(*places(shape))
    rgb = np.broadcast_to(light_at if light_at.ndim == 3 else light_at[..., None], (*shape, 3)).astype(np.float32)
    shading = lens_shading(*lens, 4, shape)
    sensor = SensorCalibration.of_bits(12, headroom=False, shading=shading)
    frames = []
    for seed, length in enumerate(focal):
        taken = simulate_sensor(rgb, pattern, sensor, light, np.random.default_rng(seed), CaptureMetadata(focal_length=length))
        codes = taken.codes.copy()
        red = pattern.filter_map(shape) == 0
        codes[red & (codes > np.quantile(codes[red], 1 - saturated))] = 4095
        frames.append((f"flat{seed}.dng", Mosaic(codes, pattern, replace(taken.calibration, shading=None), taken.metadata)))
    return frames


@pytest.mark.parametrize("lens", [(2.0, 0.15), (0.5, 0.05), (0.0, 0.2)])
@pytest.mark.parametrize("pattern", [PATTERN, KODAK])
def test_a_shading_is_measured(lens: tuple[float, float], pattern: CfaPattern) -> None:
    found = measure_shading(flats(lens=lens, focal=(50.0, 50.0), pattern=pattern))
    truth = lens_shading(*lens, 4, SHAPE)
    errors = [found.shading.of_plane(SHAPE, plane) / truth.of_plane(SHAPE, plane) - 1 for plane in range(4)]
    assert pattern.planes == "RGBW"
    assert max(float(np.sqrt((error**2).mean())) for error in errors) < 0.005
    assert max(float(np.abs(error).max()) for error in errors) < 6 * found.error
    assert found.shading.focal_length == 50
    assert found.shading.residual < 0.003


def test_even_frames_have_no_shading() -> None:
    found = measure_shading([*flats(lens=(0.0, 0.0)), *flats(3.0)])  # the latter are clipped, and do not count
    assert found.shading is None
    assert found.words.startswith("no shading: 2 flat frames, even to ±")


def falls_off(row: float, column: float) -> Over:
    return lambda down, right: 0.9 / (1 + (down - row) ** 2 + (right - column) ** 2) ** 2


def test_a_centre_a_little_off_the_middle_is_a_lens() -> None:
    """Over that falls off, red more and blue less."""

    def coloured(down: DoubleArray, right: DoubleArray) -> DoubleArray:
        square = ((down - 0.05) ** 2 + (right - 0.08) ** 2)[..., None]
        return np.asarray(falls_off(0.05, 0.08)(down, right)[..., None] * (1 - np.array([0.15, 0.0, -0.15]) * square))

    assert measure_shading(flats(lens=(0.0, 0.0), surface=coloured)).shading is not None


def test_frames_that_fall_off_differently_are_refused() -> None:
    wide, other = flats(), flats(light=0.5, lens=(1.0, 0.05))
    with pytest.raises(InputError, match=r"the light of (flat0|other)\.dng falls off in another way than that of all together"):
        measure_shading([*wide, ("other.dng", other[0][1])])
    dim = flats(light=0.02)[0][1]  # counts little, and its black level may be wrong
    assert measure_shading([*wide, ("dim.dng", replace(dim, samples=dim.codes + np.uint16(4)))]).frames == 3


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ({"light": 3.0}, "all are clipped; flat[01].dng is least so, in [0-9]+ % of the samples of W; expose less"),
        ({"saturated": 0.1}, "all are clipped; flat[01].dng is least so, in [0-9.]+ % of the samples of R; expose less"),
        ({"light": 0.02}, "too dark, and tell the shading only to"),
        ({"light": 0.0003}, "dark"),
        ({"surface": lambda y, x: 1 + 0.06 * x + 0 * y}, r"the light is tilted: (9|10|11)\.. % brighter at the right"),
        ({"surface": lambda y, x: 1 - 0.06 * y + 0 * x, "lens": (0, 0)}, "the light is tilted: .* at the top"),
        (
            {"surface": lambda y, x: np.stack([1 + 0.05 * x, 1 - 0.05 * x, 1 + 0 * x], 2) + 0 * y[..., None]},
            "the light is tilted in [RG], compared with W: [78].. % brighter at the (right|left)",
        ),
        ({"surface": falls_off(0.1, 0.28), "lens": (0, 0.1)}, "around a place that is 1[4-6] % of the diagonal off the middle"),
        ({"surface": lambda y, x: 1 + 0.05 * np.sin(20 * x) * np.cos(15 * y)}, "in [RGBW] they differ by .* from any smooth"),
        ({"shape": (300, 84)}, "84 x 300 pixels do not tell it; along each side it takes 90, 15 periods of the pattern"),
        ({"focal": (35.0, 50.0)}, "flat0.dng is taken at 35 mm, flat1.dng at 50 mm"),
    ],
)
def test_flats_that_do_not_tell_it_are_refused(frames: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"^flat frames: .*{words}"):
        measure_shading(flats(**frames))


@cache
def discs(seed: int, channels: int = 3) -> FloatArray:
    """A scene of many discs of any colour, one over the other."""
    rng = np.random.default_rng(seed)
    scene = np.full((*SHARP, channels), 0.3)
    for _ in range(500):
        (y, x), radius = rng.uniform((0, 0), SHARP), rng.uniform(4, 30)
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
    aberration = None if lens is None else lens_aberration(*lens, count, SHARP)
    sensor = SensorCalibration.of_bits(12, headroom=False, channels=pattern.channels, aberration=aberration)
    scene, noise, metadata = altered(discs(seed, count)), np.random.default_rng(seed), CaptureMetadata(focal_length=focal)
    taken = simulate_sensor(scene, pattern, sensor, light, noise, metadata)
    return stating(taken, aberration=None)


def aberration(*shots: Mosaic) -> AberrationResult:
    return measure_aberration([find_edges(f"{number}.dng", each, filled_luminance) for number, each in enumerate(shots)])


@pytest.mark.parametrize(("lens", "pattern"), [((1.0, -0.5), PATTERN), ((-0.6, 0.8), KODAK), ((4.0, -3.0), PATTERN)])
def test_an_aberration_is_measured(lens: tuple[float, float], pattern: CfaPattern) -> None:
    shots = [shot(0, lens, pattern, focal=35.0), *([] if pattern.is_scattered else [shot(1, lens, pattern)])]
    found = aberration(*shots)
    assert (found.aberration.size, found.aberration.focal_length) == (SHARP, 35)
    away = np.abs(found.corner - [lens[0], 0, lens[1]])
    assert (away <= 3 * found.error).all()
    assert away.max() < 0.2 + 0.1 * max(map(abs, lens))
    np.testing.assert_allclose(found.aberration.corner(SHARP), found.corner, atol=1e-3)
    assert found.words.startswith(f"lateral chromatic aberration: R {found.corner[0]:+.2f}, B {found.corner[2]:+.2f} pixels")
    radius, displacement, error = np.moveaxis(found.rings[3:7, 0], -1, 0)
    away = np.abs(displacement - lens[0] * (radius + radius**3) / 2)
    assert (away < 0.1 * abs(lens[0]) + 5 * error).all()


def test_shots_without_aberration_have_none() -> None:
    found = aberration(shot(0, None), shot(1, None))
    assert found.aberration is None
    assert np.abs(found.corner).max() < 3 * found.error.max() < 0.6
    assert found.words.startswith("no lateral chromatic aberration: known to ±0.")


def test_what_a_shot_says_of_itself_does_not_count() -> None:
    frames = shot(), stating(shot(), aberration=lens_aberration(-2, 1, 3, SHARP))
    first, second = (find_edges("0.dng", each, filled_luminance) for each in frames)
    np.testing.assert_array_equal(first.sample, second.sample)
    np.testing.assert_array_equal(first.luminance(first.down, first.right), second.luminance(first.down, first.right))


def test_four_channels() -> None:
    pattern = CfaPattern.with_block(("RG", "EB"), 6, channels="RGEB")
    found = aberration(shot(0, (1.2, -0.6), pattern), shot(1, (1.2, -0.6), pattern))
    assert (np.abs(found.corner - np.array([0.6, 0, -0.6, -1.2])) <= 3.5 * found.error).all()  # from G, not from E


def moved(down: Over, right: Over) -> Callable[[FloatArray], FloatArray]:
    """What displaces red by so many pixels, and blue as much the other way."""

    def altered(scene: FloatArray) -> FloatArray:
        y, x = np.broadcast_arrays(*places(SHARP))
        scene = scene.copy()
        for channel, sign in ((0, 1), (2, -1)):
            away = sign * np.stack([down(y, x), right(y, x)])
            scene[..., channel] = ndimage.map_coordinates(scene[..., channel], np.indices(SHARP) + away, order=3, mode="mirror")
        return scene

    return altered


def in_the_middle(scene: FloatArray) -> FloatArray:
    """A scene whose edges are all near the middle."""
    near = np.hypot(*places(SHARP)) < 0.45
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
        aberration(*(shot(seed, **{"lens": None, **frame}) for seed, frame in enumerate(frames)))


def test_frames_of_two_sizes_and_small_frames_are_refused() -> None:
    with pytest.raises(InputError, match=r"1\.dng has 600 x 360 pixels, 0\.dng 600 x 400: take all alike"):
        aberration(shot(0), replace(shot(1), samples=shot(1).codes[:360]))
    with pytest.raises(InputError, match="it has hardly any edges, or is too small"):
        aberration(replace(shot(), samples=shot().codes[:48, :60]))


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
