"""Squares that show where methods differ: chosen by the figures, and cut out of the whole
picture.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panchroma.shared.arrays import ByteArray
from panchroma.tools.evaluation.evaluation_page import (
    AHEAD,
    BEHIND,
    REASONS,
    WORST,
    Crop,
    choose_crops,
    render_crop,
    render_crops,
    render_exhibit,
)
from panchroma.tools.evaluation.metrics import WINDOW, window_origins
from panchroma.tools.evaluation.study import Study
from panchroma.tools.simulation.protocols import PaperProtocol, Protocol, SensorProtocol
from tests.tools.evaluation.examples import alone, measured, small_scene, study_of

# scene units: what a render of a part may differ from the whole frame's, half a code of 8 bits
INVISIBLE = 2e-3


def large(folder: Path, size: tuple[int, int] = (318, 342), **changes: object) -> Study:
    """One scene in which a square's surroundings do not reach the frame's border."""
    np.save(folder / "scene0.npy", small_scene(*size, 0))
    return study_of(folder, count=1, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("level", "names"),
    [
        (PaperProtocol(0.03), ("paper", "bilinear", "dcb")),
        (SensorProtocol(0.25), ("preview", "dlmmse")),
    ],
)
def test_a_square_is_cut_out_of_the_whole_rendering(
    tmp_path: Path, level: Protocol, names: tuple[str, ...]
) -> None:
    study = large(tmp_path, methods=names, levels=(level,))
    scene = study.scenes[0]
    light = study.reading.scene(scene).rgb
    crop = Crop(scene, level, WORST, names, 117, 131, WINDOW, WINDOW)
    frame = crop._replace(row=0, column=0, height=scene.rows, width=scene.columns)
    squares, pictures = (render_crop(study, place, light) for place in (crop, frame))
    for square, picture in zip(squares, pictures, strict=True):
        assert square.shape == (WINDOW, WINDOW, 3)
        assert np.quantile(np.abs(square - picture[crop.window]), 0.99) < INVISIBLE


def test_squares_are_where_methods_differ_most_and_where_we_are_worst(tmp_path: Path) -> None:
    size = (240, 264)
    study = large(tmp_path, size, methods=("preview", "bilinear", "dlmmse"))
    figures = measured(study, tmp_path)
    crops = list(choose_crops(figures))
    assert {crop.why for crop in crops} <= set(REASONS)
    assert {crop.level for crop in crops} == set(study.levels)
    for crop in crops:
        origins = map(window_origins, size)
        place = tuple(map(list.index, origins, (crop.row, crop.column)))
        errors = {
            case.method: measures.errors[place]
            for case, measures in figures.results.items()
            if case.level == crop.level
        }
        ours, rival = crop.methods
        assert ours == "preview"
        assert crop.why != AHEAD or errors["preview"] < errors[rival]
        assert crop.why != BEHIND or errors["preview"] > errors[rival]
        for other in crops:  # no two squares of a level show the same
            apart = max(abs(crop.row - other.row), abs(crop.column - other.column))
            assert other is crop or other.level != crop.level or apart >= WINDOW


def test_exhibits_show_truth_ours_and_the_best_rival(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=("paper", "bilinear", "dcb"), count=1)
    exhibits = render_crops(measured(study, tmp_path), alone())
    assert exhibits
    for _, pictures in exhibits:
        truth, ours, rival = pictures
        assert (truth.title, ours.title) == ("truth", "Sparse colour, paper")
        assert rival.title.startswith("Bayer, ")
        assert truth.pixels.shape == ours.pixels.shape == rival.pixels.shape
        assert all(10 < psnr < 90 for psnr in (ours.psnr, rival.psnr))


def test_without_rivals_the_worst_places_are_shown(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=("paper",), count=1, levels=PaperProtocol.levels((0.03,)))
    ((_, pictures),) = render_crops(measured(study, tmp_path), alone())
    assert len(pictures) == 2
    assert render_crops(measured(replace(study, methods=("bilinear",)), tmp_path), alone()) == []


def shown(study: Study, place: int = 15, size: tuple[int, int] = (48, 60)) -> ByteArray:
    crop = Crop(study.scenes[0], study.levels[0], WORST, study.methods, place, place, *size)
    return render_exhibit(study, crop)[1][0].pixels


def test_dark_scenes_are_brightened(tmp_path: Path) -> None:
    np.save(tmp_path / "scene0.npy", small_scene(78, 90, 0) / 16)
    assert shown(study_of(tmp_path, methods=("bilinear",), count=1)).mean() > 60


@pytest.mark.parametrize("tint", [(1.0, 1.0, 1.0), (0.5, 1.0, 0.6)])
def test_bright_squares_are_darkened(tmp_path: Path, tint: tuple[float, float, float]) -> None:
    """A lit surface above display white, whatever white reads, in a scene that is dark elsewhere,
    is no white square.
    """
    scene = 0.02 * small_scene(318, 342, 0)
    scene[100:220, 100:220] = small_scene(120, 120, 1) * 0.5 + 1.0
    np.save(tmp_path / "scene0.npy", (scene * np.array(tint)).astype(np.float32))
    study = study_of(tmp_path, methods=("bilinear",), count=1)
    study = replace(study, scenes=(replace(study.scenes[0], neutral=tint),))
    bright, dark = (shown(study, place, (96, 96)) for place in (112, 16))
    assert (bright == 255).all(axis=2).mean() < 0.1
    assert np.ptp(bright) > 20
    assert dark.mean() < bright.mean() / 2
