"""Streams of other kinds of sensors, looking at the built-in scene: `device.capture.checks` tells what they are."""

from contextlib import suppress

import numpy as np

from shared.errors import InputError
from tests.device.capture.checks.test_frame_check import KODAK, SIZE, look, of, refusal, taken
from tests.device.packer import pack
from tools.scenes.drawn.builtin import builtin_scene

SCENE = builtin_scene(SIZE[1], SIZE[0]).rgb


def test_a_scattered_pattern_and_others_are_not_taken_for_each_other() -> None:
    assert "or one with scattered colours, which `pattern` describes" in refusal(pack(taken(SCENE, KODAK), "u16"), of())
    words = "a sensor without colour filters, or another `pattern`, `period` or `origin`"
    assert words in refusal(pack(taken(SCENE), "u16"), of(pattern=KODAK))
    bayer = np.empty(SIZE)
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        bayer[row::2, column::2] = SCENE[row::2, column::2, channel]
    with suppress(InputError):  # its greens are where panchromatic pixels would be
        assert look((256 + 3000 * bayer.clip(0, 1)).astype("<u2").tobytes(), of(pattern=KODAK))
