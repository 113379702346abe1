"""Copies among the frames of a burst, their noise, and the choice of the reference."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER
from panchroma.offline.burst import merge_burst
from panchroma.offline.burst.align import View
from panchroma.offline.burst.select import candidates_of, copies
from panchroma.offline.stages.noise import noise_models
from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, NoiseModel, SensorCalibration

SHAPE, PATTERN, CAMERA = (150, 132), CfaPattern.bayer(6), SensorCalibration.of_bits(12)


def shot(seed: int, sigma: float = 20.0) -> Mosaic:
    """A static scene with texture, and noise of `sigma` codes."""
    y, x = np.indices(SHAPE)
    light = 1500 + 300 * np.sin(x / 3) * np.cos(y / 4)
    codes = np.rint(light + np.random.default_rng(seed).normal(0, sigma, SHAPE)).astype(np.uint16)
    return Mosaic(codes, PATTERN, CAMERA)


def test_a_copy_counts_once() -> None:
    levels = replace(CAMERA, sensor="other", black_level=(200.0,) * 4, white_level=4000)
    frames = [shot(1), shot(2), replace(shot(1), calibration=levels), shot(2)]
    assert copies(frames) == {2: 0, 3: 1}
    assert copies(frames, 2) == {0: 2, 3: 1}
    merged = merge_burst(frames, reference=3)
    assert merged.reference == 3
    assert [frame.used for frame in merged.frames] == [True, False, False, True]
    assert [frame.reason for frame in merged.frames[1:3]] == [
        f"is a copy of frames[{index}]: its samples are the same" for index in (3, 0)
    ]
    assert (merged.noise_ratio > 0.4).all()


def test_what_cannot_be_compared_is_no_copy() -> None:
    one = shot(1)
    other = replace(one, pattern=CfaPattern.bayer(6, "GRBG"))
    for frames in ([one, other, replace(one, samples=one.codes[:60])], [shot(1), shot(2)], []):
        assert copies(frames) == {}


WIDE = (300, 420)


def model(shot: float, read: float) -> NoiseModel:
    return NoiseModel((shot,) * 4, (read,) * 4)


def frame(
    seed: int, sigma: float, noise: NoiseModel | None = None, iso: int | None = None
) -> Mosaic:
    """A gradient from black to white, and noise."""
    light = np.linspace(0, 2.5, WIDE[1]) + np.random.default_rng(seed).normal(0, sigma, WIDE)
    codes = Mosaic(light.astype(np.float32), PATTERN, CAMERA).codes
    return Mosaic(codes, PATTERN, replace(CAMERA, noise=noise), CaptureMetadata(iso=iso))


def sigmas(*frames: Mosaic, light: float = 1.0) -> list[float]:
    return [noise.sigma(light) if noise else np.nan for noise in noise_models(frames, BEST.noise)]


@pytest.mark.parametrize("second", [0.02, 0.0], ids=["alike", "one that seems free of noise"])
def test_frames_without_a_calibration_share_one_estimate(second: float) -> None:
    estimates = sigmas(frame(1, 0.02), frame(2, second), frame(3, 0.02))
    assert estimates == pytest.approx([0.02] * 3, rel=0.1)
    assert len(set(estimates)) == 1


def test_frames_of_other_sensitivities_have_their_own_noise() -> None:
    frames = [frame(1, 0.02, iso=400), frame(2, 0.05, iso=3200), frame(3, 0.02, iso=400)]
    assert sigmas(*frames) == pytest.approx([0.02, 0.05, 0.02], rel=0.1)


def test_a_frame_that_is_said_to_be_free_of_noise_does_not_speak_for_those_that_say_nothing() -> (
    None
):
    found = sigmas(frame(1, 0.02, model(0, 0)), frame(2, 0.02), frame(3, 0.02))
    assert found == pytest.approx([0.02] * 3, rel=0.1)
    assert sigmas(frame(1, 0.02, model(0, 0)), frame(2, 0.02, model(0, 0))) == [0, 0]


@pytest.mark.parametrize("odd", [model(0, 0), model(1e-4, 0), model(0, 1e-9)])
def test_a_variance_is_never_0_beside_others(odd: NoiseModel) -> None:
    known = model(2e-4, 0.02)
    frames = [frame(1, 0.02, known), frame(2, 0.02, odd), frame(3, 0.02, known)]
    for light in (-0.1, 0.0, 0.5):
        noisy, quiet, _ = sigmas(*frames, light=light)
        assert noisy == pytest.approx(known.sigma(light), rel=1e-3)  # and rounding
        assert quiet >= noisy / 4 * 0.999


def test_rounding_is_noise_where_there_is_any() -> None:
    (found,) = noise_models([frame(1, 0.0, model(1e-4, 0.0))], BEST.noise)
    assert found.read == pytest.approx(tuple(CAMERA.scale() / 12**0.5))
    none = model(0, 0)
    assert noise_models([frame(1, 0.0, none)] * 2, BEST.noise) == [none, none]
    assert noise_models([frame(1, 0.0)] * 2, PAPER.noise) == [None, None]


def candidate(detail: float, level: float = 1.0) -> View:
    """A frame of a random texture."""
    texture = np.random.default_rng(0).normal(0, 0.1, (64, 96))
    light = (level * (1 + detail * texture)).astype(np.float32)
    return View(light, limit=2.0)


def test_the_first_of_frames_that_are_nearly_as_sharp_is_the_reference() -> None:
    assert candidates_of([candidate(detail) for detail in (0.98, 1.0, 0.99)])[0] == 0
    assert candidates_of([candidate(detail) for detail in (0.9, 0.98, 1.0, 0.99)]) == [1, 2, 3, 0]
    assert candidates_of([candidate(0.98), candidate(1.0, level=2.5)]) == [0, 1]  # clipped
    assert candidates_of([candidate(0.1), candidate(1.0), candidate(1.0)]) == [1, 2, 0]
