from itertools import product

import numpy as np
import pytest

from device.preview.geometry import REACH, Geometry
from shared import CfaPattern
from shared.errors import InputError

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
    found = {(rows[row], columns[column]): float(probe[row, column]) for row, column in np.argwhere(probe).tolist()}
    assert found
    return found


def by_kind(geometry: Geometry) -> list[list[dict[tuple[int, int], float]]]:
    groups = np.split(geometry.probes, np.cumsum(geometry.kinds)[:-1])
    return [[places(geometry, probe) for probe in group] for group in groups]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_interpolations_give_lines_exactly(pattern: CfaPattern) -> None:
    """From panchromatic samples of the site's own row, or column, on both sides of it."""
    geometry = Geometry(pattern)
    along, down, *_ = by_kind(geometry)
    for axis, probes in ((0, along), (1, down)):
        for (*site, _), probe in zip(geometry.sites, probes, strict=True):
            assert {letter(pattern, *place) for place in probe} == {"W"}
            assert {place[axis] for place in probe} == {site[axis]}
            steps = [place[1 - axis] - site[1 - axis] for place in probe]
            assert min(steps) < 0 < max(steps)
            assert sum(probe.values()) == 1
            middle = sum(weight * step for weight, step in zip(probe.values(), steps, strict=True))
            assert abs(middle) <= max(map(abs, steps)) / 64  # the weights are rounded


@pytest.mark.parametrize("pattern", SCATTERED)
def test_scattered_sites_are_interpolated_from_around_them(pattern: CfaPattern) -> None:
    """Along the site's line where that has panchromatic samples on both sides; elsewhere from all around; planes are kept."""
    geometry = Geometry(pattern)
    along, down, *_ = by_kind(geometry)
    for axis, probes in ((0, along), (1, down)):
        for (*site, _), probe in zip(geometry.sites, probes, strict=True):
            assert {letter(pattern, *place) for place in probe} == {"W"}
            assert sum(probe.values()) == 1
            steps = np.array(list(probe)) - site
            middle = np.array(list(probe.values())) @ steps
            assert np.abs(middle).max() <= np.abs(steps).sum() / 128  # the weights are rounded
            along_line = [(0, step) if axis == 0 else (step, 0) for step in range(-2, 3)]
            line = [letter(pattern, site[0] + down, site[1] + right) for down, right in along_line]
            is_on_line = "W" in line[:2] and "W" in line[3:]
            assert (not steps[:, axis].any()) >= is_on_line
            assert np.abs(steps).max() <= (3 if is_on_line else 5)


@pytest.mark.parametrize("pattern", SCATTERED)
def test_differences_are_across_scattered_sites(pattern: CfaPattern) -> None:
    _, _, *both, _ = by_kind(Geometry(pattern))
    for probes in both:
        assert probes
        for probe in probes:
            (first, before), (second, after) = sorted(probe.items())
            assert (before, after) == (-1, 1)
            axis = int(first[0] == second[0])
            between = [(first[0], place) if axis else (place, first[1]) for place in range(first[axis] + 1, second[axis])]
            assert letter(pattern, *first) == letter(pattern, *second) == "W"
            assert between
            assert "W" not in {letter(pattern, *place) for place in between}
    for scale in Geometry.scales(pattern)[1:]:
        _, _, *both, _ = by_kind(Geometry(pattern, scale))[:5]
        for (probe,) in both:
            assert {letter(pattern, *place) for place in probe} == {"W"}
            assert sum(probe.values()) == 0
            assert len({abs(value) for value in probe.values()}) == 1
            unit = abs(next(iter(probe.values())))
            assert unit == 1 / 64 or unit * len(probe) < 3 / 4


def test_interpolations_are_halfway_between_linear_and_cubic() -> None:
    """The published figures of both, for a gap of two: at the nearer of the two."""
    along = by_kind(Geometry(CfaPattern.bayer(6)))[0][0]
    linear, cubic = np.array([0, 2 / 3, 1 / 3, 0]), np.array([-0.3, 1, 0.5, -0.2])
    assert list(along) == [(0, -2), (0, -1), (0, 2), (0, 3)]
    assert np.abs(np.array(list(along.values())) - (linear + cubic) / 2).max() <= 0.5 / 64


@pytest.mark.parametrize("pattern", PATTERNS)
def test_differences_are_of_panchromatic_neighbours_beside_the_block(pattern: CfaPattern) -> None:
    height, width = pattern.block_shape
    _, _, *both, _ = by_kind(Geometry(pattern))
    for probes, step in zip(both, ((0, 1), (1, 0)), strict=True):
        for probe in probes:
            (first, before), (second, after) = sorted(probe.items())
            assert (before, after) == (-1, 1)
            assert (second[0] - first[0], second[1] - first[1]) == step
            assert letter(pattern, *first) == letter(pattern, *second) == "W"
            assert min(*first, *second) >= -1
            assert second[0] <= height
            assert second[1] <= width
    along, down = (len(probes) for probes in both)
    assert min(along, down) >= 2 * (min(height, width) + 1)


@pytest.mark.parametrize("pattern", EVERY)
def test_samples_are_the_sites_channel_by_channel(pattern: CfaPattern) -> None:
    geometry = Geometry(pattern)
    (*_, samples) = by_kind(geometry)
    read = "".join(letter(pattern, *place) for probe in samples for place in probe)
    assert read == "".join(sorted(read, key=pattern.channels.index))
    assert len(read) == len(pattern.sites)
    assert all(list(probe.values()) == [1] for probe in samples)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_smaller_picture_reads_each_channel_as_one(pattern: CfaPattern) -> None:
    whole = by_kind(Geometry(pattern))
    for scale in Geometry.scales(pattern)[1:]:
        geometry = Geometry(pattern, scale)
        along, down, across, below, samples, *_ = by_kind(geometry)
        assert {len(along), len(down), len(samples)} == {len(pattern.channels)}
        for mean, each in ((along, whole[0]), (down, whole[1])):
            for channel, probe in enumerate(mean):
                probes = [one for one, site in zip(each, geometry.sites, strict=True) if site[2] == channel]
                assert sum(probe.values()) == 1
                for place in {place for one in probes for place in one}:
                    wanted = sum(one.get(place, 0) for one in probes) / len(probes)
                    assert abs(probe.get(place, 0) - wanted) <= 4 / 64  # the largest weight takes what rounding the others leaves
        for (probe,), axis in ((across, 1), (below, 0)):
            assert {letter(pattern, *place) for place in probe} == {"W"}
            assert {(place[axis] >= 0, value) for place, value in probe.items()} == {(True, 1 / 8), (False, -1 / 8)}


@pytest.mark.parametrize("pattern", EVERY)
def test_holes_are_where_the_filters_are(pattern: CfaPattern) -> None:
    for scale in Geometry.scales(pattern):
        geometry = Geometry(pattern, scale)
        cell, period = geometry.cell, pattern.period
        for (row, column, _), hole in zip(geometry.sites, geometry.holes, strict=True):
            number, within = divmod(hole.cell, geometry.across), divmod(hole.pixel, cell)
            place = [number[axis] * cell + within[axis] for axis in (0, 1)]
            for value, inside, half, further in zip((row, column), place, geometry.half, (hole.down, hole.right), strict=True):
                assert inside == value - half + further * period  # the patch begins `half` into its first corner's block


@pytest.mark.parametrize("pattern", EVERY)
def test_pixels_share_out_the_panchromatic_samples(pattern: CfaPattern) -> None:
    clear = np.array([[letter(pattern, row, column) == "W" for column in range(pattern.period)] for row in range(pattern.period)])
    for scale in Geometry.scales(pattern):
        geometry = Geometry(pattern, scale)
        assert np.array_equal(geometry.pixels.sum(axis=0), np.roll(clear, [-half for half in geometry.half], (0, 1)))
        for number, pixel in enumerate(geometry.pixels):
            within, cell = divmod(number, geometry.across**2)
            (down, right), (row, column) = divmod(within, geometry.within), divmod(cell, geometry.across)
            place = row * geometry.within + down, column * geometry.within + right
            places = np.argwhere(pixel) // scale
            assert (places == place).all()
            assert scale == 1 or len(places)


@pytest.mark.parametrize("pattern", EVERY)
def test_the_halo_is_what_the_outermost_probes_read(pattern: CfaPattern) -> None:
    geometry, period = Geometry(pattern), pattern.period
    above, below, left, right = geometry.halo
    sides = (above, left), (below, right)
    for half, window, reach, before, after in zip(geometry.half, geometry.window, REACH, *sides, strict=True):
        # Of one patch, counted from its first pixel: its corners' blocks, and those around them, begin at these places.
        blocks = [number * period - half for number in range(-reach, 2 + reach)]
        assert -before == blocks[0] + window.start
        assert period + after == blocks[-1] + window.stop


def test_scales() -> None:
    assert Geometry.scales(CfaPattern.bayer(6)) == (1, 2, 3, 6)
    assert Geometry.scales(CfaPattern.bayer(7)) == (1, 7)
    # A block that fills a cell leaves it no light.
    assert Geometry.scales(CfaPattern.with_block(("RGRG", "GBGB", "RGRG", "GBGB"), 8)) == (1, 4, 8)
    with pytest.raises(InputError, match="2 x 2 sensor pixels: a pattern of period 8 has 1, 4, 8"):
        Geometry(CfaPattern.with_block(("RGRG", "GBGB", "RGRG", "GBGB"), 8), 2)


def test_chromaticity_is_shared_by_two_by_two_pixels_where_they_fit() -> None:
    cells = {period: Geometry(CfaPattern.bayer(period)).cell for period in (3, 4, 6, 7, 8)}
    assert cells == {3: 1, 4: 2, 6: 2, 7: 1, 8: 2}
    assert [Geometry(CfaPattern.bayer(6), scale).cell for scale in (2, 3, 6)] == [2, 6, 6]


def test_every_origin_has_the_same_geometry() -> None:
    first = Geometry(CfaPattern.bayer(6))
    for origin in product(range(6), repeat=2):
        other = Geometry(CfaPattern.bayer(6, origin=(origin[0], origin[1])))
        assert np.array_equal(first.probes, other.probes)
        assert (first.holes, first.halo) == (other.holes, other.halo)
        assert np.array_equal(first.pixels, other.pixels)
