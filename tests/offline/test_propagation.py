"""Eqs. 10 and 14 against their reference."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import Frame
from panchroma.offline.stages.affinity import AffinitySettings
from panchroma.offline.stages.propagation import Propagation, PropagationSettings, follow_lines
from panchroma.shared import CfaPattern
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import CASES, cleaned, every_case, shot
from tests.reference import geometry
from tests.reference import propagation as reference
from tests.reference.compare import assert_close

PAPER = PropagationSettings()
FLOAT32 = 1e-6  # a few dozen operations on values up to one


def case(pattern: CfaPattern, shape: tuple[int, int]) -> tuple[Frame, FloatArray]:
    """Any blocks and light, and any affinities: the stage does not ask where they come from."""
    random = np.random.default_rng(0)
    down, across = geometry.patch_counts(pattern, shape)
    blocks = random.uniform(size=(down + 1, across + 1, len(pattern.channels)))
    affinity = random.uniform(size=(2, 2, down * pattern.period, across * pattern.period))
    light = random.uniform(-0.1, 1.0, size=shape)  # noise makes some of it negative
    frame = replace(cleaned(shot(pattern, shape)), blocks=blocks.astype(np.float32))
    affinity /= affinity.sum(axis=(0, 1))
    return replace(frame, luminance=light.astype(np.float32)), affinity.astype(np.float32)


def mixed(frame: Frame, affinity: FloatArray, settings: PropagationSettings = PAPER) -> FloatArray:
    stage = Propagation(frame, AffinitySettings(), settings)
    return stage.mixed(affinity, (0, frame.shape[0]))


def expected(frame: Frame, affinity: FloatArray, softness: float = 0.0) -> DoubleArray:
    """What softness adds to every affinity."""
    planes = frame.blocks, affinity, frame.luminance
    blocks, alpha, light = (plane.astype(np.float64) for plane in planes)
    return reference.propagate(blocks, abs(alpha) + softness, light, frame.pattern)


@every_case
@pytest.mark.parametrize("softness", [0.0, 0.5])
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int], softness: float) -> None:
    frame, affinity = case(pattern, shape)
    affinity[0, 0, 1::3] = -0.01  # as a solver may leave it
    result = mixed(frame, affinity, PropagationSettings(softness))
    assert result.dtype == np.float32
    assert_close(result, expected(frame, affinity, softness), FLOAT32)


def test_likeness_prefers_blocks_as_bright_as_the_pixel_and_does_nothing_in_even_light() -> None:
    pattern = CfaPattern.bayer(6, origin=(5, 5))  # patches begin at (0, 0)
    frame, affinity = case(pattern, (12, 12))
    even = np.full(frame.shape, 0.3, np.float32)
    frame, alike = replace(frame, luminance=even), PropagationSettings(0.5, 40.0)
    assert_close(mixed(frame, affinity, alike), expected(frame, affinity, 0.5), FLOAT32)
    dark = even.copy()
    dark[0, 0] = dark[2, 2] = 0.1  # the corner in block (0, 0), and a pixel
    plain, result = (
        mixed(replace(frame, luminance=dark), affinity, settings)[2, 2] - frame.blocks[0, 0]
        for settings in (PropagationSettings(0.5), alike)
    )
    assert np.abs(result).max() < 0.75 * np.abs(plain).max()


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_without_light_all_four_count_the_same(value: float) -> None:
    pattern, shape = CASES["odd"]
    frame, affinity = case(pattern, shape)
    frame = replace(frame, luminance=np.full(shape, value, np.float32))
    found = mixed(frame, affinity)
    top, left = geometry.first_patch(pattern)
    inside = found[: top + pattern.period, : left + pattern.period]
    mean = frame.blocks[:2, :2].mean(axis=(0, 1))
    assert_close(inside, np.broadcast_to(mean, inside.shape), FLOAT32)


def test_colours_lie_on_the_line_through_that_of_the_block() -> None:
    """A pixel as bright as the block has its chromaticity; red falls faster than the others, and
    never below 0, where luminance is kept. A pixel beyond an end of the line has the colour of
    half that distance.
    """
    gamma = np.array([0.8, 1.1, 1.3], np.float32)
    chromaticity = np.array([0.4, 0.3, 0.35 / 1.3], np.float32)
    slope = np.array([0.5, -0.2, -0.18 / 1.3], np.float32)
    block, light = 0.6, np.array([[0.6, 0.9, 0.05, 0.0, -0.1, 1.2, 0.2]], np.float32)
    planes = np.concatenate([chromaticity + slope, slope * np.float32(block), [-1, 1]])
    found = np.empty((1, 7, 3), np.float32)
    lines = np.tile(planes.astype(np.float32), (1, 7, 1))
    lines[0, 6, -2] = 0.5
    follow_lines(lines, light, np.float32(0.01), gamma, found)
    assert_close(found[0, 0], chromaticity, FLOAT32)
    colour = chromaticity * 0.9 + slope * 0.3
    assert_close(found[0, 1] * 0.9, colour, FLOAT32)
    assert found.min() == found[0, 2, 0] == 0
    assert_close(found @ gamma, np.ones((1, 7)), FLOAT32)
    assert np.array_equal(found[0, 3], found[0, 4])  # as dark as the least luminance
    assert_close(found[0, 5], chromaticity + slope - slope * block / 1.1, FLOAT32)
    assert_close(found[0, 6], chromaticity + slope - slope * block / 0.35, FLOAT32)
