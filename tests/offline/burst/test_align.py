"""The motion that is found is the true one, whatever moves besides; and what cannot be aligned is
refused.
"""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panchroma.offline.burst import Motion
from panchroma.offline.burst import align as module
from panchroma.offline.burst.align import Alignment, View, align
from panchroma.shared.arrays import FloatArray
from panchroma.shared.calibration import NoiseModel
from tests.offline.burst.scenes import SHAPE, error, pixels, seen

BETWEEN = 0.03  # pixels: what linear interpolation and the share of moving things leave
NOISE, NONE = NoiseModel.gaussian(0.03, 4), NoiseModel.gaussian(0, 4)
REFERENCE = seen(Motion())
MOVED = Motion((1.3, -2.6), 0.004)


def noisy(plane: FloatArray, seed: int) -> FloatArray:
    return plane + np.random.default_rng(seed).normal(0, 0.03, plane.shape).astype(np.float32)


def aligned(
    reference: FloatArray, frame: FloatArray, noise: NoiseModel = NONE, limit: float = np.inf
) -> Alignment:
    found = align(View(reference, noise), View(frame, noise, limit))
    assert isinstance(found, Alignment), found
    return found


@pytest.mark.parametrize(
    "motion",
    [
        Motion(),
        Motion((0.5, 0.25)),
        MOVED,
        Motion((-12.0, 19.0)),
        Motion((4.0, 2.0), 0.035),
        Motion((-1.0, 0.7), -0.02),
    ],
)
def test_the_motion_of_the_camera_is_found(motion: Motion) -> None:
    found = aligned(REFERENCE, seen(motion))
    assert error(found.motion, motion).max() < BETWEEN
    assert found.motion.local is None
    assert found.gain == pytest.approx(1, abs=0.01)
    assert found.agreement > 0.98


@pytest.mark.parametrize("shape", [(61, 143), (144, 90), (211, 304)])
def test_frames_of_any_size(shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    # the largest is compared at half its size
    monkeypatch.setattr(module, "_LARGEST", 60_000)
    found = aligned(seen(Motion(), shape), seen(MOVED, shape))
    assert error(found.motion, MOVED, shape).max() < 2 * BETWEEN


@pytest.mark.parametrize("size", [3, 30])
def test_texture_of_any_size(size: int) -> None:
    """Small copies show next to none of the one, and fine differences none of the other."""
    random = np.random.default_rng(0)
    texture = gaussian_filter(random.normal(size=(1000, 1200)), size)
    scene = ((1 + 0.2 * texture / texture.std()) / 3).astype(np.float32)
    found = aligned(noisy(scene[:980, :1180], 0), noisy(scene[3:983, 6:1186], 1), NOISE)
    assert np.hypot(found.motion.shift[0] + 3, found.motion.shift[1] + 6) < 2 * BETWEEN


def test_what_moves_does_not_pull() -> None:
    reference, frame = REFERENCE.copy(), seen(MOVED)
    thing = seen(Motion(), seed=1)
    reference[40:110, 60:130] = thing[40:110, 60:130]
    frame[30:100, 70:140] = thing[40:110, 60:130]
    found = aligned(reference, frame)
    assert error(found.motion, MOVED).max() < 2 * BETWEEN
    assert 0.5 < found.agreement < 0.9


def test_opencv_has_the_threads_of_the_render_and_then_its_own_again(
    each_thread_count: Iterator[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    found, own = list[int](), cv2.getNumThreads()

    def interrupted(*_: Any) -> Any:
        found.append(cv2.getNumThreads())
        raise KeyboardInterrupt

    monkeypatch.setattr(cv2, "findTransformECC", interrupted)
    for _ in each_thread_count:
        cv2.setNumThreads(5)
        with pytest.raises(KeyboardInterrupt):
            align(View(REFERENCE), View(seen(MOVED)))
        found.append(cv2.getNumThreads())
        cv2.setNumThreads(own)
    assert found == [1, 5, 2, 5, 3, 5]


@pytest.mark.parametrize("gain", [4.0, 0.25])
def test_another_exposure(gain: float) -> None:
    frame = np.minimum(gain * seen(MOVED), 7)
    found = aligned(REFERENCE, frame, limit=7)
    assert found.gain == pytest.approx(gain, rel=0.01)
    assert error(found.motion, MOVED).max() < 3 * BETWEEN


def test_parallax() -> None:
    local = np.zeros((2, 41, 2), np.float32)
    local[:, :, 1] = 0.5 * np.tanh((20 - np.arange(41)) / 6)
    near = Motion(MOVED.shift, MOVED.angle, local)
    found = aligned(REFERENCE, seen(near))
    assert found.motion.local is not None
    assert np.median(error(found.motion, near)) < 0.05
    rigid = Motion(found.motion.shift, found.motion.angle)
    assert np.median(error(rigid, near)) > 0.3


FLAT, STRIPES = np.full(SHAPE, 1.5, np.float32), np.sin(pixels()[1] / 3).astype(np.float32) + 2
UNUSABLE = {
    "tiny": (REFERENCE[:4, :40], REFERENCE[:4, :40], "40 x 4 pixels are too few to be aligned"),
    "flat": (FLAT, FLAT, "too little texture"),
    "noise": (noisy(FLAT, 0), noisy(FLAT, 1), "too little texture"),
    "stripes": (noisy(STRIPES, 0), noisy(STRIPES, 1), "too little texture"),
    "dark": (0 * FLAT, 0 * FLAT, "too little texture"),
    "scene": (REFERENCE, seen(Motion(), seed=1), "another scene"),
}


@pytest.mark.parametrize(("reference", "frame", "why"), UNUSABLE.values(), ids=list(UNUSABLE))
def test_what_cannot_be_aligned_is_refused(
    reference: FloatArray, frame: FloatArray, why: str
) -> None:
    found = align(View(reference, NOISE), View(frame, NOISE))
    assert isinstance(found, str)
    assert why in found
