"""Rendered in bands: the same bytes, every row once."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from offline import BEST, PAPER, band_rows, render, render_bands
from offline import tiling as product
from offline.settings import RefinementSettings, RenderSettings
from offline.tiling import bands, domain_places
from shared import CfaPattern, Mosaic
from shared.arrays import FloatArray
from tests.offline.kernels.patterns import frames
from tests.offline.scenes import every_case, shot
from tests.reference import geometry

SHAPES = [(300, 41), (437, 90), (701, 33), (60, 400)]


def stitched(mosaic: object, **settings: object) -> FloatArray:
    return np.concatenate(list(render_bands(mosaic, replace(PAPER, **settings))))  # type: ignore[arg-type]


@every_case
def test_small_frames_are_one_band(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = shot(pattern, shape)
    (band,) = render_bands(mosaic, PAPER)
    assert np.array_equal(band, render(mosaic, PAPER).rgb)


@pytest.mark.parametrize("period", [3, 4, 6, 8])
@pytest.mark.parametrize("shape", SHAPES)
def test_bands_are_the_whole(period: int, shape: tuple[int, int]) -> None:
    mosaic = shot(CfaPattern.bayer(period, origin=(period - 1, 1)), shape)
    found = list(render_bands(mosaic, PAPER))
    assert len(found) > 1 or shape[0] < 300
    assert np.array_equal(np.concatenate(found), render(mosaic, PAPER).rgb)
    assert np.array_equal(np.concatenate(list(render_bands(mosaic, BEST))), render(mosaic, BEST).rgb)


@pytest.mark.parametrize(("pattern", "shape"), frames(6, 500, seed=5))
def test_bands_of_any_pattern_are_the_whole(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = shot(pattern, shape)
    assert np.array_equal(stitched(mosaic), render(mosaic, PAPER).rgb)


def test_bands_of_a_clipped_shot_with_defects_are_the_whole() -> None:
    pattern, shape = CfaPattern.bayer(6, origin=(2, 2)), (437, 60)
    whole = shot(pattern, shape)
    signal = np.minimum(whole.signal * np.float32(1.6), whole.calibration.full_scale)
    calibration = replace(whole.calibration, defects=((3, 3), (200, 31), (300, 2)))
    mosaic = Mosaic(Mosaic(signal, pattern, calibration).codes, pattern, calibration)
    assert np.array_equal(np.concatenate(list(render_bands(mosaic, BEST))), render(mosaic, BEST).rgb)
    assert not np.array_equal(render(mosaic, replace(BEST, highlights=PAPER.highlights)).rgb, render(mosaic, BEST).rgb)


def test_wide_frames_have_low_bands_and_are_the_whole() -> None:
    mosaic = shot(CfaPattern.bayer(6, origin=(1, 0)), (290, 3500))
    assert band_rows(mosaic, PAPER) == 120 + 2 * 6
    assert np.array_equal(stitched(mosaic), render(mosaic, PAPER).rgb)


@pytest.mark.parametrize("repetitions", [0, 1, 5, 90])
def test_bands_wait_for_what_refinement_looks_at(repetitions: int) -> None:
    """Ninety repetitions look further than a band is high."""
    mosaic = shot(CfaPattern.bayer(6, origin=(2, 2)), (500, 20))
    refinement = RefinementSettings(repetitions=repetitions)
    assert np.array_equal(stitched(mosaic, refinement=refinement), render(mosaic, replace(PAPER, refinement=refinement)).rgb)


@pytest.mark.parametrize("settings", [PAPER, BEST], ids=["paper", "best"])
@pytest.mark.parametrize("period", [4, 6])
def test_threads_leave_no_trace(period: int, settings: RenderSettings, thread_counts: Iterator[int]) -> None:
    mosaic = shot(CfaPattern.bayer(period, origin=(1, 2)), (301, 290))
    whole = render(mosaic, settings)
    for _ in thread_counts:
        again = render(mosaic, settings)
        for name in ("rgb", "luminance", "chromaticity"):
            assert np.array_equal(getattr(again, name), getattr(whole, name))
        assert np.array_equal(np.concatenate(list(render_bands(mosaic, settings))), whole.rgb)


@pytest.mark.parametrize("reach", [0, 6, 300])
@pytest.mark.parametrize("core", [8, 20, 44])
@pytest.mark.parametrize(("pattern", "shape"), frames(12, 900, seed=6))
def test_bands_cover_every_row_and_patch_once(pattern: CfaPattern, shape: tuple[int, int], core: int, reach: int) -> None:
    grid = pattern.grid(shape)
    found = bands(grid, core, reach)
    (above, _), _ = grid.padding
    assert (found[0].patches[0], found[-1].patches[1]) == (0, grid.patches[0])
    assert (found[0].rows[0], found[-1].rows[1]) == (0, shape[0])
    for band, following in pairwise(found):
        assert band.patches[1] == following.patches[0]
        assert band.patches[1] % core == 0
        assert (band.patches[1] - band.patches[0]) * grid.period >= product._BAND
        assert band.rows[0] <= band.rows[1] == following.rows[0]
        assert band.rows[1] + reach <= band.patches[1] * grid.period - above or band.rows[0] == band.rows[1]
        assert band.kept == max(following.rows[0] - reach, 0)


def test_the_domain_is_the_frame_mirrored_twice() -> None:
    grid = CfaPattern.bayer(6, origin=(2, 5)).grid((9, 13))
    rows, columns = domain_places(grid)
    top, left = geometry.first_patch(CfaPattern.bayer(6, origin=(2, 5)))
    assert rows.tolist() == [geometry.mirrored(top + place, 9) for place in range(12)]
    assert columns.tolist() == [geometry.mirrored(left + place, 13) for place in range(18)]
    wider = domain_places(grid, 4)[0]
    assert wider.tolist() == [rows[geometry.mirrored(place, 12)] for place in range(-4, 16)]
