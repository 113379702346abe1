"""Frames whose description is right are believed, wrong ones are refused, and dark ones prove
nothing.
"""

from dataclasses import replace
from functools import cache, partial
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from panchroma.device.capture import Sensor
from panchroma.device.capture.frame_check import SlippedError, checked
from panchroma.device.capture.frames import FORMATS, FrameError, FrameLayout, RawFrame
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
    frames = (replace(RawFrame.now(chunk), source="1.raw") for chunk in chunks)
    list(checked(frames, described, notes.append, print))
    return notes


def refusal(data: bytes, described: Sensor) -> str:
    with pytest.raises(InputError) as caught:
        look(data, described)
    message, layout = str(caught.value), described.layout
    assert message.startswith("1.raw: the frame is not as described: ")
    size = f"--size {layout.width}x{layout.height} --pixel-format {layout.format}"
    run = f"; run `panchroma identify 1.raw {size} --stride {layout.stride}`. "
    assert message.endswith(f"{run}If the description is right, add `unchecked`")
    return message


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


CLIPPED = np.full(SIZE, 4095, np.uint16)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (random_codes(SIZE, 3) + np.uint16(252), "it is dark"),
        (CLIPPED, "100 % of its samples are clipped: it is overexposed"),
        (np.where(np.arange(SIZE[1]) % 200 < 150, CLIPPED, np.uint16(900)), "it is overexposed"),
        (np.full(SIZE, 900, np.uint16), "it is even, noisy or too dim"),
        (random_codes((20, 30), 12), ""),  # few tiles
    ],
)
def test_a_frame_that_shows_nothing_passes_with_the_reason_and_the_next_is_looked_at(
    frame: CodeArray, reason: str
) -> None:
    nothing = pack(frame, "u16") * 2
    (note,) = look(nothing, of(height=frame.shape[0], width=frame.shape[1]))
    assert note.startswith(OPEN)
    assert f"{reason}); the next frames are looked at" in note
    if frame.shape == SIZE:
        assert PLACE in refusal(nothing + stream(), of(pattern=CfaPattern.bayer(6)))


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


def test_a_black_level_below_the_assumed_one_is_answered_with_the_options_that_say_it() -> None:
    black = codes().copy()
    black[:64, :64] = 0
    reason = refusal(pack(black, "u16"), of())
    assert "a part of it has a mean of 0, darker than black, which is 256" in reason
    assert "(`black=N` or `sensor_bits=N` moves it; `unchecked` is for a covered lens)" in reason
    low = pack((codes(light=0.1).astype(int) - 240).clip(0).astype(np.uint16), "raw12")
    assert "darker than black" in refusal(low * 2, of("raw12"))


# --- bits ----------------------------------------------------------------------------------------

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


PASSING = {("mono10packed", "raw10"), ("mono10packed", "mono12packed"), ("mono10packed", "u8")}
"""(sent, described): bytes of which one in three tells little, and bits of which only the lowest
are in the wrong place; only at one origin.
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


PACKED = [("raw10", "mono10p"), ("raw12", "mono12p", "mono12packed"), ("raw14", "mono14p")]


@pytest.mark.parametrize("light", [0.4, 1.0])
@pytest.mark.parametrize("pattern", [PATTERN, KODAK])
def test_bits_in_another_order_resemble_their_neighbours_less(
    pattern: CfaPattern, light: float
) -> None:
    for right, wrong in (pair for formats in PACKED for pair in permutations(formats, 2)):
        frame = pack(codes(pattern, FORMATS[right].bits, light), right)
        assert f"not in the order of {wrong}" in refusal(frame, of(wrong, pattern))


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_words_whose_bytes_are_exchanged_have_unused_bits_between_others(bits: int) -> None:
    for right, wrong in permutations(("u16", "u16be")):
        frame = pack(codes(bits=bits), right)
        assert f"not in the order of {wrong}" in refusal(frame, of(wrong, bits=16))


def test_exchanged_bytes_that_dim_frames_do_not_show_are_told_in_a_later_one() -> None:
    dim, lit = (pack(codes(bits=10, light=light), "u16") for light in (0.15, 1.0))
    described, notes = of("u16be", bits=16), list[str]()
    stream = (RawFrame.now(data) for data in (dim, dim, dim, lit))
    frames = checked(stream, described, notes.append, print)
    assert [next(frames).is_checked for _ in range(3)] == [False, False, True]
    assert any("bits 0, 1, 2, 3, 4, 5, 6, 7 of its samples are always 0" in note for note in notes)
    with pytest.raises(SlippedError):
        next(frames)


@pytest.mark.parametrize("number", [1, 2, 4])
@pytest.mark.parametrize("lost", [802, 4096, 65536])
@pytest.mark.parametrize("bottom", [1.0, 0.01])
def test_a_small_frame_that_lost_bytes_is_told_by_itself_or_by_the_next(
    number: int, lost: int, bottom: float
) -> None:
    """Its last rows, a dozen windows across, may be dark."""
    height, width = 303, 401
    layout, calibration = FrameLayout(width, height, "u16"), SensorCalibration.of_bits(12)
    described = Sensor(layout, CfaPattern.bayer(6), calibration)
    scene = leaves(height, width).copy()
    scene[-70:] *= np.float32(bottom)
    shoot = partial(simulate_additive, scene, described.pattern, calibration, 0.003)
    taken = [shoot(np.random.default_rng(seed)).codes.tobytes() for seed in range(7)]
    size, whole = layout.frame_bytes, b"".join(taken)
    assert look(whole, described) == []
    place = number * size + 3 * size // 10 // 2 * 2
    cut, passed = whole[:place] + whole[place + lost :], list[RawFrame]()
    sent = (RawFrame.now(cut[first : first + size]) for first in range(0, 6 * size, size))
    with pytest.raises(FrameError):
        passed.extend(checked(sent, described, print, print))
    right = max((place for place, frame in enumerate(passed) if frame.is_checked), default=-1)
    assert right < number <= len(passed) <= number + 1


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "u8"])
def test_frames_without_a_scene_are_no_proof_against_a_right_format(name: str) -> None:
    """Strong noise that black cuts off, defects in uneven darkness, and codes that are multiples."""
    described, rng = of(name), np.random.default_rng(0)
    levels, black = 1 << described.calibration.bits, described.calibration.black_level[0]
    noise = rng.normal(black, 0.08 * levels, SIZE)
    dark = rng.normal(black, 2, SIZE) + rng.normal(0, 2, SIZE[1])
    defects = np.where(rng.random(SIZE) < 0.01, rng.uniform(black, levels, SIZE), dark)
    for frame in (noise, dark, defects, codes(bits=described.calibration.bits) // 8 * 8):
        look(pack(frame.clip(0, levels - 1).astype(np.uint16), name) * 3, described)


def test_a_small_frame_of_which_one_corner_is_smooth_is_no_proof_either() -> None:
    rng, side = np.random.default_rng(0), 70
    frame = rng.uniform(300, 4000, (side, side))
    ramp = np.add.outer(np.arange(48), np.arange(48))
    frame[:48, :48] = 500 + 30 * ramp + rng.normal(0, 20, (48, 48))
    look(pack(frame.astype(np.uint16), "raw12") * 3, of("raw12", width=side, height=side))


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
        (codes(light=0.05, sigma=0) + np.uint16(256), 12, "10 of its samples are always 0: the"),
    ],
)
def test_bits_that_are_never_used_are_told(frame: CodeArray, bits: int, words: str) -> None:
    remarks = look(pack(frame, "u16") * 2, of(bits=bits))
    assert any(words in remark for remark in remarks), remarks
