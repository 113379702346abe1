"""Which frames of a burst are copies, and that they count once."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from offline.burst import copies, merge_burst
from shared import CfaPattern, Mosaic, SensorCalibration

SHAPE, PATTERN, CAMERA = (150, 132), CfaPattern.bayer(6), SensorCalibration.of_bits(12)


def shot(seed: int, sigma: float = 20.0) -> Mosaic:
    """A static scene with texture, and noise of `sigma` codes."""
    y, x = np.indices(SHAPE)
    light = 1500 + 300 * np.sin(x / 3) * np.cos(y / 4)
    codes = np.rint(light + np.random.default_rng(seed).normal(0, sigma, SHAPE)).astype(np.uint16)
    return Mosaic(codes, PATTERN, CAMERA)


def renamed(mosaic: Mosaic) -> Mosaic:
    levels = replace(mosaic.calibration, sensor="other", black_level=(200.0,) * 4, white_level=4000)
    return replace(mosaic, calibration=levels)


@pytest.mark.parametrize("change", [lambda same: same, renamed])
def test_a_copy_counts_once(change: Callable[[Mosaic], Mosaic]) -> None:
    frames = [shot(1), shot(2), change(shot(1)), change(shot(2))]
    assert copies(frames) == {2: 0, 3: 1}
    assert copies(frames, 2) == {0: 2, 3: 1}
    merged = merge_burst(frames, reference=3)
    assert merged.reference == 3
    assert [frame.used for frame in merged.frames] == [True, False, False, True]
    assert [frame.reason for frame in merged.frames[1:3]] == [
        f"is a copy of frames[{index}]: its samples are the same" for index in (3, 0)
    ]
    assert (merged.shares > 0.4).all()


def test_only_copies_leave_one_frame() -> None:
    merged = merge_burst([shot(1)] * 4)
    assert (merged.reference, [frame.used for frame in merged.frames]) == (0, [True, False, False, False])
    assert (merged.shares == 1).all()


def test_a_static_scene_without_noise_is_one_frame() -> None:
    assert copies([shot(1, 0.0), shot(2, 0.0)]) == {1: 0}


@pytest.mark.parametrize("sigma", [0.1, 0.3, 1.0, 20.0])
def test_frames_with_noise_of_their_own_are_no_copies(sigma: float) -> None:
    assert copies([shot(1, sigma), shot(2, sigma)]) == {}


def test_black_around_what_moves_makes_no_copies() -> None:
    frames = []
    for column in (20, 40, 60):
        codes = np.full(SHAPE, 256, np.uint16)
        codes[71:73, column : column + 2] = 3000
        frames.append(Mosaic(codes, PATTERN, CAMERA))
    assert copies(frames) == {}
    assert copies([frames[0], *frames]) == {1: 0}


def test_what_cannot_be_compared_is_no_copy() -> None:
    one = shot(1)
    other = replace(one, pattern=CfaPattern.bayer(6, "GRBG"))
    assert copies([one, other, replace(one, samples=one.codes[:60])]) == {}
    assert copies([]) == {}
