import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest

from shared.errors import InputError
from tests.tools.evaluation.examples import alone, measured, study_of
from tools.camera.protocols import PaperProtocol
from tools.evaluation import strokes
from tools.evaluation.figures import Figures
from tools.evaluation.methods import methods
from tools.evaluation.page.page import build_page
from tools.evaluation.report import plain_text, stroke_table
from tools.evaluation.strokes import COLOURS, WIDTHS, drawing, kept, measure_strokes
from tools.evaluation.study import collect
from tools.evaluation.tables import encode_csv, encode_json
from tools.evaluation.tiles import Tile


def test_all_of_it_and_none_of_it() -> None:
    light, places = drawing()
    assert np.allclose(kept(light), 1)
    assert np.allclose(kept(np.repeat(light.mean(axis=2, keepdims=True), 3, axis=2)), 0, atol=1e-6)
    half = light.mean(axis=2, keepdims=True) + 0.5 * (light - light.mean(axis=2, keepdims=True))
    assert np.allclose(kept(half), 0.5)
    assert sorted(set(places.ravel().tolist())) == list(range(-1, len(COLOURS) * len(WIDTHS)))


def test_strokes_are_as_wide_as_said() -> None:
    light, _ = drawing()
    for column, width in enumerate(WIDTHS):
        panel = light[: strokes._PANEL, column * strokes._PANEL : (column + 1) * strokes._PANEL, 0]
        assert (panel < strokes.WHITE).mean() == pytest.approx(width / (width + strokes._APART), rel=0.2)


def test_every_method_level_and_pattern_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiles = Tile.of_period(4), Tile.of_period(6)
    study = study_of(tmp_path, ("preview", "bilinear"), count=1, tiles=tiles)
    figures = measured(study, tmp_path)
    found, failures = measure_strokes(study, tmp_path, alone())
    assert failures == []
    assert [(each.method, each.level, each.tile) for each in found] == [
        (method, level, tile)
        for level in study.levels
        for method, tile in (*(("preview", tile) for tile in tiles), ("bilinear", None))
    ]
    monkeypatch.setattr(strokes, "kept", None)  # the second time nothing is rendered
    assert measure_strokes(study, tmp_path, alone())[0] == found

    figures = Figures(study, collect(study, tmp_path), found)
    rows = [row for row in csv.DictReader(io.StringIO(encode_csv(figures).decode())) if row["group"] == "drawn strokes"]
    assert len(rows) == len(found) * len(COLOURS)
    assert float(rows[0]["kept_8"]) == pytest.approx(found[0].kept[0][0], abs=1e-4)
    document = json.loads(encode_json(figures, "", []))["strokes"]
    assert document["widths"] == list(WIDTHS)
    assert document["kept"][-1]["scene"] == "dark red"
    assert "Colour kept in strokes" in plain_text(figures)
    shown = [each for each in found if each.level == study.levels[1]]
    table = stroke_table(figures, study.levels[1])
    assert [[float(text) for text in row.texts] for row in table.rows] == [pytest.approx(each.least, abs=0.006) for each in shown]
    assert [row.best[0] for row in table.rows] == [each.least[0] == max(every.least[0] for every in shown) for each in shown]
    assert 'id="strokes"' in build_page(figures, [], "", []).decode()
    assert 'id="strokes"' not in build_page(Figures(study, figures.results), [], "", []).decode()


def test_a_damaged_result_is_made_again(tmp_path: Path) -> None:
    study = study_of(tmp_path, ("preview",), count=1, levels=PaperProtocol.levels((0.0,)))
    first, _ = measure_strokes(study, tmp_path, alone())
    (path,) = (tmp_path / "results").glob("*.json")
    for damaged in (b"", b"[[1, 2]]", b'{"a": 1}', path.read_bytes()[:-9]):
        path.write_bytes(damaged)
        assert measure_strokes(study, tmp_path, alone())[0] == first


def test_a_method_that_fails_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: object) -> None:
        raise InputError("no picture")

    study = study_of(tmp_path, ("preview", "bilinear"), count=1, levels=PaperProtocol.levels((0.0,)))
    monkeypatch.setattr(type(methods()["preview"]), "render", lambda self, cameras: fails(cameras))
    found, failures = measure_strokes(study, tmp_path, alone())
    assert (found, len(failures)) == ([], 2)
    assert failures[0] == "strokes: preview, no noise: no picture"
