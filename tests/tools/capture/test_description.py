"""Descriptions of sensors that bits of their frames contradict; right ones are believed."""

from typing import Any

import numpy as np
import pytest

from panchroma.device.capture import Sensor
from panchroma.device.capture.frames import FORMATS
from panchroma.shared import CfaPattern, CodeArray
from tests.device.capture.test_frame_check import (
    BLOCKS,
    KAIZU,
    KODAK,
    OPEN,
    PATTERN,
    SIZE,
    TWO_BLOCKS,
    codes,
    look,
    of,
    refusal,
    stream,
    taken,
)
from tests.device.packer import pack

LIGHTS = [(1.0, 0.0), (1.0, 0.03), (0.2, 0.01), (5.0, 0.01)]


@pytest.mark.parametrize("number", range(20))
def test_what_is_described_rightly_is_believed(number: int) -> None:
    """Each pattern in two lights, each format twice; lines are filled with zeros or not."""
    pattern = [*BLOCKS, KODAK, KAIZU, CfaPattern.of_letters("RG/BW"), TWO_BLOCKS][number // 2]
    name = list(FORMATS)[number % len(FORMATS)]
    described = of(name, pattern, stride=544)
    light, sigma = LIGHTS[(number + number // 4) % len(LIGHTS)]
    frame = codes(pattern, described.calibration.bits, light, sigma)
    remarks = look(pack(frame, name, 544, 0xA5 * (number % 2)) * 3, described)
    assert not any(OPEN in remark for remark in remarks)
    if light >= 1.0 and pattern in BLOCKS[:-1]:  # period 16 has too few blocks to show a diagonal
        assert remarks == []


@pytest.mark.parametrize(
    ("sent", "described"),
    [
        (("raw10", 400), of("raw10")),
        (("raw12", 448), of("raw12", stride=401)),
        (("raw10", 448), of("raw10", stride=640)),
        (("raw12", 416), of("raw12", stride=430)),
        # 12 pixels more a row: each block is still over another, but the scene is sheared
        (("u16", 536), of()),
        (("raw10",), of("raw10", width=232)),
        (("raw12",), of("raw12", width=262)),
        (("u16",), of(width=250)),
        *((("raw12",), of("raw12", height=height)) for height in (185, 191, 194, 220)),
        # A width that takes some of what fills each line to the stride.
        *(
            ((name, 576, PATTERN, padding), of(name, width=276, stride=576))
            for name in ("raw10", "u16")
            for padding in (0, 0xA5)
        ),
        *(
            (("u16", 0, PATTERN, 0, light), of(bits=bits))
            for bits, light in ((10, 1), (14, 1), (16, 1), (14, 0.2), (16, 5))
        ),
        *((("raw12",), of("raw12", CfaPattern.bayer(period))) for period in (3, 4, 5, 8, 12)),
        *(
            (("raw12", 0, CfaPattern.bayer(3)), of("raw12", CfaPattern.bayer(period)))
            for period in (6, 9)
        ),
        *(
            (("u16",), of(pattern=CfaPattern.bayer(6, origin=place)))
            for place in ((3, 1), (2, 0), (5, 4))
        ),
        (("raw12", 400, KODAK), of("raw12", KODAK, stride=416)),
        (("raw12", 400, KODAK), of("raw12", KODAK, width=250)),
        (("raw12", 400, KODAK), of("raw12", KODAK, height=191, stride=400)),
        (("raw12", 400, KODAK), of("u16", KODAK)),
        (("u16", 0, TWO_BLOCKS), of(pattern=CfaPattern(TWO_BLOCKS.tile, (3, 2)))),
    ],
)
def test_what_is_described_wrongly_is_refused(sent: Any, described: Sensor) -> None:
    refusal(stream(*sent), described)


PASSING = {
    ("mono10packed", "raw10"),
    ("mono10packed", "mono12packed"),
    ("mono10packed", "u8"),
    ("mono12p", "mono12packed"),
}
"""(sent, described): bytes of which one in three tells little, and bits that are almost in the
right order; only at one origin.
"""


@pytest.mark.parametrize("origin", [(0, 0), (2, 1)])
@pytest.mark.parametrize("right", FORMATS)
def test_a_format_taken_for_another_is_told_or_refused(right: str, origin: tuple[int, int]) -> None:
    frame = pack(codes(bits=min(FORMATS[right].bits, 12)), right, 544)
    for wrong in FORMATS:
        described = of(wrong, CfaPattern.bayer(6, origin=origin), stride=544)
        if (right, wrong) in PASSING and origin == (2, 1):
            remarks = " ".join(look(frame * 3, described))
            assert any(words in remarks for words in (OPEN, "are always 0", "greens"))
        elif right != wrong:
            refusal(frame * 3, described)


@pytest.mark.parametrize(("right", "wrong"), [("mono10p", "raw10"), ("raw12", "mono12packed")])
def test_bits_in_another_order_resemble_none_of_their_neighbours(right: str, wrong: str) -> None:
    frame = pack(codes(bits=FORMATS[right].bits), right)
    assert f"not in the order of {wrong}" in refusal(frame, of(wrong))


def test_scenes_of_two_tones_in_dots_are_no_proof_against_a_right_description() -> None:
    rng = np.random.default_rng(1)
    for number, side in enumerate((2, 2, 2, 3, 3, 5, 9) * 2):
        dots = np.kron(rng.random((97, 128)) < 0.5, np.ones((side, side)))[: SIZE[0], : SIZE[1]]
        name = ("raw12", "mono12p", "u16")[number % 3]
        pattern = (PATTERN, KODAK)[number % 2]
        look(pack(taken(0.1 + 0.8 * dots, pattern, sigma=0.003), name) * 4, of(name, pattern))


def test_a_clipped_or_black_edge_is_no_padding() -> None:
    for level in (256, 4095):
        edge = codes().copy()
        edge[:, -40:] = level
        look(pack(edge, "u16") * 3, of())  # is not refused


@pytest.mark.parametrize(
    ("frame", "bits", "words"),
    [
        (codes(light=0.1) << np.uint16(4), 14, "bits 0, 1, 2, 3 of its samples are always 0"),
        (
            codes(light=0.05, sigma=0.0) + np.uint16(256),
            12,
            "10 of its samples are always 0: the light is dim",
        ),
    ],
)
def test_bits_that_are_never_used_are_told(frame: CodeArray, bits: int, words: str) -> None:
    remarks = look(pack(frame, "u16") * 2, of(bits=bits))
    assert any(words in remark for remark in remarks), remarks
