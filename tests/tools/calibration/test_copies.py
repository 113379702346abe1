"""Frames that are nearly the same measure no noise: they are refused, and real frames with fixed pattern are not."""

from collections.abc import Callable

import numpy as np
import pytest

from shared import CfaPattern, Mosaic
from shared.errors import InputError
from tests.tools.calibration.known_camera import BLIND, edited, frame
from tools.calibration.copies import DARK_ALIKE, FLAT_ALIKE, refuse_copies

SHAPE = (120, 180)
RNG = np.random.default_rng(0)
LEVELS = {"dark": (0.0, DARK_ALIKE), "flat": (0.5, FLAT_ALIKE)}
EDITS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "the same": lambda codes: codes,
    "some pixels": lambda codes: np.where(RNG.random(codes.shape) < 0.02, 300, codes),
    "scaled": lambda codes: 1.02 * codes,
    "one code more": lambda codes: codes + 1,
    "tenth of the codes off by one": lambda codes: codes + (RNG.random(codes.shape) < 0.1),
    "less than rounding": lambda codes: codes + RNG.uniform(-0.6, 0.6, codes.shape),
    "other light": lambda codes: codes + np.linspace(0, 30, codes.shape[1]),
    "rows of their own": lambda codes: codes + RNG.normal(0, 3, (codes.shape[0], 1)),
}


def taken(level: float, seed: int) -> Mosaic:
    return frame(np.full((*SHAPE, 3), level), seed=seed)


@pytest.mark.parametrize("kind", LEVELS)
@pytest.mark.parametrize("edit", EDITS)
def test_a_copy_is_refused_whatever_was_done_to_it(kind: str, edit: str) -> None:
    level, alike = LEVELS[kind]
    first = taken(level, 1)
    frames = [("a.dng", first), ("b.dng", taken(level, 2)), ("c.dng", edited(first, EDITS[edit]))]
    with pytest.raises(InputError, match=r"c.dng and a.dng have the same noise"):
        refuse_copies(frames, alike)


@pytest.mark.parametrize("kind", LEVELS)
def test_frames_taken_one_by_one_pass_with_their_fixed_pattern(kind: str) -> None:
    level, alike = LEVELS[kind]
    hot = RNG.random(SHAPE) < 0.002
    columns, response = RNG.normal(0, 2, SHAPE[1]), RNG.normal(1, 0.01, SHAPE)

    def pattern(codes: np.ndarray) -> np.ndarray:
        return np.where(hot, 900, 256 + (codes - 256) * response + columns)

    refuse_copies([(str(seed), edited(taken(level, seed), pattern)) for seed in range(4)], alike)


def test_small_frames_and_frames_without_noise() -> None:
    small = [(str(seed), frame(np.full((8, 8, 3), 0.5), seed=seed)) for seed in range(3)]
    refuse_copies(small, FLAT_ALIKE)
    black = Mosaic(np.full(SHAPE, 256, np.uint16), CfaPattern.bayer(), BLIND)
    with pytest.raises(InputError, match="same noise"):
        refuse_copies([("a", black), ("b", black)], DARK_ALIKE)
    with pytest.raises(InputError, match="180 x 120 pixels, 0 8 x 8"):
        refuse_copies([small[0], ("b", black)], DARK_ALIKE)
