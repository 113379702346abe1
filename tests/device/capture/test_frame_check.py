"""Frames whose description is right are believed, wrong ones are refused, and dark ones prove
nothing.
"""

from functools import cache

import numpy as np
import pytest

from panchroma.device.capture import Sensor
from panchroma.device.capture.frame_check import checked
from panchroma.device.capture.frames import FORMATS, FrameLayout, RawFrame
from panchroma.shared import CfaPattern, CodeArray, FloatArray, InputError, SensorCalibration
from panchroma.tools.simulation.sensor import simulate_additive
from tests.device.packer import pack, random_codes
from tests.scenes import leaves

SIZE = (192, 256)
SCENE = leaves(*SIZE)
GREY = SCENE.mean(axis=2)
PATTERN = CfaPattern.bayer(6, origin=(2, 1))
KODAK = CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2))
TWO_BLOCKS = CfaPattern.of_letters(
    "RGWWWWWW/GBWWWWWW/WWWWWWWW/WWWWWWWW/WWWWBGWW/WWWWGRWW/WWWWWWWW/WWWWWWWW", (3, 1)
)
KAIZU = CfaPattern.of_letters("RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG")
PLACE = "the colour sites are not where `pattern` and `origin` say"
OPEN = "the frame does not show whether size, format and pattern are right"
BLOCKS = [CfaPattern.bayer(period, "GBRG", (1, 2)) for period in (3, 4, 5, 6, 8, 16)]


def taken(
    scene: FloatArray, pattern: CfaPattern = PATTERN, bits: int = 12, sigma: float = 0.01
) -> CodeArray:
    """A scene through a sensor; a grey one may be (H, W)."""
    light = np.broadcast_to(scene[..., None], (*SIZE, 3)) if scene.ndim == 2 else scene
    calibration = SensorCalibration.of_bits(bits, headroom=False)
    scene, random = light.astype(np.float32), np.random.default_rng(0)
    return simulate_additive(scene, pattern, calibration, sigma, random).codes


@cache
def codes(
    pattern: CfaPattern = PATTERN, bits: int = 12, light: float = 1.0, sigma: float = 0.01
) -> CodeArray:
    return taken(np.minimum(SCENE * light, 1.0), pattern, bits, sigma)


def of(name: str = "u16", pattern: CfaPattern = PATTERN, bits: int = 0, **sides: int) -> Sensor:
    """A sensor that is described so; sides: width, height, stride."""
    bits = bits or min(FORMATS[name].bits, 12 if FORMATS[name].words else 14)
    layout = FrameLayout(**({"width": 256, "height": 192} | sides), format=name)
    return Sensor(layout, pattern, SensorCalibration.of_bits(bits, headroom=False))


def stream(
    name: str = "u16",
    stride: int = 0,
    pattern: CfaPattern = PATTERN,
    padding: int = 0xA5,
    light: float = 1.0,
) -> bytes:
    """Four frames of the scene."""
    return pack(codes(pattern, of(name).calibration.bits, light), name, stride, padding) * 4


def look(data: bytes, described: Sensor) -> list[str]:
    """The remarks on the frames in a stream; whatever is missing of the last frame is as the
    beginning of the stream.
    """
    size = described.layout.frame_bytes
    data = (data * (size // len(data) + 2))[: -(-len(data) // size) * size]
    notes: list[str] = []
    chunks = (data[first : first + size] for first in range(0, len(data), size))
    list(checked(map(RawFrame.now, chunks), described, notes.append, print))
    return notes


def refusal(data: bytes, described: Sensor) -> str:
    with pytest.raises(InputError) as caught:
        look(data, described)
    message, layout = str(caught.value), described.layout
    assert message.startswith("the frame is not as described: ")
    size = f"--size {layout.width}x{layout.height} --pixel-format {layout.format}"
    run = f"; run `panchroma identify FRAME {size} --stride {layout.stride}`. "
    assert message.endswith(f"{run}If the description is right, add `unchecked`")
    return message


def test_a_frame_that_shows_nothing_passes_with_a_remark_and_the_next_is_looked_at() -> None:
    levels = (np.full(SIZE, level, np.uint16) for level in (256, 4095))
    for dark in (random_codes(SIZE, 3) + np.uint16(252), *levels):
        (note,) = look(pack(dark, "u16") * 3, of())
        assert note.startswith(OPEN)
    lit = pack(dark, "u16") * 2 + pack(codes(), "u16")
    assert PLACE in refusal(lit, of(pattern=CfaPattern.bayer(6)))


def test_a_frame_of_few_tiles_proves_nothing() -> None:
    (note,) = look(pack(random_codes((20, 30), 12), "u16") * 3, of(width=30, height=20))
    assert note.startswith(OPEN)


def test_the_green_diagonal() -> None:
    frame = pack(codes(), "u16")
    for order in ("GRBG", "GBRG"):
        described = of(pattern=CfaPattern.bayer(6, order, PATTERN.origin))
        assert "the two greens of a block lie on the other diagonal" in refusal(frame, described)
    # only a chart tells red from blue
    assert look(frame, of(pattern=CfaPattern.bayer(6, "BGGR", PATTERN.origin))) == []
    tinted = codes().astype(np.float64) - 256  # greens that differ by the sensor are no proof
    tinted[PATTERN.block_origin[0] :: 6, PATTERN.block_origin[1] + 1 :: 6] *= 1.03
    assert look(pack((tinted + 256).clip(0, 4095).astype(np.uint16), "u16"), of()) == []


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (np.full(SIZE, 256, np.uint16), "it is dark"),
        (np.full(SIZE, 4095, np.uint16), "100 % of its samples are clipped: it is overexposed"),
        (
            np.where(np.arange(SIZE[1]) % 200 < 150, 4095, 900).astype(np.uint16)
            * np.ones(SIZE, np.uint16),
            "it is overexposed",
        ),
        (np.full(SIZE, 900, np.uint16), "it is even, noisy or too dim"),
    ],
)
def test_why_a_frame_shows_nothing(frame: CodeArray, reason: str) -> None:
    (note,) = look(pack(frame, "raw12") * 2, of("raw12"))
    assert f"{reason}); the next frames are looked at" in note


def test_colours_that_a_grey_scene_does_not_show_are_told_and_looked_at_again() -> None:
    wrong = CfaPattern.bayer(6, "GRBG", PATTERN.origin)
    words = "whether the greens are on the right diagonal"
    scattered = "whether each colour is where `pattern` says"
    for pattern, described in ((PATTERN, PATTERN), (PATTERN, wrong), (KODAK, KODAK)):
        (note,) = look(pack(taken(GREY, pattern), "raw12") * 6, of("raw12", described))
        assert (words if pattern is PATTERN else scattered) in note
    grey, lit = pack(taken(GREY), "raw12"), pack(codes(), "raw12")
    # The fourth and the eighth are looked at although two have shown the pattern.
    assert "other diagonal" in refusal(grey * 3 + lit, of("raw12", wrong))
    assert "other diagonal" in refusal(grey * 7 + lit, of("raw12", wrong))
    grey, lit = pack(taken(GREY, KODAK), "raw12"), pack(codes(KODAK), "raw12")
    other = of("raw12", CfaPattern(KODAK.tile, (1, 0)))
    assert "its colours are at other sites" in refusal(grey * 3 + lit, other)


@pytest.mark.parametrize(("bits", "light"), [(10, 0.1), (12, 1.0), (14, 1.0), (14, 0.1)])
def test_samples_that_are_shifted_up(bits: int, light: float) -> None:
    shifted = pack(codes(bits=bits, light=light) << np.uint16(16 - bits), "u16") * 2
    assert not any(OPEN in remark for remark in look(shifted, of(bits=16)))
    if light == 1.0 or bits < 14:
        assert f"more than {bits} bits hold" in refusal(shifted, of(bits=bits))


def test_sensors_of_another_kind() -> None:
    bayer = np.empty(SIZE)
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        bayer[row::2, column::2] = SCENE[row::2, column::2, channel] * (0.2, 1.0, 0.25)[channel]
    grey = GREY + np.random.default_rng(0).normal(0, 0.01, SIZE)
    for light in (bayer, grey):
        frame = pack((256 + 3000 * light.clip(0, 1)).astype(np.uint16), "u16")
        assert "as bright as their neighbours" in refusal(frame, of())


def test_stripes_are_no_proof_against_a_right_description() -> None:
    """Scenes that resemble a shifted row, or have a period of their own."""
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    waves = [(6, 1, 1), (6, 1, -2), (6, 2, 1), (6, 6, 1), (6, 1, 0), (6, 0, 1), (5, 1, 1)]
    for length, down, across in (*waves, (12, 2, 1), (31, 1, -2), (12, 1, 0)):
        phase = 2 * np.pi * (down * rows + across * columns) / length
        look(pack(taken(0.55 + 0.4 * np.sin(phase)), "raw12"), of("raw12"))
    look(pack(taken((rows // 3 + columns // 3) % 2 * 0.8 + 0.1), "raw12"), of("raw12"))


@pytest.mark.parametrize("period", [6, 8, 12])
def test_half_of_the_period_is_refused_where_colours_do_not_show_it(period: int) -> None:
    frame = pack(taken(GREY, CfaPattern.bayer(period, origin=(1, 2))), "u16")
    assert PLACE in refusal(frame, of(pattern=CfaPattern.bayer(period // 2, origin=(1, 2))))


def test_a_file_is_named() -> None:
    frame = RawFrame(pack(codes(), "u16"), RawFrame.now(b"").taken, 0.0, "frames/1.raw")
    named = r"^frames/1\.raw: the frame is not as described.* identify frames/1\.raw --size"
    with pytest.raises(InputError, match=named):
        list(checked([frame], of(pattern=CfaPattern.bayer(5)), print, print))


def test_scattered_patterns_at_another_place() -> None:
    frame = pack(codes(KODAK), "u16")
    # At these places panchromatic pixels or colours differ; two rows and two columns further only
    # red and blue are exchanged.
    for row, column in (KODAK.origin, (3, 0), (1, 0), (3, 2), (0, 1), (1, 1)):
        described = of(pattern=CfaPattern(KODAK.tile, (row, column)))
        if (row, column) in (KODAK.origin, (3, 0)):
            assert look(frame, described) == []
            continue
        reason = refusal(frame, described)
        assert ("its colours are at other sites of the tile" in reason) == ((row + column) % 2 == 1)


def dark_codes(black: float) -> CodeArray:
    return np.random.default_rng(0).normal(black, 3.0, SIZE).round().clip(0).astype(np.uint16)


def test_a_black_level_below_the_assumed_one_is_answered_with_the_options_that_say_it() -> None:
    remedy = "`black=N` states another level; `unchecked` is for frames of a covered lens"
    assert remedy in refusal(dark_codes(16).tobytes() * 2, of())
    black = codes().copy()
    black[:64, :64] = 0
    darker = "a part of it has a mean of 0, darker than black, which is 256"
    assert darker in refusal(pack(black, "u16"), of())
    low = pack((codes(light=0.1).astype(int) - 240).clip(0).astype(np.uint16), "raw12")
    assert "darker than black" in refusal(low * 2, of("raw12"))
