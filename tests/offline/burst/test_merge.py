"""Luminance of a burst: what it keeps, gains and never does."""

from collections.abc import Sequence

import numpy as np
import pytest

from panchroma.offline.burst import Motion, in_reference
from panchroma.offline.burst.align import View
from panchroma.offline.burst.merge import merge_luminance
from panchroma.offline.burst.select import Kept
from panchroma.offline.frame import Sites
from panchroma.shared import ByteArray, CfaPattern, DoubleArray, FloatArray, NoiseModel
from tests.offline.burst.scenes import luminance_at, pixels, seen
from tests.reference.compare import assert_close

FLOAT32 = 2e-5
SLOPE = 1e-3  # local shifts are inverted in a few rounds, and interpolated
SHAPE, PATTERN = (26, 34), CfaPattern.bayer(6)
SHIFTS = np.linspace(-0.4, 0.5, 24, dtype=np.float32).reshape(3, 4, 2)
MOTIONS = [Motion(), Motion((0.6, -1.3), 0.01), Motion((-2.2, 0.4), -0.02, SHIFTS)]


def slope(y: DoubleArray, x: DoubleArray) -> DoubleArray:
    return 1 + 0.02 * y - 0.01 * x


def burst(sigma: float, shape: tuple[int, int], motions: list[Motion]) -> FloatArray:
    noise = np.random.default_rng(0).normal(0, sigma, (len(motions), *shape))
    return np.array([seen(motion, shape) for motion in motions]) + noise.astype(np.float32)


def merged(
    planes: FloatArray,
    agreement: ByteArray | None = None,
    noise: Sequence[tuple[float, float]] = ((0, 0),) * 8,
    motions: list[Motion] = MOTIONS,
) -> tuple[FloatArray, FloatArray]:
    """Luminance at every half pixel, and the ratio of its noise; all frames agree, by default."""
    agreement = np.full(planes.shape, 255, np.uint8) if agreement is None else agreement
    models = [NoiseModel((shot,), (read,)) for shot, read in noise]
    views = map(View, planes, models)
    kept = [Kept(*each) for each in zip(views, motions, agreement, strict=True)]
    shape = planes.shape[1], planes.shape[2]
    return merge_luminance(kept, Sites(PATTERN, PATTERN.grid(shape)))


@pytest.mark.parametrize("noise", [[(0, 0)] * 3, [(1e-3, 0.02), (2e-3, 0.01), (0, 0.03)]])
def test_a_slope_stays_a_slope_whatever_frames_agree(noise: list[tuple[float, float]]) -> None:
    places = (in_reference(motion, *pixels(SHAPE), SHAPE) for motion in MOTIONS)
    planes = np.array([slope(down, across) for down, across in places], np.float32)
    levels, random = np.array([0, 60, 255], np.uint8), np.random.default_rng(1)
    agreement = random.choice(levels, planes.shape, p=[0.1, 0.2, 0.7])
    agreement[0] = 255
    fine, noise_ratio = merged(planes, agreement, noise)
    inside = np.s_[12:-12, 12:-12]
    assert_close(fine[inside], slope(*np.indices(fine.shape) / 2)[inside], SLOPE)
    assert ((noise_ratio > 0) & (noise_ratio <= 1)).all()


def test_the_noise_of_frames_that_agree_is_averaged() -> None:
    planes = np.ones((4, *SHAPE), np.float32)
    _, noise_ratio = merged(planes, noise=[(1e-3, 0.03)] * 4, motions=[Motion()] * 4)
    assert_close(noise_ratio, np.full(SHAPE, 0.25), FLOAT32)


def test_shows_more_than_one_frame_can() -> None:
    shape = 130, 180  # several chunks
    random = np.random.default_rng(2)
    shifts = [(0.0, 0.0), *random.uniform(-2, 2, (7, 2))]
    motions = [Motion((down, across)) for down, across in shifts]
    planes, agreement = burst(0.0, shape, motions), np.full((8, *shape), 255, np.uint8)
    holes = ~PATTERN.panchromatic_mask(shape)
    planes[:, holes] = 1  # nothing is known there
    fine, noise_ratio = merged(planes, motions=motions)
    assert np.abs(fine[::2, ::2] - luminance_at(*pixels(shape)))[4:-4, 4:-4].max() < 0.03
    assert noise_ratio[4:-4, 4:-4].max() < 0.5
    agreement[1:] = 0
    fine, noise_ratio = merged(planes, agreement, motions=motions)
    assert np.array_equal(fine[::2, ::2][~holes], planes[0][~holes])
    assert noise_ratio.min() > 0.999


@pytest.mark.parametrize("share", [0.2, -0.2])
def test_the_order_of_frames_leaves_no_trace(share: float) -> None:
    """The chunks of the merge look for samples where they may be: were one left out, it would be
    that of a later frame.
    """
    shape, nodes = (150, 230), np.zeros((2, 2, 2), np.float32)
    nodes[1, :, 0], nodes[:, 1, 1] = share * shape[0], share * shape[1]  # distances are longer
    motions, order = [Motion(), Motion(local=nodes), Motion(local=nodes + 0.5)], [0, 2, 1]
    planes, noise = burst(0.1, shape, motions), [(0, 0.1)] * 3
    first, _ = merged(planes, noise=noise, motions=motions)
    second, _ = merged(planes[order], noise=noise, motions=[motions[place] for place in order])
    assert_close(second, first, FLOAT32)
