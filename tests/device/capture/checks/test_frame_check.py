"""Frames whose description is right are believed, wrong ones are refused with the right value, and dark ones prove nothing."""

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from device.capture import Sensor
from device.capture.checks.frame_check import checked
from device.capture.frames import FORMATS, FrameLayout, RawFrame
from shared import CfaPattern, SensorCalibration
from shared.arrays import CodeArray
from shared.errors import InputError
from shared.sensor import simulate_additive
from tests.device.packer import pack, random_codes
from tests.scenes import leaves

SIZE = (192, 256)
PATTERN = CfaPattern.bayer(6, origin=(2, 1))
OPEN = "the frame does not show whether size, format and pattern are right"


@cache
def codes(
    pattern: CfaPattern = PATTERN, bits: int = 12, light: float = 1.0, sigma: float = 0.01, size: tuple[int, int] = SIZE
) -> CodeArray:
    """A scene through a sensor."""
    scene = np.minimum(leaves(*size) * light, 1.0).astype(np.float32)
    calibration = SensorCalibration.of_bits(bits, headroom=False)
    return simulate_additive(scene, pattern, calibration, sigma, np.random.default_rng(0)).codes


def sensor(layout: FrameLayout, pattern: CfaPattern = PATTERN, bits: int = 0) -> Sensor:
    return Sensor(layout, pattern, SensorCalibration.of_bits(bits or min(layout.bits, 12), headroom=False))


def look(data: bytes, described: Sensor) -> list[str]:
    """The remarks on the frames in a stream; whatever is missing of the last frame is as the beginning of the stream."""
    size = described.layout.frame_bytes
    data += data[: -len(data) % size] if len(data) > size else data * (size // len(data)) + data[: size % len(data)]
    frames = (RawFrame.now(data[first : first + size]) for first in range(0, len(data) - size + 1, size))
    notes: list[str] = []
    list(checked(frames, described, notes.append))
    return notes


def refusal(data: bytes, described: Sensor) -> str:
    with pytest.raises(InputError) as caught:
        look(data, described)
    message = str(caught.value)
    assert message.startswith("the frame is not as described: ")
    assert message.endswith(". If the description is right, add `unchecked`")
    return message


LIGHTS = [(1.0, 0.0), (1.0, 0.03), (0.2, 0.01), (5.0, 0.01)]


@pytest.mark.parametrize(("number", "period"), list(enumerate([3, 4, 5, 6, 8, 16])))
@pytest.mark.parametrize(("light", "sigma"), LIGHTS)
def test_what_is_described_rightly_is_believed(number: int, period: int, light: float, sigma: float) -> None:
    pattern, name = CfaPattern.bayer(period, "GBRG", (1, 2)), list(FORMATS)[(number + LIGHTS.index((light, sigma))) % len(FORMATS)]
    layout = FrameLayout(SIZE[1], SIZE[0], name, 544)
    frame = pack(codes(pattern, min(layout.bits, 12), light, sigma), name, 544)
    remarks = look(frame * 3, sensor(layout, pattern))
    assert not any(OPEN in remark for remark in remarks)
    if light >= 1.0 and period < 16:  # so few blocks show no diagonal
        assert remarks == []


@pytest.mark.parametrize(
    "dark",
    [np.full(SIZE, 256, np.uint16), np.full(SIZE, 4095, np.uint16), random_codes(SIZE, 12), random_codes(SIZE, 3) + np.uint16(252)],
)
def test_a_frame_that_shows_nothing_passes_with_a_remark_and_the_next_is_looked_at(dark: CodeArray) -> None:
    layout = FrameLayout(SIZE[1], SIZE[0], "u16")
    (note,) = look(pack(dark, "u16") * 3, sensor(layout))
    assert note.startswith(OPEN)
    assert "`origin=2 1`." in refusal(pack(dark, "u16") * 2 + pack(codes(), "u16"), sensor(layout, CfaPattern.bayer(6)))


@pytest.mark.parametrize("name", ["raw10", "raw12"])
@pytest.mark.parametrize("stride", [400, 416, 448, 512])
@pytest.mark.parametrize("other", [0, 401, 409, 430, 640])
def test_a_wrong_stride(name: str, stride: int, other: int) -> None:
    layout = FrameLayout(SIZE[1], SIZE[0], name, other)
    frame = pack(codes(bits=layout.bits), name, stride)
    assert f"likely `stride={stride}`." in refusal(frame * 3, sensor(layout))


def test_a_wrong_stride_that_keeps_the_pattern_in_place() -> None:
    """12 pixels more a row: each block is still over another, but the scene is sheared."""
    frame = pack(codes(), "u16", 2 * SIZE[1] + 24)
    assert f"likely `stride={2 * SIZE[1] + 24}`." in refusal(frame * 3, sensor(FrameLayout(SIZE[1], SIZE[0], "u16")))


@pytest.mark.parametrize("width", [232, 244, 250, 262, 300])
@pytest.mark.parametrize("name", FORMATS)
def test_a_wrong_width(name: str, width: int) -> None:
    layout = FrameLayout(width, SIZE[0], name)
    right = FrameLayout(SIZE[1], SIZE[0], name).stride
    assert f"`stride={right}`" in refusal(pack(codes(bits=min(layout.bits, 12)), name) * 3, sensor(layout))


@pytest.mark.parametrize("height", [185, 190, 191, 193, 194, 208, 220])
def test_a_wrong_height(height: int) -> None:
    assert "likely another `height`" in refusal(pack(codes(), "raw12") * 4, sensor(FrameLayout(SIZE[1], height, "raw12")))


@pytest.mark.parametrize("place", [(0, 0), (2, 1), (5, 4)])
@pytest.mark.parametrize(
    ("right", "wrong"),
    [("raw10", "raw12"), ("raw12", "raw10"), ("raw10", "u16"), ("raw12", "u16"), ("u16", "raw12"), ("u16", "raw10")],
)
def test_the_format_is_judged_before_place_and_levels(right: str, wrong: str, place: tuple[int, int]) -> None:
    """In a wrong format colour sites seem to be elsewhere, and levels to be higher: that is no advice to follow."""
    frame = pack(codes(bits=min(FORMATS[right].bits, 12)), right, 544)
    described = sensor(
        FrameLayout(SIZE[1], SIZE[0], wrong, 544), CfaPattern.bayer(6, origin=place), bits=10 if wrong == "raw10" else 12
    )
    assert f"likely `pixel_format={right}`" in refusal(frame * 3, described)
    message = refusal(frame * 3, sensor(FrameLayout(SIZE[1], SIZE[0], wrong), CfaPattern.bayer(4)))
    assert f", and its samples are packed as {right}, not as {wrong}; likely `pixel_format={right}` `stride=544`" in message


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("padding", [0, 0xA5])
def test_padding_is_no_part_of_the_picture(name: str, padding: int) -> None:
    """A width that takes some of what fills each line to the stride."""
    right = FrameLayout(SIZE[1], SIZE[0], name, 576)
    frame = pack(codes(bits=min(right.bits, 12)), name, 576, padding)
    assert f"likely `width={SIZE[1]}` `stride=576`." in refusal(frame * 3, sensor(FrameLayout(SIZE[1] + 20, SIZE[0], name, 576)))
    assert look(frame * 3, sensor(right)) == []


def test_a_clipped_or_black_edge_is_no_padding() -> None:
    layout = FrameLayout(SIZE[1], SIZE[0], "u16")
    for level in (256, 4095):
        edge = codes().copy()
        edge[:, -40:] = level
        look(pack(edge, "u16") * 3, sensor(layout))  # is not refused


def test_formats_that_are_not_supported_are_named() -> None:
    described = sensor(FrameLayout(SIZE[1], SIZE[0], "u16"), bits=16)
    assert "swap the bytes" in refusal(codes().astype(">u2").tobytes() * 3, described)
    assert "8 bits or a lossy compression" in refusal((codes() >> 4).astype(np.uint8).tobytes() * 5, described)
    for name in FORMATS:
        other = sensor(FrameLayout(SIZE[1], SIZE[0], name), CfaPattern.bayer(6))  # and at another place
        assert "a mode of the camera with 10, 12 or 16 bits" in refusal(pack(codes(bits=14), "raw14") * 3, other)
        assert "8 bits or a lossy compression" in refusal(pack(codes(), "8 bits") * 5, other)
        assert "swap the bytes" in refusal(pack(codes(), "big-endian u16") * 3, other)


@pytest.mark.parametrize(("bits", "light"), [(14, 1.0), (16, 1.0), (14, 0.2), (16, 5.0)])
def test_bits_that_are_never_used(bits: int, light: float) -> None:
    frame = pack(codes(light=light), "u16")
    assert "likely `sensor_bits=12`." in refusal(frame * 2, sensor(FrameLayout(SIZE[1], SIZE[0], "u16"), bits=bits))


def test_bits_that_are_exceeded() -> None:
    assert "likely `sensor_bits=12`." in refusal(pack(codes(), "u16") * 2, sensor(FrameLayout(SIZE[1], SIZE[0], "u16"), bits=10))


@pytest.mark.parametrize("period", [3, 4, 5, 7, 8, 12])
def test_a_wrong_period(period: int) -> None:
    message = refusal(pack(codes(), "raw12"), sensor(FrameLayout(SIZE[1], SIZE[0], "raw12"), CfaPattern.bayer(period)))
    assert "likely `period=6` `origin=2 1`." in message


def test_a_wrong_origin_along_each_axis() -> None:
    frame, layout = pack(codes(), "u16"), FrameLayout(SIZE[1], SIZE[0], "u16")
    row, column = PATTERN.origin
    down, across = [(each, column) for each in range(6) if each != row], [(row, each) for each in range(6) if each != column]
    for origin in (*down, *across, ((row + 3) % 6, (column + 3) % 6)):
        assert "likely `origin=2 1`." in refusal(frame, sensor(layout, CfaPattern.bayer(6, origin=origin)))


def test_the_green_diagonal() -> None:
    frame, layout = pack(codes(), "u16"), FrameLayout(SIZE[1], SIZE[0], "u16")
    for order, likely in (("GRBG", "RGGB or BGGR"), ("GBRG", "RGGB or BGGR")):
        assert f"likely `pattern` with blocks {likely}." in refusal(
            frame, sensor(layout, CfaPattern.bayer(6, order, PATTERN.origin))
        )
    assert look(frame, sensor(layout, CfaPattern.bayer(6, "BGGR", PATTERN.origin))) == []  # only a chart tells red from blue


def test_greens_that_a_scene_without_colour_does_not_show_are_told_and_looked_at_again() -> None:
    grey = np.repeat(leaves(*SIZE).mean(axis=2, keepdims=True), 3, axis=2).astype(np.float32)
    calibration = SensorCalibration.of_bits(12, headroom=False)
    frame = pack(simulate_additive(grey, PATTERN, calibration, 0.01, np.random.default_rng(0)).codes, "raw12")
    layout = FrameLayout(SIZE[1], SIZE[0], "raw12")
    for order in ("RGGB", "GRBG"):
        described = sensor(layout, CfaPattern.bayer(6, order, PATTERN.origin))
        (note,) = look(frame * 6, described)
        assert "whether the greens are on the right diagonal" in note
    # The fourth and the eighth are looked at although two have shown the pattern.
    assert "other diagonal" in refusal(frame * 3 + pack(codes(), "raw12"), described)
    assert "other diagonal" in refusal(frame * 7 + pack(codes(), "raw12"), described)


def test_greens_that_differ_by_the_sensor_are_no_proof() -> None:
    tinted = codes().astype(np.float64) - 256
    tinted[PATTERN.block_origin[0] :: 6, PATTERN.block_origin[1] + 1 :: 6] *= 1.03
    layout = FrameLayout(SIZE[1], SIZE[0], "u16")
    assert look(pack((tinted + 256).clip(0, 4095).astype(np.uint16), "u16"), sensor(layout)) == []


@pytest.mark.parametrize(
    ("frame", "bits", "words"),
    [
        (codes(light=0.1) << np.uint16(4), 14, "never use the lowest 4 bits: they may be shifted up; then `sensor_bits=16`"),
        (codes(light=0.05, sigma=0.0) + np.uint16(256), 12, "never use the highest of 12 bits"),
        (codes(light=0.1) // 2 + np.uint16(128), 10, "far above black, 64: is `sensor_bits=10` right?"),
    ],
)
def test_bits_that_are_open_are_told(frame: CodeArray, bits: int, words: str) -> None:
    remarks = look(pack(frame, "u16") * 2, sensor(FrameLayout(SIZE[1], SIZE[0], "u16"), bits=bits))
    assert any(words in remark for remark in remarks), remarks


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("light", [0.1, 1.0])
def test_samples_that_are_shifted_up(bits: int, light: float) -> None:
    layout = FrameLayout(SIZE[1], SIZE[0], "u16")
    shifted = pack(codes(bits=bits, light=light) << np.uint16(16 - bits), "u16") * 2
    assert not any(OPEN in remark for remark in look(shifted, sensor(layout, bits=16)))
    if light == 1.0 or bits < 14:
        assert "likely `sensor_bits=16`." in refusal(shifted, sensor(layout, bits=bits))


def test_sensors_of_another_kind() -> None:
    scene = leaves(*SIZE)
    layout = FrameLayout(SIZE[1], SIZE[0], "u16")
    bayer = np.empty(SIZE)
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        bayer[row::2, column::2] = scene[row::2, column::2, channel] * (0.2, 1.0, 0.25)[channel]
    grey = scene.mean(axis=2) + np.random.default_rng(0).normal(0, 0.01, SIZE)
    for light, words in ((bayer, "ordinary Bayer sensor"), (grey, "without colour filters")):
        assert words in refusal(pack((256 + 3000 * light.clip(0, 1)).astype(np.uint16), "u16"), sensor(layout))


def stripes() -> Iterator[CodeArray]:
    """Scenes that resemble a shifted row, or have a period of their own."""
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    for phase in (rows + columns, rows - 2 * columns, 2 * rows + columns, 6 * rows + columns, rows, columns):
        for length in (5, 6, 12, 31):
            light = np.repeat((0.55 + 0.4 * np.sin(2 * np.pi * phase / length))[..., None], 3, axis=2).astype(np.float32)
            yield simulate_additive(
                light, PATTERN, SensorCalibration.of_bits(12, headroom=False), 0.01, np.random.default_rng(1)
            ).codes
    checks = np.repeat(((rows // 3 + columns // 3) % 2 * 0.8 + 0.1)[..., None], 3, axis=2).astype(np.float32)
    yield simulate_additive(checks, PATTERN, SensorCalibration.of_bits(12, headroom=False), 0.01, np.random.default_rng(1)).codes


def test_stripes_are_no_proof_against_a_right_description() -> None:
    layout = FrameLayout(SIZE[1], SIZE[0], "raw12")
    for scene in stripes():
        look(pack(scene, "raw12"), sensor(layout))


def test_a_file_is_named() -> None:
    frame = RawFrame(pack(codes(), "u16"), RawFrame.now(b"").taken, 0.0, "frames/0001.raw")
    with pytest.raises(InputError, match=r"^frames/0001\.raw: the frame is not as described"):
        list(checked([frame], sensor(FrameLayout(SIZE[1], SIZE[0], "u16"), CfaPattern.bayer(5)), print))


KODAK = CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2))
TWO_BLOCKS = CfaPattern.of_letters("RGWWWWWW/GBWWWWWW/WWWWWWWW/WWWWWWWW/WWWWBGWW/WWWWGRWW/WWWWWWWW/WWWWWWWW", (3, 1))
SCATTERED = [
    KODAK,
    CfaPattern.of_letters("RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG"),
    CfaPattern.of_letters("RG/BW", (1, 0)),
    TWO_BLOCKS,
]


@pytest.mark.parametrize("pattern", SCATTERED)
@pytest.mark.parametrize(("light", "sigma"), LIGHTS)
def test_scattered_patterns_are_believed(pattern: CfaPattern, light: float, sigma: float) -> None:
    name = "u16" if light == 1.0 else "raw10"
    layout = FrameLayout(SIZE[1], SIZE[0], name, 544)
    remarks = look(pack(codes(pattern, min(layout.bits, 12), light, sigma), name, 544) * 2, sensor(layout, pattern))
    assert not any(OPEN in remark for remark in remarks)


def test_scattered_patterns_at_another_place() -> None:
    layout = FrameLayout(SIZE[1], SIZE[0], "u16")
    frame = pack(codes(KODAK), "u16")
    # At these places panchromatic pixels or colours differ; two rows and two columns further only red and blue are exchanged.
    for row, column in (KODAK.origin, (3, 0), (1, 0), (3, 2), (0, 1), (1, 1)):
        described = sensor(layout, CfaPattern(KODAK.tile, (row, column)))
        if (row, column) in (KODAK.origin, (3, 0)):
            assert look(frame, described) == []
            continue
        message = refusal(frame, described)
        assert "likely `origin=1 2`." in message or "likely `origin=3 0`." in message
        assert ("its colours are at other sites of the tile" in message) == ((row + column) % 2 == 1)
    two = pack(codes(TWO_BLOCKS), "u16")
    assert "likely `origin=3 1`." in refusal(two, sensor(layout, CfaPattern(TWO_BLOCKS.tile, (3, 2))))


def test_colours_that_a_scene_does_not_show_are_told() -> None:
    grey = np.repeat(leaves(*SIZE).mean(axis=2, keepdims=True), 3, axis=2).astype(np.float32)
    calibration = SensorCalibration.of_bits(12, headroom=False)
    frame = pack(simulate_additive(grey, KODAK, calibration, 0.01, np.random.default_rng(0)).codes, "raw12")
    layout = FrameLayout(SIZE[1], SIZE[0], "raw12")
    (note,) = look(frame * 6, sensor(layout, KODAK))
    assert "whether each colour is where `pattern` says" in note
    with pytest.raises(InputError, match="likely `origin="):
        look(frame * 3 + pack(codes(KODAK), "raw12"), sensor(layout, CfaPattern(KODAK.tile, (1, 0))))


def test_a_wrong_layout_of_a_scattered_pattern() -> None:
    frame = pack(codes(KODAK), "raw12", 400)
    assert "likely `stride=400`." in refusal(frame * 3, sensor(FrameLayout(SIZE[1], SIZE[0], "raw12", 416), KODAK))
    assert "`stride=400`" in refusal(frame * 3, sensor(FrameLayout(250, SIZE[0], "raw12"), KODAK))
    assert "likely another `height`" in refusal(frame * 4, sensor(FrameLayout(SIZE[1], 191, "raw12", 400), KODAK))
    assert "`pixel_format=raw12` `stride=400`" in refusal(frame * 3, sensor(FrameLayout(SIZE[1], SIZE[0], "u16"), KODAK))


def dark_codes(black: float, sigma: float = 3.0) -> CodeArray:
    return np.random.default_rng(0).normal(black, sigma, SIZE).round().clip(0).astype(np.uint16)


def look_at_dark(code: CodeArray, bits: int, name: str = "u16") -> list[str]:
    layout = FrameLayout(SIZE[1], SIZE[0], name)
    frames = [RawFrame.now(pack(code, name, layout.stride))] * 2
    notes: list[str] = []
    assert len(list(checked(frames, sensor(layout, bits=bits), notes.append, covered=True))) == 2
    return notes


@pytest.mark.parametrize(
    ("black", "bits", "name"), [(16, 12, "u16"), (0, 12, "u16"), (16, 10, "raw10"), (16, 12, "raw12"), (900, 12, "u16")]
)
def test_dark_frames_of_any_black_level_pass_where_they_are_said_to_be_dark(black: int, bits: int, name: str) -> None:
    """They are the first that a new sensor has to give: nothing is known of its black level before."""
    assert look_at_dark(dark_codes(black), bits, name) == []


def test_what_is_lit_or_too_large_is_not_dark() -> None:
    with pytest.raises(InputError, match=r"nearly equal; likely light on the sensor \(cover the lens, or leave `covered` out\)"):
        look_at_dark(codes(), 12)
    with pytest.raises(InputError, match=r"a sample is .*, more than 10 bits hold; likely `sensor_bits=12`"):
        look_at_dark(codes(), 10)
    layout = FrameLayout(SIZE[1], SIZE[0], "raw12")
    packed = RawFrame.now((pack(dark_codes(70), "raw10") * 2)[: layout.frame_bytes])
    with pytest.raises(InputError, match="another `pixel_format`"):  # packed words, read as other ones
        list(checked([packed], sensor(layout), print, covered=True))


def test_a_black_level_below_the_assumed_one_is_answered_with_the_options_that_say_it() -> None:
    layout = FrameLayout(SIZE[1], SIZE[0], "u16")
    assert "likely `covered`, if the lens is covered, and `black=N`" in refusal(dark_codes(16).tobytes() * 2, sensor(layout))
    low = pack((codes(light=0.1).astype(int) - 240).clip(0).astype(np.uint16), "raw12")
    said = refusal(low * 2, sensor(FrameLayout(SIZE[1], SIZE[0], "raw12")))
    assert "likely `black=N` with the sensor's own black level" in said
