import numpy as np
import pytest

from panchroma.device.preview.geometry import Geometry
from panchroma.shared import CfaPattern, InputError

PATTERNS = [
    *(CfaPattern.bayer(period, origin=(1, 2)) for period in (3, 4, 5, 6, 8, 16)),
    CfaPattern.bayer(6, "GBRG"),
    CfaPattern.with_block(("RGC", "YWM", "GBR"), 8, (3, 6)),
    CfaPattern.with_block(("GR", "BG", "RG"), 7),
    CfaPattern.with_block(("WRW", "GGG", "WBW"), 6),
    CfaPattern.with_block(("RGB",), 4),
]
SCATTERED = [
    CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2)),
    CfaPattern.of_letters("RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG"),
    CfaPattern.of_letters("RG/BW"),
    CfaPattern.of_letters("RGBWW/WWWWW/WWWWW/WWCMY/WWWWW", (3, 0)),
    CfaPattern.of_letters("RGB/WWW/WWW"),
    CfaPattern.of_letters("RGBRG/GBRGB/BRWRG/RGBRG/GBGRB"),
]
EVERY = [*PATTERNS, *SCATTERED]


def letter(pattern: CfaPattern, row: int, column: int) -> str:
    """The filter at a place counted from a block's origin."""
    (down, across), period = pattern.block_origin, pattern.period
    return pattern.letters_from()[(down + row) % period][(across + column) % period]


def places(geometry: Geometry, probe: np.ndarray) -> dict[tuple[int, int], float]:
    rows, columns = geometry.window
    used = np.argwhere(probe).tolist()
    assert used
    return {(rows[row], columns[column]): float(probe[row, column]) for row, column in used}


def by_kind(geometry: Geometry) -> list[list[dict[tuple[int, int], float]]]:
    groups = np.split(geometry.probes, np.cumsum(geometry.kinds)[:-1])
    return [[places(geometry, probe) for probe in group] for group in groups]


@pytest.mark.parametrize("pattern", EVERY)
def test_interpolations_give_lines_exactly(pattern: CfaPattern) -> None:
    """From panchromatic samples of the site's own row, or column, on both sides of it.

    Scattered sites have them where their line has some nearby on both sides, and elsewhere some
    from all around: planes are kept.
    """
    geometry = Geometry(pattern)
    for axis, probes in enumerate(by_kind(geometry)[:2]):
        for (*site, _), probe in zip(geometry.sites, probes, strict=True):
            assert {letter(pattern, *place) for place in probe} == {"W"}
            assert sum(probe.values()) == 1
            steps = np.array(list(probe)) - site
            middle = np.array(list(probe.values())) @ steps
            if pattern in SCATTERED:
                places_on_line = (np.eye(2, dtype=int)[1 - axis] * step for step in range(-2, 3))
                line = [letter(pattern, *(step + site).tolist()) for step in places_on_line]
                is_on_line = "W" in line[:2] and "W" in line[3:]
                assert (not steps[:, axis].any()) >= is_on_line
                assert np.abs(steps).max() <= (3 if is_on_line else 5)
                assert np.abs(middle).max() <= np.abs(steps).sum() / 128  # the weights are rounded
            else:
                assert not steps[:, axis].any()
                assert steps[:, 1 - axis].min() < 0 < steps[:, 1 - axis].max()
                assert np.abs(middle).max() <= np.abs(steps).max() / 64


def test_interpolations_are_halfway_between_linear_and_cubic() -> None:
    """The published figures of both, for a gap of two: at the nearer of the two."""
    along = by_kind(Geometry(CfaPattern.bayer(6)))[0][0]
    linear, cubic = np.array([0, 2 / 3, 1 / 3, 0]), np.array([-0.3, 1, 0.5, -0.2])
    assert list(along) == [(0, -2), (0, -1), (0, 2), (0, 3)]
    assert np.abs(np.array(list(along.values())) - (linear + cubic) / 2).max() <= 0.5 / 64


def test_scales() -> None:
    assert Geometry.scales(CfaPattern.bayer(6)) == (1, 2, 3, 6)
    assert Geometry.scales(CfaPattern.bayer(7)) == (1, 7)
    # A block that fills a macropixel leaves it no light.
    assert Geometry.scales(CfaPattern.with_block(("RGRG", "GBGB", "RGRG", "GBGB"), 8)) == (1, 4, 8)
    with pytest.raises(InputError, match="2 x 2 sensor pixels: a pattern of period 8 has 1, 4, 8"):
        Geometry(CfaPattern.with_block(("RGRG", "GBGB", "RGRG", "GBGB"), 8), 2)
