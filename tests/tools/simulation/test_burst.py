"""The frames of a burst: what each sees, and that the truth about them is true."""

import numpy as np
import pytest

from panchroma.offline import burst as merged
from panchroma.shared import CaptureMetadata, DoubleArray, InputError
from panchroma.tools.simulation.simulated_camera import (
    CameraMotion,
    SimulatedBurst,
    burst_frames,
    tremor,
)

HAND = SimulatedBurst(5, pixels=3, degrees=0.3)
ACCURATE = 0.03  # of waves up to 0.7 of the highest frequency, whose sum is between 0 and 2


def random(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_hand_stays_within_the_limits_and_moves_by_parts_of_a_pixel() -> None:
    walk = tremor(SimulatedBurst(200, pixels=3, degrees=0.3), random())
    assert walk[0] == CameraMotion()
    shifts, angles = (np.array(values) for values in zip(*walk, strict=True))
    assert 2.5 < np.hypot(*shifts.T).max() <= 3
    assert 0.25 < np.degrees(np.abs(angles).max()) <= 0.3
    # every sixteenth of a pixel is met
    assert np.unique((shifts % 1 * 4).astype(int), axis=0).shape[0] == 16
    shift, same, other = (tremor(HAND, random(seed))[1].shift for seed in (0, 0, 1))
    assert shift == same != other


def waves(points: DoubleArray) -> DoubleArray:
    """A band-limited scene at any points (..., 2)."""
    rng, light = random(5), np.ones(points.shape[:-1])
    for _ in range(12):
        frequency, phase = rng.uniform(-0.35, 0.35, 2), rng.uniform(0, 2 * np.pi)
        light += np.cos(2 * np.pi * (points @ frequency) + phase) / 12
    return light


@pytest.mark.parametrize("pixel", [1, 2])
def test_a_frame_sees_the_scene_where_its_motion_says(pixel: int) -> None:
    """A ramp of light, 1 per row in one channel and per column in the other, says of each pixel
    where it is in the scene; in the third, waves say whether what is fine is kept. The reference
    sees the middle, as it is.
    """
    scene = np.moveaxis(np.mgrid[:300, :321, :3].astype(np.float32)[..., 0], 0, -1)
    scene[..., 2] = waves(scene[..., :2].astype(np.float64))
    frames = list(burst_frames(scene, HAND, random(), pixel))
    reference = frames[0].rgb
    start, end = reference[0, 0, :2], reference[-1, -1, :2]
    assert (start + end).tolist() == [299, 320 if pixel == 1 else 319]
    assert 0 < start.min() < 45
    for frame in frames:
        shape = frame.rgb.shape
        assert shape == reference.shape
        down, across = np.indices((shape[0], shape[1]), np.float32)
        # what its pixels see
        at = merged.in_reference(merged.Motion(*frame.motion), down, across, shape[:2])
        expected = start + pixel * np.moveaxis(at, 0, -1)
        np.testing.assert_allclose(frame.rgb[..., :2], expected, atol=0.01 * pixel)
        if pixel == 1:
            fine = waves(expected.astype(np.float64))
            np.testing.assert_allclose(frame.rgb[..., 2], fine, atol=ACCURATE)


def test_a_bracket_states_its_exposures() -> None:
    even = np.full((60, 60, 3), 0.5, np.float32)
    frames = list(burst_frames(even, SimulatedBurst(3, stops=(0, -2, 1)), random()))
    assert [frame.exposure for frame in frames] == [1, 0.25, 2]
    scene = CaptureMetadata(exposure_time=0.01, zone="+01:00")
    assert [frame.metadata(scene).exposure_time for frame in frames] == [0.01, 0.0025, 0.02]
    assert frames[0].metadata(scene).zone == scene.zone
    unknown = [frame.metadata(CaptureMetadata()).exposure_time for frame in frames]
    assert unknown == [1 / 60, 1 / 240, 1 / 30]
    assert next(burst_frames(even, SimulatedBurst(1), random())).metadata(scene) is scene


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"frames": 0}, "`burst` is 0"),
        ({"pixels": np.nan}, "`motion` is nan"),
        ({"stops": (0, 1)}, "`bracket` has 2 figures for 3 frames"),
        ({"stops": (0, 1, 99)}, "expected -10 to 10"),
        ({"stops": (0, 1, np.nan)}, "expected -10 to 10"),
    ],
)
def test_bursts_that_there_are_not(figures: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        SimulatedBurst(**{"frames": 3, **figures})  # type: ignore[arg-type]
