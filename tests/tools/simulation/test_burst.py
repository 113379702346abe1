"""The frames of a burst: what each sees, and that the truth about them is true."""

import numpy as np
import pytest

from panchroma.offline import burst as merged
from panchroma.shared import CaptureMetadata, DoubleArray, FloatArray, InputError
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.simulated_camera import (
    CameraMotion,
    SimulatedBurst,
    burst_frames,
    displaced,
    reach,
    reduced,
    tremor,
)

HAND = SimulatedBurst(5, pixels=3, degrees=0.3)


def random(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def leaves() -> FloatArray:
    return builtin_scene(240, 200).rgb


def test_a_hand_stays_within_the_limits_and_moves_by_parts_of_a_pixel() -> None:
    walk = tremor(SimulatedBurst(200, pixels=3, degrees=0.3), random())
    assert walk[0] == CameraMotion()
    shifts, angles = (np.array(values) for values in zip(*walk, strict=True))
    lengths = np.hypot(*shifts.T)
    assert 2.5 < lengths.max() <= 3
    assert 0.25 < np.degrees(np.abs(angles).max()) <= 0.3
    # every sixteenth of a pixel is met
    assert np.unique((shifts % 1 * 4).astype(int), axis=0).shape[0] == 16
    shift, same, other = (tremor(HAND, random(seed))[1].shift for seed in (0, 0, 1))
    assert shift == same != other


def test_the_reference_is_a_part_of_the_scene(leaves: FloatArray) -> None:
    reference = next(burst_frames(leaves, HAND, random()))
    rows, columns = reference.rgb.shape[:2]
    top, left = (200 - rows) // 2, (240 - columns) // 2
    assert top == left < 45
    assert np.array_equal(reference.rgb, leaves[top : top + rows, left : left + columns])


@pytest.mark.parametrize("pixel", [1, 2])
def test_a_frame_sees_the_scene_where_its_motion_says(pixel: int) -> None:
    """A ramp of light, 1 per row in one channel and per column in the other, says of each pixel
    where it is in the scene.
    """
    ramp = np.zeros((300, 321, 3), np.float32)
    ramp[..., 0], ramp[..., 1] = np.mgrid[:300, :321]
    frames = list(burst_frames(ramp, HAND, random(), pixel))
    reference = frames[0].rgb
    for frame in frames:
        shape = frame.rgb.shape
        assert shape == reference.shape
        down, across = np.indices((shape[0], shape[1]), np.float32)
        # what its pixels see
        at = merged.in_reference(merged.Motion(*frame.motion), down, across, shape[:2])
        expected = reference[0, 0, :2] + pixel * np.moveaxis(at, 0, -1)
        np.testing.assert_allclose(frame.rgb[..., :2], expected, atol=0.01 * pixel)


def test_larger_pixels_are_means(leaves: FloatArray) -> None:
    for pixel in (1, 2, 3):
        means = reduced(leaves, pixel)
        rows, columns = 200 // pixel, 240 // pixel
        blocks = leaves[: rows * pixel, : columns * pixel].reshape(rows, pixel, columns, pixel, 3)
        np.testing.assert_allclose(means, blocks.mean(axis=(1, 3)), rtol=1e-5)
    message = "of a scene of 240 x 200 pixels nothing is left; take a larger .* `reduce`"
    with pytest.raises(InputError, match=message):
        next(burst_frames(leaves, SimulatedBurst(1), random(), 201))


def test_a_bracket_states_its_exposures(leaves: FloatArray) -> None:
    frames = list(burst_frames(leaves, SimulatedBurst(3, stops=(0, -2, 1)), random()))
    assert [frame.exposure for frame in frames] == [1, 0.25, 2]
    scene = CaptureMetadata(exposure_time=0.01, zone="+01:00")
    assert [frame.metadata(scene).exposure_time for frame in frames] == [0.01, 0.0025, 0.02]
    assert frames[0].metadata(scene).zone == scene.zone
    unknown = [frame.metadata(CaptureMetadata()).exposure_time for frame in frames]
    assert unknown == [1 / 60, 1 / 240, 1 / 30]
    assert next(burst_frames(leaves, SimulatedBurst(1), random())).metadata(scene) is scene


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"frames": 0}, "`burst` is 0"),
        ({"pixels": -1}, "`motion` is -1 pixels"),
        ({"pixels": np.nan}, "`motion` is nan"),
        ({"stops": (0, 1)}, "`bracket` has 2 figures for 3 frames"),
        ({"stops": (0, 1, 99)}, "expected -10 to 10"),
        ({"stops": (0, 1, np.nan)}, "expected -10 to 10"),
    ],
)
def test_bursts_that_there_are_not(figures: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        SimulatedBurst(**{"frames": 3, **figures})  # type: ignore[arg-type]


# --- a camera that has moved ---------------------------------------------------------------------

SHAPE = (150, 171)
ACCURATE = 0.03  # of waves up to 0.7 of the highest frequency, whose sum is between 0 and 2


def waves(points: DoubleArray) -> FloatArray:
    """A band-limited scene at any points (..., 2), in two channels."""
    rng = np.random.default_rng(5)
    light = np.ones((*points.shape[:-1], 2))
    for _ in range(12):
        frequency, phase = rng.uniform(-0.35, 0.35, 2), rng.uniform(0, 2 * np.pi, 2)
        light += np.cos(2 * np.pi * (points @ frequency)[..., None] + phase) / 12
    return light.astype(np.float32)


def grid(shape: tuple[int, int]) -> DoubleArray:
    return np.moveaxis(np.indices(shape, dtype=float), 0, -1)


def moved(down: float, across: float, degrees: float = 0.0) -> CameraMotion:
    return CameraMotion((down, across), -np.radians(degrees))


@pytest.mark.parametrize(
    "motion",
    [moved(0.5, 0), moved(2.3, -1.6), moved(-0.25, 3.75, 0.3), moved(1.1, 0.4, -5), moved(0, 0, 9)],
)
def test_a_displaced_scene_is_the_scene_at_the_displaced_points(motion: CameraMotion) -> None:
    border = reach(motion, SHAPE)
    inside = (slice(border, -border), slice(border, -border))
    seen = displaced(waves(grid(SHAPE)), motion)
    # The points of the reference that the pixels of the frame see.
    down, across = np.indices(SHAPE, np.float32)
    places = merged.in_reference(merged.Motion(*motion), down, across, SHAPE)
    points: DoubleArray = np.moveaxis(places, 0, -1).astype(np.float64)
    assert seen.dtype == np.float32
    assert np.abs(seen - waves(points))[inside].max() < ACCURATE
    assert np.abs(seen - waves(grid(SHAPE)))[inside].max() > ACCURATE
