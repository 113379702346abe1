"""Stages of one's own: what they may be, what they may return, and that they change nothing
else.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from panchroma.offline import (
    BEST,
    PAPER,
    Band,
    RenderSettings,
    RowStage,
    measure,
    render,
    row_stages,
)
from panchroma.offline.bands import Halo
from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.arrays import FloatArray
from panchroma.shared.errors import InputError
from tests.data import ROOT
from tests.offline.scenes import photographed
from tests.scenes import leaves


def shot(rows: int = 50, columns: int = 40, pattern: CfaPattern | None = None) -> Mosaic:
    pattern = pattern or CfaPattern.bayer(6, origin=(2, 3))
    return photographed(leaves(rows, columns), pattern, 0.01)


def same(shown: Band) -> Band:
    return shown


class Own(RowStage):
    """A stage that returns what a function makes of the rows that it is asked for."""

    name = "own"

    def __init__(self, made: Callable[[Band], Any] = same, *look: int) -> None:
        self._made, self._look = made, Halo(*look)

    @property
    def halo(self) -> Halo:
        return self._look

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        return self._made(band.rows(*rows))


def rendered(
    stage: RowStage, mosaic: Mosaic, settings: RenderSettings = PAPER, place: int | None = None
) -> FloatArray:
    """A render with one more stage, before that at a place of the list."""

    def stages(*given: Any) -> list[RowStage]:
        usual = row_stages(*given)
        where = len(usual) if place is None else place
        return [*usual[:where], stage, *usual[where:]]

    return render(mosaic, settings, stages=stages).rgb


@pytest.mark.parametrize("settings", [PAPER, BEST])
@pytest.mark.parametrize("look", [(), (3,), (5, 7, 2), (0, 1000)])
def test_a_stage_that_changes_nothing_changes_no_picture_wherever_it_is(
    settings: RenderSettings, look: tuple[int, ...]
) -> None:
    mosaic = shot(500, 40)
    expected = render(mosaic, settings).rgb
    for place in (0, 1, None):
        assert np.array_equal(rendered(Own(same, *look), mosaic, settings, place), expected), place


def without(name: str) -> Callable[..., list[RowStage]]:
    return lambda *given: [stage for stage in row_stages(*given) if stage.name != name]


@pytest.mark.parametrize("stages", [lambda *_: [], lambda *_: (), without("propagation")])
@pytest.mark.parametrize("settings", [PAPER, BEST])
def test_without_any_stage_the_picture_is_grey_luminance(
    stages: Callable[..., list[RowStage]], settings: RenderSettings
) -> None:
    unrefined = replace(settings, refinement=replace(PAPER.refinement, repetitions=0))
    grey = render(shot(), unrefined, stages=stages)
    assert np.isfinite(grey.rgb).all()
    if not stages(measure(shot()), settings):
        even = np.repeat(grey.luminance[..., None] / 3, 3, axis=2)
        np.testing.assert_allclose(grey.rgb, even, rtol=1e-5, atol=1e-7)


def test_stages_that_need_the_residual_say_so() -> None:
    with pytest.raises(InputError, match="no stage has measured"):
        render(shot(), stages=without("residual"))


def spoilt(value: float) -> Callable[[FloatArray], FloatArray]:
    def spoil(plane: FloatArray) -> FloatArray:
        plane = plane.copy()
        plane[-1, 2] = value
        return plane

    return spoil


def changed(name: str, change: Callable[[FloatArray], Any]) -> Callable[[Band], Band]:
    """Make something else of one plane of a band."""
    return lambda shown: replace(shown, **{name: change(getattr(shown, name))})


WRONG: list[tuple[Callable[[Band], Any], str]] = [
    (lambda shown: None, "returned NoneType, expected an offline.Band"),
    (lambda shown: shown.chromaticity, "returned ndarray, expected an offline.Band"),
    (changed("luminance", np.float64), r"a luminance that is float64 \(50, 40\), expected float32"),
    (changed("chromaticity", np.float64), "a chromaticity that is float64"),
    (changed("chromaticity", lambda plane: plane[..., 0]), r"\(50, 40\), expected .*\(50, 40, 3\)"),
    (changed("luminance", lambda plane: plane[:, 1:]), r"\(50, 39\), expected float32 \(50, 40\)"),
    (
        changed("luminance", lambda plane: None),
        "returned Band, expected an offline.Band with planes",
    ),
    (changed("luminance", spoilt(np.nan)), "luminance that is not finite"),
    (changed("chromaticity", spoilt(np.inf)), "chromaticity that is not finite"),
    (lambda shown: shown.rows(0, 49), r"a luminance that is float32 \(49, 40\)"),
    (lambda shown: replace(shown, first=3), "rows from 3 on, expected 0 to 50"),
    (lambda shown: replace(shown, residual=shown.chromaticity), "a residual that is"),
]


@pytest.mark.parametrize(("made", "words"), WRONG)
@pytest.mark.parametrize("place", [0, None])
def test_what_is_no_such_band_is_refused_and_the_stage_named(
    made: Callable[[Band], Any], words: str, place: int | None
) -> None:
    with pytest.raises(InputError, match=f"the stage 'own' (returned .*)?{words}"):
        rendered(Own(made), shot(), place=place)


def test_planes_may_lie_in_memory_as_they_like() -> None:
    turned = Own(changed("chromaticity", np.asfortranarray))
    even = Own(
        changed("chromaticity", lambda plane: np.broadcast_to(np.float32(1 / 3), plane.shape))
    )
    for settings in (PAPER, BEST):
        assert np.array_equal(rendered(turned, shot(), settings, 1), render(shot(), settings).rgb)
        assert np.isfinite(rendered(even, shot(), settings, 1)).all()


class NoStage:
    name = "nothing"


class Far(RowStage):
    halo = Halo(4)  # a class has it, too

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        return band.rows(*rows)


KIND = "expected offline.RowStage objects whose Halo has a radius from 0, an alignment from 1 on"


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        *((lambda *_, item=item: [item], KIND) for item in (Own, Far, NoStage(), None)),
        *((lambda *_, halo=halo: [Own(same, *halo)], KIND) for halo in ((0, 0), (-1,), (1.5,))),
    ],
)
def test_what_is_no_stage_is_refused(stages: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        render(shot(), BEST, stages=stages)


def test_the_readme_links_every_stage() -> None:
    page = (ROOT / "offline" / "README.md").read_text("utf-8")
    files = {path.stem for path in (ROOT / "offline" / "stages").glob("*.py")} - {"__init__"}
    assert set(re.findall(r"\[(\w+)\]\(stages/\1\.py\)", page)) == files
