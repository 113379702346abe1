"""Streams of other kinds of sensors, looking at the built-in scene: they are refused."""

import numpy as np
import pytest

from shared import CfaPattern
from shared.arrays import CodeArray
from tests.device.capture.test_frame_check import KODAK, SIZE, of, refusal, taken
from tests.device.packer import pack
from tools.simulation.drawn.builtin import builtin_scene

SCENE = builtin_scene(SIZE[1], SIZE[0]).rgb
BAYER = np.empty(SIZE)
for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
    BAYER[row::2, column::2] = SCENE[row::2, column::2, channel]


@pytest.mark.parametrize(
    ("codes", "pattern"),
    [
        (taken(SCENE, KODAK), None),
        (taken(SCENE), KODAK),
        ((256 + 3000 * BAYER.clip(0, 1)).astype(np.uint16), None),
        ((256 + 3000 * BAYER.clip(0, 1)).astype(np.uint16), KODAK),
    ],
)
def test_a_scattered_pattern_and_others_are_not_taken_for_each_other(codes: CodeArray, pattern: CfaPattern | None) -> None:
    refusal(pack(codes, "u16"), of(pattern=pattern) if pattern else of())
