"""Displaced channels: equal to the reference, found where they are and nowhere else, and pictures better for it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from offline import BEST, measure, render
from offline.cleaned import Cleaned
from offline.measured import Fringes
from offline.parts import Part
from offline.rows.fringes import Displaced
from offline.settings import FringesSettings
from offline.whole import fringes as constants
from offline.whole.fringes import FoundFringes, find_fringes, registered_samples
from shared import CfaPattern, SensorCalibration
from shared.arrays import DoubleArray, FloatArray
from shared.sensor import simulate_additive
from tests.offline.scenes import CASES, cleaned, every_case, gamma_of, shot
from tests.reference import fringes as reference
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe

ASKED, OFF = FringesSettings(used=True), replace(BEST, fringes=FringesSettings())
SHIFTS = np.array([[0.3, -0.2, 0.1], [0.0, 0.1, -0.3], [-0.25, 0.2, 0.2], [0.1, 0.0, 0.0], [-0.1, -0.2, 0.3]])


def textured(shape: tuple[int, int], seed: int = 0) -> FloatArray:
    """A scene with many edges, of one brightness and of two colours, 0.1 to 1, (H, W, 3)."""
    random = np.random.default_rng(seed)
    light = gaussian_filter(random.normal(size=shape), 1.2)
    where = gaussian_filter(random.normal(size=shape), 12) > 0
    colours = np.where(where[..., None], (0.9, 0.6, 0.3), (0.4, 0.7, 0.6))
    return np.ascontiguousarray(colours * (0.55 + 0.4 * np.tanh(light / light.std()))[..., None], np.float32)


def seen_through(scene: FloatArray, fringes: Fringes) -> FloatArray:
    """The scene with displaced channels."""
    places = [(fringes.seen(0, np.arange(scene.shape[0]))[c], fringes.seen(1, np.arange(scene.shape[1]))[c]) for c in range(3)]
    planes = [
        map_coordinates(scene[..., channel], np.meshgrid(*place, indexing="ij"), mode="mirror")
        for channel, place in enumerate(places)
    ]
    return np.stack(planes, axis=2)


def found_in(scene: FloatArray, sigma: float) -> Fringes | None:
    mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), sigma, np.random.default_rng(1))
    return measure(mosaic).fringes


def exact(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None) -> tuple[Cleaned, DoubleArray, DoubleArray]:
    """A frame, its luminance up to a few percent, and its samples in float64."""
    mosaic = shot(pattern, shape, sigma)
    scene = np.random.default_rng(3).uniform(0.95, 1.05, shape)
    light = luminance_of(np.stack([mosaic.signal] * len(pattern.channels), axis=2).astype(np.float64), gamma_of(pattern))
    return cleaned(mosaic), gaussian_filter(light, 1.0) * scene + 0.1, mosaic.signal.astype(np.float64)


@every_case
def test_samples_without_fringes_equal_the_reference(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    frame, light, signal = exact(pattern, shape, 0.02)
    gamma, shifts = gamma_of(pattern), SHIFTS[: len(pattern.channels)]
    colour = np.random.default_rng(0).uniform(0.1, 0.5, (*frame.sites.shape, len(gamma)))
    found = FoundFringes(Fringes(shifts, shape), colour.astype(np.float32))
    actual = registered_samples(frame, light.astype(np.float32), found).signal
    assert_close(actual, reference.without(signal, light, pattern, gamma, colour, shifts), 1e-5)


@every_case
def test_a_picture_with_fringes_equals_the_reference_in_all_parts(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    gamma, random = gamma_of(pattern), np.random.default_rng(0)
    light, colour = random.uniform(0.5, 1.0, shape), random.uniform(0.2, 0.4, (*shape, len(gamma)))
    colour /= (colour @ np.array(gamma))[..., None]
    shifts = SHIFTS[: len(gamma)]
    stage = Displaced(Fringes(shifts, shape), np.array(gamma, np.float32))
    expected = reference.displaced(light, colour, gamma, shifts)
    reach, whole = stage.look.reach, Part(0, light.astype(np.float32), colour.astype(np.float32))
    for first in range(0, shape[0], 5):
        rows = first, min(first + 5, shape[0])
        part = stage(whole.rows(max(rows[0] - reach, 0), min(rows[1] + reach, shape[0])), rows)
        assert part.first == first
        assert np.array_equal(part.luminance, whole.rows(*rows).luminance)
        assert_close(part.chromaticity, expected[slice(*rows)], 1e-5)


@pytest.mark.parametrize(
    ("pattern", "sigma", "doubted", "believed"),
    [
        (CASES["odd"][0], 0.01, "_BELIEVED", 20.0),
        (CASES["one row"][0], None, "_BELIEVED", 20.0),
        (CfaPattern.with_block(("RGX", "YGB"), 6, (2, 3)), None, "_GAINS", 4.0),
        (CASES["scattered"][0], 0.01, "_GAINS", 4.0),
    ],
)
def test_what_is_found_equals_the_reference(
    pattern: CfaPattern, sigma: float | None, doubted: str, believed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(constants, "_SIDE", 3)  # as many tiles as a decision needs, of few blocks
    monkeypatch.setattr(constants, doubted, (0.0, believed))  # believed in part
    monkeypatch.setattr(constants, "_MANY", 10)
    shape = 13 * pattern.period + 3, 16 * pattern.period + 1
    gamma, noise = gamma_of(pattern), np.random.default_rng(1).normal(scale=sigma or 0, size=shape)
    scene = np.repeat(seen_through(textured(shape), Fringes(SHIFTS[:3], shape)), 2, axis=2)[..., : len(gamma)].astype(np.float64)
    mosaic = observe(scene, pattern, gamma, sigma, noise)
    light = luminance_of(scene, gamma)
    actual = find_fringes(cleaned(mosaic), light.astype(np.float32), ASKED)
    expected = reference.find(mosaic.signal.astype(np.float64), light, pattern, gamma, mosaic.calibration.noise)
    assert actual is not None
    assert expected is not None
    assert_close(actual.fringes.shifts, expected, 1e-3)


@pytest.mark.parametrize("sigma", [0.0, 0.01])
@pytest.mark.parametrize("shift", [(0.25, 0.25, 0.0), (-0.25, 0.25, 0.0), (0.0, 0.0, 0.8)])
def test_displaced_channels_are_found_and_the_picture_is_better_for_it(sigma: float, shift: tuple[float, ...]) -> None:
    shape, opposite = (240, 300), np.array([-np.array(shift), (0, 0, 0), shift])
    scene = seen_through(textured(shape), Fringes(opposite, shape))
    mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), sigma, np.random.default_rng(1))
    fringes = measure(mosaic).fringes
    assert fringes is not None
    assert_close(fringes.shifts - fringes.shifts[1], opposite, 0.1)
    with_them, without = (np.square(render(mosaic, settings).rgb - scene).mean() for settings in (BEST, OFF))
    assert with_them < 0.7 * without


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("seed", range(3))
def test_where_no_channel_is_displaced_nothing_is_found_and_no_bit_changes(sigma: float, seed: int) -> None:
    mosaic = simulate_additive(
        textured((200, 240), seed), CfaPattern.bayer(6), SensorCalibration(), sigma, np.random.default_rng(seed)
    )
    assert measure(mosaic).fringes is None
    assert np.array_equal(render(mosaic).rgb, render(mosaic, OFF).rgb)


@pytest.mark.parametrize("tile", ["K=3", "RGWW/BWWW/WWWW/WWWW", "RGWWWW/GBWWWW/WWWWWW/WWWBGW/WWWGRW/WWWWWW"])
def test_blocks_whose_luminance_is_not_equally_wrong_at_opposite_sites_tell_nothing(tile: str) -> None:
    shape, pattern = (240, 300), CfaPattern.of_letters(tile)
    scene = seen_through(textured(shape), Fringes(np.array([(-0.25, -0.25, 0), (0, 0, 0), (0.25, 0.25, 0)]), shape))
    mosaic = simulate_additive(scene, pattern, SensorCalibration(), 0.0, np.random.default_rng(1))
    assert measure(mosaic).fringes is None
    assert found_in(scene, 0.0) is not None


def test_even_light_and_grey_have_no_fringes() -> None:
    even, grey = np.full((200, 240, 3), 0.5, np.float32), np.repeat(textured((200, 240))[..., :1], 3, axis=2)
    for scene in (even, grey):
        for sigma in (0.0, 0.02):
            assert found_in(scene, sigma) is None


def test_clipped_blocks_tell_nothing_and_stay() -> None:
    """A frame whose blocks are all beside clipped samples has no fringes, whatever these look like."""
    shape = (240, 300)
    opposite = np.array([(-0.25, -0.25, 0), (0, 0, 0), (0.25, 0.25, 0)])
    scene = seen_through(textured(shape), Fringes(opposite, shape))
    mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), 0.0, np.random.default_rng(1))
    light = scene.sum(axis=2)
    found = find_fringes(Cleaned(mosaic, np.inf), light, ASKED)
    assert found is not None
    clipped = Cleaned(mosaic, 0.0)
    assert find_fringes(clipped, light, ASKED) is None
    assert np.array_equal(registered_samples(clipped, light, found).signal, mosaic.signal)
    assert not np.array_equal(registered_samples(Cleaned(mosaic, np.inf), light, found).signal, mosaic.signal)


def test_colours_that_are_none_stay() -> None:
    """Pixels below black, or whose channels cancel, keep their chromaticity."""
    random = np.random.default_rng(0)
    light, colour = random.uniform(-1, 0.5, (30, 40)).astype(np.float32), random.normal(size=(30, 40, 3)).astype(np.float32)
    stage = Displaced(Fringes(SHIFTS[:3], (30, 40)), np.ones(3, np.float32))
    after = stage(Part(0, light, colour), (0, 30)).chromaticity
    assert np.array_equal(after[light <= 0], colour[light <= 0])
    assert np.abs(after).max() <= 4 * np.abs(colour).max()


def test_threads_do_not_change_a_bit(each_thread_count: Iterator[int]) -> None:
    shape = (120, 150)
    scene = seen_through(textured(shape), Fringes(np.array([(-0.25, 0.2, 0.1), (0, 0, 0), (0.25, -0.2, 0)]), shape))
    mosaic = simulate_additive(scene, CfaPattern.bayer(4), SensorCalibration(), 0.01, np.random.default_rng(1))
    assert measure(mosaic).fringes is not None
    assert len({render(mosaic).rgb.tobytes() for _ in each_thread_count}) == 1
