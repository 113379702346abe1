"""Rendered in bands: the same bytes, every row once."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, render, render_bands
from panchroma.offline import patches as product
from panchroma.offline.bands import Band, Halo, regroup
from panchroma.offline.patches import band_rows, patches_of
from panchroma.offline.settings import RenderSettings
from panchroma.offline.stages.refinement import RefinementSettings
from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.arrays import FloatArray
from tests.offline.kernels.patterns import frames
from tests.offline.scenes import shot

SHAPES = [(300, 41), (437, 90), (701, 33), (60, 400)]


def at_once(mosaic: Mosaic, settings: RenderSettings) -> FloatArray:
    """The picture, rendered as one band: `render` has as many as `render_bands`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(product, "_BAND", 1 << 30)
        assert len(band_rows(mosaic.pattern.grid(mosaic.shape))) == 1
        return render(mosaic, settings).rgb


# forty-five repetitions look further than a band is high
REPEATED = [
    replace(PAPER, refinement=RefinementSettings(repetitions=repetitions))
    for repetitions in (0, 1, 5, 45)
]


@pytest.mark.parametrize(
    ("period", "shape", "presets"),
    [
        *zip((3, 4, 6, 8, 6, 4), [*SHAPES, SHAPES[0], SHAPES[2]], [(PAPER, BEST)] * 6, strict=True),
        (6, (400, 14), REPEATED),
    ],
)
def test_bands_are_the_whole(
    period: int, shape: tuple[int, int], presets: Sequence[RenderSettings]
) -> None:
    mosaic = shot(CfaPattern.bayer(period, origin=(period - 1, 1)), shape)
    for settings in presets:
        found = list(render_bands(mosaic, settings))
        assert len(found) > 1 or settings is BEST or shape[0] < 300
        assert np.array_equal(np.concatenate(found), at_once(mosaic, settings))


@pytest.mark.parametrize("settings", [PAPER, BEST], ids=["paper", "best"])
@pytest.mark.parametrize("period", [4, 6])
def test_threads_leave_no_trace(
    period: int, settings: RenderSettings, each_thread_count: Iterator[int]
) -> None:
    mosaic = shot(CfaPattern.bayer(period, origin=(1, 2)), (301, 290))
    whole = render(mosaic, settings)
    for _ in each_thread_count:
        again = render(mosaic, settings)
        for name in ("rgb", "luminance", "chromaticity"):
            assert np.array_equal(getattr(again, name), getattr(whole, name))
        assert np.array_equal(np.concatenate(list(render_bands(mosaic, settings))), whole.rgb)


@pytest.mark.parametrize("chunk", [8, 20, 44])
@pytest.mark.parametrize(("pattern", "shape"), frames(12, 900, seed=6))
def test_bands_cover_every_row_and_patch_once(
    pattern: CfaPattern, shape: tuple[int, int], chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = pattern.grid(shape)
    monkeypatch.setattr(product, "chunk_patches", lambda _: (chunk, chunk))
    found = band_rows(grid)
    patches = [patches_of(grid, rows) for rows in found]
    assert (patches[0][0], patches[-1][1]) == (0, grid.patches[0])
    assert (found[0][0], found[-1][1]) == (0, shape[0])
    for (_, end), (first, _) in pairwise(found):
        assert end == first
    for (first, end), (following, _) in pairwise(patches):
        assert end == following
        assert end % chunk == 0
        assert (end - first) * grid.period >= product._BAND


@pytest.mark.parametrize("step", [1, 7, 24])
@pytest.mark.parametrize("reach", [0, 5, 30])
def test_windows_show_every_row_once_with_its_surroundings(step: int, reach: int) -> None:
    height, random = 100, np.random.default_rng(step)
    luminance = random.random((height, 3), np.float32)
    colour = random.random((height, 3, 2), np.float32)
    cuts = [0, 9, 10, 43, 60, 97, height]
    bands = (Band(first, luminance[first:end], colour[first:end]) for first, end in pairwise(cuts))
    done = 0
    for band, (first, end) in regroup(bands, height, Halo(reach, step, -3)):
        assert first == done
        assert end == height or (end + 3) % step == 0
        assert band.first <= max(first - reach, 0)
        assert band.end >= min(end + reach, height)
        assert np.array_equal(band.luminance, luminance[band.first : band.end])
        assert np.array_equal(band.rows(first, end).chromaticity, colour[first:end])
        done = end
    assert done == height
