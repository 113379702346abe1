from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.tools.evaluation.examples import alone, measured, small_scene, study_of
from tools.evaluation.measures import WINDOW, window_origins
from tools.evaluation.methods import methods
from tools.evaluation.page.gallery import (
    WHY_AHEAD,
    WHY_BEHIND,
    WHY_HUE,
    WHY_WORST,
    Crop,
    Exhibit,
    choose_crops,
    render_crop,
    render_exhibit,
    render_gallery,
)
from tools.evaluation.scene_sets import Reading
from tools.evaluation.study import Study, render_cell
from tools.simulation.noise import PaperProtocol, Protocol, SensorProtocol

INVISIBLE = 2e-3  # scene units: what a render of a part may differ from the whole frame's, half a code of 8 bits


def large(folder: Path, **changes: object) -> Study:
    """One scene in which a square's surroundings do not reach the frame's border."""
    np.save(folder / "scene0.npy", small_scene(318, 342, 0))
    return study_of(folder, count=1, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("level", "names"), [(PaperProtocol(0.03), ("paper", "bilinear", "dcb")), (SensorProtocol(0.25), ("preview", "dlmmse"))]
)
def test_a_square_is_cut_out_of_the_whole_rendering(tmp_path: Path, level: Protocol, names: tuple[str, ...]) -> None:
    study = large(tmp_path, methods=names, levels=(level,))
    scene = study.scenes[0]
    crop = Crop(scene, level, 117, 131, WINDOW, WINDOW, WHY_WORST)
    parts = dict(render_crop(study, crop, study.reading.scene(scene.source).rgb, study.methods))
    assert tuple(parts) == study.methods
    for name, part in parts.items():
        method = methods()[name]
        whole = render_cell(study.cell(scene, level, method, study.tile if method.sparse else None), study.seed, study.reading)
        assert part.shape == (WINDOW, WINDOW, 3)
        difference = np.abs(part - whole[crop.part])
        assert np.quantile(difference, 0.99) < INVISIBLE, name


def test_squares_are_where_methods_differ_most_and_where_we_are_worst(tmp_path: Path) -> None:
    study = large(tmp_path, methods=("preview", "bilinear", "dlmmse"))
    figures = measured(study, tmp_path)
    crops = list(choose_crops(figures))
    assert {crop.why for crop in crops} <= {WHY_AHEAD, WHY_BEHIND, WHY_WORST, WHY_HUE}
    assert {crop.level for crop in crops} == set(study.levels)
    worst = next(crop for crop in crops if crop.why == WHY_WORST and crop.level == study.levels[1])
    taken = [crop for crop in crops if crop.level == study.levels[1] and crop is not worst]
    cell = study.cell(study.scenes[0], study.levels[1], methods()["preview"], study.tile)
    truth, rendered = study.reading.scene(cell.scene.source).rgb, render_cell(cell, study.seed, study.reading)
    assert np.mean((rendered[worst.part] - truth[worst.part]) ** 2) <= figures.results[cell].errors.max() * 1.001
    for crop in crops:
        place = tuple(window_origins(size).index(at) for size, at in ((318, crop.row), (342, crop.column)))
        errors = {cell.method: each.errors[place] for cell, each in figures.results.items() if cell.level == crop.level}
        rival = min(errors["bilinear"], errors["dlmmse"])
        assert crop.why != WHY_AHEAD or errors["preview"] < rival
        assert crop.why != WHY_BEHIND or errors["preview"] > rival
    for crop in taken:  # no two squares of a level show the same
        assert max(abs(crop.row - worst.row), abs(crop.column - worst.column)) >= WINDOW


def test_exhibits_show_truth_ours_and_rivals(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=("paper", "bilinear", "dlmmse", "dcb"))
    figures = measured(study, tmp_path)
    exhibits = render_gallery(figures, alone())
    assert exhibits
    for each in exhibits:
        names = [picture.name for picture in each.pictures]
        assert names[:2] == ["truth", "Sparse colour, paper"]
        assert "DLMMSE 2005" in names
        assert [picture.ours for picture in each.pictures] == [False, True, *[False] * (len(names) - 2)]
        assert names[each.shown[1]] == "Sparse colour, paper"
        assert names[each.shown[0]] not in ("truth", "Sparse colour, paper")
        assert len({picture.pixels.shape for picture in each.pictures}) == 1
        assert each.pictures[0].psnr is None
        for picture in each.pictures[1:]:
            assert 10 < picture.psnr < 80


def exhibit(study: Study) -> Exhibit:
    """The middle of the first scene."""
    return render_exhibit(study, (Crop(study.scenes[0], study.levels[0], 15, 15, 48, 60, WHY_WORST), study.methods))


def test_dark_scenes_are_brightened(tmp_path: Path) -> None:
    np.save(tmp_path / "scene0.npy", small_scene(78, 90, 0) / 16)
    study = study_of(tmp_path, methods=("bilinear",), count=1)
    shown = exhibit(study)
    assert shown.stops > 3
    assert shown.pictures[0].pixels.mean() > 60
    assert Reading().scene(study.scenes[0].source).rgb.max() < 0.06


@pytest.mark.parametrize("tint", [(1.0, 1.0, 1.0), (0.5, 1.0, 0.6)])
def test_bright_squares_are_darkened(tmp_path: Path, tint: tuple[float, float, float]) -> None:
    """A lit surface above display white, whatever white reads, in a scene that is dark elsewhere, is no white square."""
    scene = 0.02 * small_scene(318, 342, 0)
    scene[100:220, 100:220] = small_scene(120, 120, 1) * 0.5 + 1.0
    np.save(tmp_path / "scene0.npy", (scene * np.array(tint)).astype(np.float32))
    study = study_of(tmp_path, methods=("bilinear",), count=1)
    study = replace(study, scenes=(replace(study.scenes[0], neutral=tint),))
    bright, dark = (
        render_exhibit(study, (Crop(study.scenes[0], study.levels[1], place, place, 96, 96, WHY_WORST), study.methods))
        for place in (112, 16)
    )
    truth, other = (picture.pixels.astype(int) for picture in bright.pictures)
    assert bright.stops < 0 == dark.stops
    assert (truth == 255).all(axis=2).mean() < 0.1
    assert np.ptp(truth) > 20
    assert np.abs(truth - other).mean() > 1


def test_a_square_is_shown_by_its_place_in_the_photograph(tmp_path: Path) -> None:
    study = large(tmp_path)
    middle = replace(study, scenes=(Reading(largest=150).info(study.scenes[0].source),))
    for each in (study, middle):
        scene = each.scenes[0]
        row, column = (place - first for place, first in zip((100, 120), scene.origin, strict=True))
        crop = Crop(scene, each.levels[0], row, column, 50, 50, WHY_WORST)
        assert crop.place == "row 100, column 120"
        part = replace(each.reading, largest=150 if each is middle else None).scene(scene.source).rgb[crop.part]
        np.testing.assert_array_equal(part, np.load(scene.source)[100:150, 120:170])


def test_without_rivals_there_is_no_gallery(tmp_path: Path) -> None:
    figures = measured(study_of(tmp_path, methods=("paper",), count=1, levels=PaperProtocol.levels((0.03,))), tmp_path)
    assert render_gallery(figures, alone()) == []
