"""The pattern against a count of the tile, pixel by pixel."""

from dataclasses import FrozenInstanceError, asdict

import numpy as np
import pytest

from panchroma.shared.errors import InputError
from panchroma.shared.pattern import CfaPattern
from tests.reference import geometry

FIVE = ("RGB", "XWY")  # six pixels, five channels, and a hole in the block
PATTERNS = [
    CfaPattern.bayer(),
    CfaPattern.bayer(3, "GBRG", (2, 1)),
    CfaPattern.bayer(4, "BGGR", (-1, 7)),
    CfaPattern.bayer(7, "GRBG", (3, 6)),
    CfaPattern.bayer(16, origin=(9, 14)),
    CfaPattern.with_block(FIVE, 8, (5, 2)),
    CfaPattern.with_block(("R", "G", "B"), 5, (1, 3)),
    # The block lies across the tile's edge.
    CfaPattern(("BWWWG", "WWWWW", "WWWWW", "WWWWW", "GWWWR")),
    CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (3, 2)),  # scattered: Kodak's
    CfaPattern.of_letters("RGW/WWW/WWW/WWW/WWX/WWW", (1, 4)),  # two blocks
]

with_patterns = pytest.mark.parametrize(
    "pattern", PATTERNS, ids=lambda pattern: f"{pattern.channels}{pattern.period}{pattern.origin}"
)


@with_patterns
def test_filter_map_is_the_tile_repeated_from_its_origin(pattern: CfaPattern) -> None:
    for first in ((0, 0), (3, 11), (-4, 2)):
        planes = pattern.filter_map((17, 13), first)
        assert planes.dtype == np.uint8
        for (row, column), plane in np.ndenumerate(planes):
            letter = geometry.letter(pattern, row + first[0], column + first[1])
            assert pattern.planes[plane] == letter


@with_patterns
def test_cropping_shifts_the_pattern(pattern: CfaPattern) -> None:
    whole = pattern.filter_map((40, 40))
    for top, left in ((0, 0), (1, 5), (19, 2)):
        cropped = pattern.cropped(top, left)
        assert np.array_equal(cropped.filter_map((20, 30)), whole[top:, left:][:20, :30])
        assert cropped.letters_from() == pattern.letters_from((top, left))


def test_light_is_that_of_the_panchromatic_pixels() -> None:
    # 32 pixels that see three times as much, and 4
    assert CfaPattern.bayer().light_efficiency() == pytest.approx(100 / 36)
    assert CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW").light_efficiency() == 2


def test_origin_counts_modulo_the_period_and_patterns_are_values() -> None:
    one, other = CfaPattern.bayer(6, origin=(-1, 13)), CfaPattern.bayer(6, origin=(5, 1))
    assert {one, other} == {one}
    with pytest.raises(FrozenInstanceError):
        one.tile = ()  # type: ignore[misc]


def test_channels_follow_the_tile_unless_named() -> None:
    assert CfaPattern.with_block(FIVE, 6).channels == "RGBXY"
    assert CfaPattern.with_block(("XY",), 6, channels="YX").channels == "YX"
    assert CfaPattern.bayer(6, "BGGR").channels == "RGB"


def test_one_channel_may_have_no_filter() -> None:
    channels = {"rccb": "RGB", "rccg": "RGB", "rccc": "RC", "GW/BW": "RGB", "BWW": "BY"}
    for letters, derived in zip(channels, (1, 2, 1, 0, 1), strict=True):
        pattern = CfaPattern.of_letters(letters)
        assert (pattern.channels, pattern.derived) == (channels[letters], derived)
        assert pattern.site_counts[derived] == 0
        assert CfaPattern.from_json(asdict(pattern)) == pattern
        assert pattern.cropped(1, 3).derived == derived


def test_all_named_channels_may_have_filters() -> None:
    pattern = CfaPattern.of_letters("RW/WB", channels="RB")
    assert (pattern.derived, pattern.channels, pattern.name) == (None, "RB", "")
    for channels in ("R", "RGBX", "RWB", "RRB", "RG"):
        with pytest.raises(InputError, match="channels"):
            CfaPattern.of_letters("RW/WB", channels=channels)


def test_letters_make_square_tiles() -> None:
    assert CfaPattern.of_letters("RGW GBW WWW", (1, 2)) == CfaPattern.bayer(3, origin=(1, 2))
    for letters in ("R G W/G B W/W W W", " R G W \n\n GBW\nWWW\n", "RGW\nGBW/WWW"):
        assert CfaPattern.of_letters(letters) == CfaPattern.bayer(3)
    assert CfaPattern.of_letters("RG/BW").tile == ("RGRG", "BWBW") * 2
    assert CfaPattern.of_letters("CMWW/YWWW", channels="YMC").channels == "YMC"


def test_scattered_sites_have_the_tile_for_a_block_others_the_rectangle_around_them() -> None:
    for letters in ("WBWG/BWGW/WGWR/GWRW", "RGW/WWW/WWW/WWW/WWX/WWW", "RGB/WWW/WWW", "RWW/GWW/BWW"):
        pattern = CfaPattern.of_letters(letters, (1, 2))
        assert pattern.is_scattered
        assert pattern.block_origin == (1, 2)
        assert pattern.block_shape == (pattern.period, pattern.period)
    assert not any(pattern.is_scattered for pattern in PATTERNS[:-2])
    inner = CfaPattern.of_letters("WWWWW/WRGWW/WGBWW/WWWWW/WWWWW")
    assert (inner.block_origin, inner.block_shape) == ((1, 1), (2, 2))


def test_the_least_frames_that_hold_a_block() -> None:
    pattern = CfaPattern.bayer(6, origin=(2, 3))
    assert pattern.grid((4, 5)).inside.sum() == 1
    for shape in ((3, 5), (4, 4), (2, 2), (1, 40)):
        with pytest.raises(InputError, match=f"{shape[1]} x {shape[0]} pixels holds no whole"):
            pattern.grid(shape)
