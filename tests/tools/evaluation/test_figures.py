"""Figures, who is ahead, and what the verdict says of it: the same rows for JSON, CSV, terminal and
page.
"""

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panchroma.shared import CfaPattern
from panchroma.shared.arrays import FloatArray
from panchroma.tools.evaluation.cameras import Tile
from panchroma.tools.evaluation.figures import CRITERIA, FEW, HUE, RGB, WHOLE, Figures, Place, judge
from panchroma.tools.evaluation.metrics import Measures, colour_slopes
from panchroma.tools.evaluation.study import Case, Study
from panchroma.tools.evaluation.tables import encode_csv, encode_json, method_table, plain_text
from panchroma.tools.simulation.protocols import PaperProtocol, Protocol, SensorProtocol
from tests.tools.evaluation.examples import KODAK, measured, study_of

SET = "linear photographs"
LEVELS = (0.0, 0.03)
CLEAN, NOISY = (Place(SET, PaperProtocol(level)) for level in LEVELS)
RNG = np.random.default_rng(0)
TRUTH = RNG.random((60, 60, 3)).astype(np.float32)
NOISE = RNG.standard_normal((60, 60, 3)).astype(np.float32)
DOUBLE = 20 * np.log10(2)


def figures_of(study: Study, error: Callable[[Case], FloatArray]) -> Figures:
    """A study whose renderings have errors by case."""
    renderings = {case: TRUTH + error(case).astype(np.float32) for case in study.cases()}
    return Figures(study, {case: Measures.of(renderings[case], TRUTH) for case in renderings})


def figures_with(study: Study, **errors: FloatArray | tuple[FloatArray, FloatArray]) -> Figures:
    """A study whose renderings have the errors given, by method, and by level if there are two."""

    def error(case: Case) -> FloatArray:
        of_method = errors.get(case.method, 0.05 * NOISE)
        if isinstance(of_method, tuple):
            return of_method[LEVELS.index(case.level.level)]
        return of_method

    return figures_of(study, error)


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return study_of(tmp_path)


def test_winner_lead_and_losses(study: Study) -> None:
    figures = figures_with(
        study, paper=0.02 * NOISE, bilinear=(0.01 * NOISE, 0.08 * NOISE), dlmmse=0.04 * NOISE
    )
    assert figures.best(CLEAN, RGB, study.methods) == "bilinear"
    assert figures.best(NOISY, RGB, study.methods) == "paper"
    for place, rival, expected in ((CLEAN, "bilinear", -DOUBLE), (NOISY, "dlmmse", DOUBLE)):
        for lead in (figures.lead(place), *figures.leads(SET, place.level)):
            assert lead.rival == rival
            assert lead.value == pytest.approx(expected, abs=0.01)
    tone, (first, second, third) = judge(figures, SET)
    assert tone == "care"
    assert "paper is better than every Bayer rival at some noise levels only" in first
    assert "no noise -6.0 dB (bilinear), ahead on 0 of 2 scenes" in first
    assert "sigma 0.03 +6.0 dB (dlmmse), ahead on 2 of 2" in first
    assert second.startswith("Its largest loss on a scene is 6.0 dB in ")
    assert third.startswith("Mind: 2 scenes only")
    table = method_table(figures, SET)
    rows = zip(table.rows, table.best, strict=True)
    best = [row[0] for row, places in rows if len(row) == 1 or 1 in places]
    assert best == ["no noise", "Bayer, bilinear", "sigma 0.03", "Sparse colour, paper"]
    text = plain_text(figures)
    assert all(sentence in text for sentence in (first, second, third))
    assert f"  {RGB.text(figures.of(NOISY, 'dlmmse'))}  " in text


@pytest.mark.parametrize(
    ("paper", "rival", "odd", "tone", "standing"),
    [
        (0.01, 0.05, 0.05, "good", "better than every Bayer rival, on every scene"),
        (0.01, 0.05, 0.008, "care", "better than every Bayer rival, but not on every scene"),
        (0.05, 0.01, 0.01, "bad", "no better than the best Bayer rival"),
        (0.01, 0.01, 0.01, "bad", "no better than the best Bayer rival"),
    ],
)
def test_ours_is_called_better_only_if_it_is_on_every_scene(
    study: Study, paper: float, rival: float, odd: float, tone: str, standing: str
) -> None:
    """odd: the rivals' error on the second scene."""

    def error(case: Case) -> FloatArray:
        of_rivals = odd if case.scene.name == "scene1" else rival
        return (paper if case.method == "paper" else of_rivals) * NOISE

    verdict = judge(figures_of(study, error), SET)
    assert verdict.tone == tone
    assert f"paper is {standing}:" in verdict.sentences[0]


def test_the_verdict_says_what_it_does_not_stand_on(tmp_path: Path) -> None:
    third = judge(figures_with(study_of(tmp_path)), SET).sentences[2]
    assert "with fewer than 6 even being ahead on all of them may be chance" in third
    assert "no rival denoises" in third
    assert "no rival is learned" in third
    study = study_of(tmp_path, methods=("paper", "bm3d+dlmmse-wb"), count=FEW)
    assert judge(figures_with(study), SET).sentences[2] == "Mind: no rival is learned."

    quiet = study_of(tmp_path, methods=("paper", "bilinear"), levels=(CLEAN.level,))
    assert "denoises" not in judge(figures_with(quiet), SET).sentences[2]


def test_without_a_rival_or_ours_there_is_nothing_to_compare(tmp_path: Path) -> None:
    for name in ("paper", "bilinear"):
        figures = figures_with(study_of(tmp_path, methods=(name,)))
        (sentence,) = judge(figures, SET).sentences
        assert sentence.startswith("There is no verdict: it needs best, ")
        document = json.loads(encode_json(figures, "p", [], {}))
        assert document["verdict"] == {SET: {"tone": "care", "sentences": [sentence]}}


def test_the_worst_places_are_judged_apart_from_the_median(study: Study) -> None:
    """Ours is better nearly everywhere, and has one square of another colour."""
    spoiled = 0.004 * NOISE
    spoiled[28:32, 28:32] += np.array((0.5, -0.3, 0.4), np.float32)
    figures = figures_with(study, bilinear=0.01 * NOISE, dlmmse=0.01 * NOISE, paper=spoiled)
    assert figures.best(CLEAN, RGB, study.methods) == "paper"
    assert [figures.best(CLEAN, each, study.methods) for each in (WHOLE, HUE)] == ["bilinear"] * 2
    share = HUE.of(figures.of(CLEAN, "paper"))
    assert share == pytest.approx(100 * 4 * 4 / 30**2, abs=0.5)  # % of the pixels inside the border
    assert figures.lead(CLEAN, HUE).value == pytest.approx(-share, abs=2)
    second = judge(figures, SET).sentences[1]
    assert "Its largest loss on a scene is 24.0 dB in the worst tenth" in second


def test_too_much_colour_is_as_wrong_as_too_little(study: Study) -> None:
    """100 % of the dark colour is right: 90 % is nearer to it than 130 % and 60 %."""
    light = np.linspace(0.1, 0.9, 90, dtype=np.float32)[:, None, None]
    thirds = [np.roll((1.3, 1.0, 0.7), shift) for shift in range(3)]  # together they are grey
    truth = light * np.repeat(thirds, 30, axis=0)
    kept = {"paper": 0.9, "bilinear": 1.3, "dlmmse": 0.6}
    results = {
        case: Measures.of(
            (light + kept[case.method] * (truth - light)).astype(np.float32),
            truth.astype(np.float32),
        )
        for case in study.cases()
    }
    figures, colour = Figures(study, results), CRITERIA[-1]
    assert colour.of(figures.of(CLEAN, "bilinear")) == pytest.approx(130, abs=0.1)
    assert figures.best(CLEAN, colour, study.methods) == "paper"
    lead = figures.lead(CLEAN, colour)
    assert lead.rival == "bilinear"
    assert lead.value == pytest.approx(20, abs=0.1)


def test_a_set_with_a_missing_result_is_not_pooled(study: Study) -> None:
    full = figures_with(study)
    results = dict(full.results)
    results.popitem()  # the last method of the last scene at the last level: dlmmse
    partial = Figures(study, results)
    assert full.of(NOISY, "dlmmse") is not None
    assert partial.of(NOISY, "dlmmse") is None
    assert partial.of(CLEAN, "dlmmse") is not None
    assert "results of dlmmse are missing at sigma 0.03" in plain_text(partial)


def test_tables_hold_every_figure(tmp_path: Path) -> None:
    tiles = (Tile.of_period(4), Tile.of_period(6), KODAK)
    figures = measured(study_of(tmp_path, methods=("paper", "bilinear"), tiles=tiles), tmp_path)
    document = json.loads(encode_json(figures, "panchroma 1", ["a.txt: no picture"], {}))
    objects = document["figures"]
    rows = list(csv.DictReader(io.StringIO(encode_csv(figures).decode())))
    # Two scenes and their pool, two levels, a rival and ours with three patterns.
    assert len(objects) == len(rows) == 3 * 2 * 4
    assert document["failed"] == ["a.txt: no picture"]
    # a terminal has no use for blanks that it spells out
    assert "  RGB, 10 %  " in plain_text(figures)
    assert "\\x" not in plain_text(figures)
    assert document["protocol"]["levels"] == [0.0, 0.03]
    names, place = ("scene", "method", "level", "period"), ("scene0", "paper", 0.03, 4)
    (own,) = (item for item in objects if tuple(item[name] for name in names) == place)
    (row,) = (row for row in rows if tuple(row[name] for name in names) == (*map(str, place),))
    title = "scene0, sigma 0.03: paper K=4"
    (measures,) = (figures.results[case] for case in figures.results if case.title == title)
    expected = dict(zip(("psnr", "psnr_luminance", "psnr_chrominance"), measures.psnr, strict=True))
    for plane, quantiles in measures.quality._asdict().items():
        titles = (f"{plane}_q{percent}" for percent in (10, 25, 50, 75))
        expected |= zip(titles, quantiles, strict=True)
    for name, places in zip(("", "_error"), colour_slopes(measures.kept), strict=True):
        expected |= {f"kept_{place}{name}": value for place, value in enumerate(places, 1)}
    expected = {name: None if np.isnan(value) else value for name, value in expected.items()}
    assert {name: own[name] for name in expected} == pytest.approx(expected, abs=1e-4)
    assert own["wrong_hue"] == pytest.approx(measures.wrong_hue, abs=1e-6)
    assert float(row["rgb_q50"]) == own["rgb_q50"]
    kodak = next(item for item in objects if item["pattern"] == "Kodak")
    assert kodak["period"] is None
    assert document["protocol"]["patterns"]["Kodak"]["light"] == 2
    assert {item["pattern"] for item in objects if item["method"] == "bilinear"} == {None}


@pytest.mark.parametrize(
    ("level", "noise"), [(PaperProtocol(0.5), "sigma"), (SensorProtocol(0.5), "light")]
)
def test_rows_say_what_their_level_is(tmp_path: Path, level: Protocol, noise: str) -> None:
    figures = figures_with(study_of(tmp_path, count=1, levels=(level,)))
    for row in csv.DictReader(io.StringIO(encode_csv(figures).decode())):
        assert (row["level"], row["noise"]) == ("0.5", noise)
    rows = json.loads(encode_json(figures, "p", [], {}))["figures"]
    assert {(row["level"], row["noise"]) for row in rows} == {(0.5, noise)}


@pytest.mark.parametrize(
    "name", ["=HYPERLINK(A1)", "+1", "-1", "@SUM(A1)", " =1", "\t=1", "\r=1", "＝1"]
)
def test_no_entry_of_a_csv_is_a_formula(tmp_path: Path, name: str) -> None:
    """OWASP, CSV injection: the names of scenes and patterns are others'; numbers stay numbers."""
    tiles = (Tile(name, CfaPattern.bayer(6)),)
    study = study_of(tmp_path, methods=("paper",), count=1, levels=(CLEAN.level,), tiles=tiles)
    study = replace(study, scenes=(replace(study.scenes[0], name=name),))
    content = encode_csv(figures_with(study, paper=3 * NOISE)).decode()
    pooled, alone = csv.DictReader(io.StringIO(content))
    for case in (alone["scene"], alone["pattern"], pooled["pattern"]):
        assert (case[0], case[-1]) == ("'", name[-1])
    assert float(alone["rgb_q50"]) < 0
    ordinary = replace(study, scenes=(replace(study.scenes[0], name="a=1"),))
    assert ",a=1," in encode_csv(figures_with(ordinary)).decode()
