"""Figures, who is ahead, and what the verdict says of it: the same rows for JSON, CSV, terminal and page."""

import csv
import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared import CfaPattern
from shared.arrays import FloatArray
from tests.tools.evaluation.examples import KODAK, measured, study_of
from tools.evaluation.figures import CRITERIA, HUE, RGB, TENTH_CHROMINANCE, WHOLE, Comparison, Figures, SetFigures
from tools.evaluation.measures import Measures
from tools.evaluation.page.page import build_page
from tools.evaluation.report import method_table, pattern_table, plain_text, scene_table, standing_table
from tools.evaluation.scene_sets import SPECTRAL
from tools.evaluation.study import Cell, Study
from tools.evaluation.tables import encode_csv, encode_json
from tools.evaluation.tiles import Tile, chosen_tiles
from tools.evaluation.verdict import FEW, Claim, ahead, caveats, claims, headline, losses, standing
from tools.simulation.noise import PaperProtocol

SET = "linear photographs"
LEVELS = (0.0, 0.03)
CLEAN, NOISY = map(PaperProtocol, LEVELS)
RNG = np.random.default_rng(0)
TRUTH = RNG.random((60, 60, 3)).astype(np.float32)
NOISE = RNG.standard_normal((60, 60, 3)).astype(np.float32)
GREY = np.repeat(NOISE[..., :1], 3, axis=2)
COLOUR = (NOISE - NOISE.mean(axis=2, keepdims=True)).astype(np.float32)
DOUBLE = 20 * np.log10(2)


def figures_of(study: Study, error: Callable[[Cell], FloatArray]) -> Figures:
    """A study whose renderings have errors by cell."""
    return Figures(study, {cell: Measures.of(TRUTH + error(cell).astype(np.float32), TRUTH) for cell in study.cells()})


def figures_with(study: Study, **errors: FloatArray | tuple[FloatArray, FloatArray]) -> Figures:
    """A study whose renderings have the errors given, by method, and by level if there are two."""

    def error(cell: Cell) -> FloatArray:
        found = errors.get(cell.method, 0.05 * NOISE)
        return found[LEVELS.index(cell.level.level)] if isinstance(found, tuple) else found

    return figures_of(study, error)


def linear(figures: Figures) -> SetFigures:
    """The set of linear photographs."""
    return next(each for each in figures.sets if each.name == SET)


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return study_of(tmp_path)


def test_winner_margin_and_losses(study: Study) -> None:
    figures = figures_with(study, paper=0.02 * NOISE, bilinear=(0.01 * NOISE, 0.08 * NOISE), dlmmse=0.04 * NOISE)
    group = linear(figures)
    assert [group.best(level) for level in (CLEAN, NOISY)] == ["bilinear", "paper"]
    for level, rival, lead in ((CLEAN, "bilinear", -DOUBLE), (NOISY, "dlmmse", DOUBLE)):
        for each in (group.margin(level), *group.margins(level)):
            assert each.rival == rival
            assert each.lead == pytest.approx(lead, abs=0.01)
    lost = [each for each in group.comparisons if each.lost and each.criterion == RGB]
    assert [(each.scene, each.level, each.rival) for each in lost] == [
        (name, CLEAN, "bilinear") for name in (None, "scene0", "scene1")
    ]
    assert "even" not in headline(group)
    assert "worse than the best at no noise in median RGB PSNR. But of the 11 other figures some are better" in headline(group)
    said = (
        "No noise, median RGB: -6.0 dB (bilinear); ahead on 0 of 2 scenes, -6.0 dB (scene0, bilinear) to -6.0 dB (scene1, bilinear)"
    )
    assert said in plain_text(figures)
    assert said.partition(": ")[2] == standing_table(group).rows[0].texts[0]
    table = method_table(group, RGB)
    assert [row.kind for row in table.rows] == ["ours", "", "", "margin"]
    assert [row.best for row in table.rows[:3]] == [[False, True], [True, False], [False, False]]
    assert table.rows[-1].texts == ["-6.0 dB (bilinear)", "+6.0 dB (dlmmse)"]
    medians = [f"{RGB.of(group.figure(level, 'dlmmse', 'scene1')):.1f} / " for level in (CLEAN, NOISY)]
    shown = scene_table(group, study.scenes[1].name).rows[2].texts
    assert [text.startswith(median) for text, median in zip(shown, medians, strict=True)] == [True, True]


def test_every_figure_rival_level_and_scene_counts_as_a_loss(study: Study) -> None:
    """One of 2 x 2 x 3 x 12 comparisons is lost, whichever it is, by more than counts as none."""
    group = linear(figures_with(study))
    assert losses(group).startswith("nowhere in 144 comparisons (12 figures, each rival, level and scene, and all scenes")
    before = group.comparisons
    assert len({(each.scene, each.level, each.criterion, each.rival) for each in before}) == 144
    for criterion in CRITERIA:
        for size, lost in ((-2.0, True), (-0.5, False), (2.0, False)):
            one = Comparison(None, NOISY, criterion, "dlmmse", size * criterion.even)
            assert one.lost == lost
            group.__dict__["comparisons"] = [*before[1:], one]
            assert losses(group).startswith("in 1 of 144" if lost else "nowhere in 144")


def test_a_loss_in_colour_alone_is_no_win_everywhere(study: Study) -> None:
    """Ours is better in RGB and luminance; its chrominance is worse, and the verdict counts that in each of its three figures."""
    rival = 0.08 * GREY + 0.01 * COLOUR
    figures = figures_with(study, bilinear=rival, dlmmse=rival, paper=0.02 * COLOUR)
    group = linear(figures)
    assert headline(group).startswith("Better than every Bayer rival at no noise and sigma 0.03 in median RGB PSNR. But of the")
    lost = {each.criterion.name for each in group.comparisons if each.lost}
    assert lost >= {"chrominance", "chrominance_q10", "psnr_chrominance"}
    assert not lost & {"rgb", "luminance", "rgb_q10", "luminance_q10", "psnr", "psnr_luminance"}
    written = json.loads(encode_json(figures, "p", []))["verdict"][SET]
    assert {each["figure"] for each in written["losses"]} == lost
    assert min(each["margin"] for each in written["losses"]) > 0
    assert {(each["scene"], each["level"], each["rival"]) for each in written["losses"]} == {
        (scene, level, rival) for scene in (None, "scene0", "scene1") for level in LEVELS for rival in ("bilinear", "dlmmse")
    }


def test_the_headline_says_what_it_does_not_stand_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = figures_with(study_of(tmp_path))
    few, denoising, learned = caveats(linear(figures))
    assert few == "Only 2 scenes: with fewer than 6, even being ahead on all of them may be chance."
    assert denoising.startswith("No rival here denoises")
    assert learned.startswith("No rival here is learned")
    lines = plain_text(figures).splitlines()
    place = lines.index(headline(linear(figures)))
    assert lines[place + 1 : place + 4] == [few, denoising, learned]
    monkeypatch.setattr("tools.evaluation.method.package_version", lambda name: "1")  # whatever is installed
    with_both = study_of(tmp_path, methods=("paper", "bm3d+menon", "demosaicnet"), count=FEW)
    assert caveats(linear(figures_with(with_both))) == []
    quiet = study_of(tmp_path, methods=("paper", "bilinear"), levels=(CLEAN,))
    assert len(caveats(linear(figures_with(quiet)))) == 2


def test_leads_are_counted_with_their_range() -> None:
    assert ahead([0.3, 2.1, 1.0]) == "ahead on 3 of 3 scenes, by 0.3 to 2.1 dB"
    assert ahead([0.3, -2.1, 0.01]) == "ahead on 1 of 3 scenes, by -2.1 to +0.3 dB"
    assert ahead([0.3]) == "ahead on 1 of 1 scene, by +0.3 dB"


def test_a_lead_of_all_scenes_together_is_no_claim_where_one_scene_is_lost(study: Study) -> None:
    def error(cell: Cell) -> FloatArray:
        """Of scene1 the rival is better, or even, at the second level."""
        lost = cell.scene.name == "scene1"
        sizes = {"paper": 0.02 if cell.level == CLEAN and lost else 0.01, "bilinear": 0.01 if lost else 0.05, "dlmmse": 0.2}
        return sizes[cell.method] * NOISE

    group = linear(figures_of(study, error))
    assert group.margin(CLEAN).lead > 1
    said = headline(group).partition(" in median RGB PSNR.")[0]
    assert said == (
        "Ahead of the best Bayer rival on 1 of 2 scenes, by -6.0 to +14.0 dB at no noise; "
        "ahead of the best Bayer rival on 1 of 2 scenes, by +0.0 to +14.0 dB at sigma 0.03"
    )
    even = linear(figures_with(study, paper=0.01 * NOISE, bilinear=0.01 * NOISE, dlmmse=0.02 * NOISE))
    assert headline(even).startswith("Even with the best at no noise and sigma 0.03")


def test_the_worst_places_are_judged_apart_from_the_median(study: Study) -> None:
    """Ours is better nearly everywhere, and has one square of another colour."""
    spoiled = 0.004 * NOISE
    spoiled[28:32, 28:32] += np.array((0.5, -0.3, 0.4), np.float32)
    group = linear(figures_with(study, bilinear=0.01 * NOISE, dlmmse=0.01 * NOISE, paper=spoiled))
    assert [group.best(CLEAN, each) for each in (RGB, TENTH_CHROMINANCE, WHOLE, HUE)] == ["paper", *["bilinear"] * 3]
    share = HUE.of(group.figure(CLEAN, "paper"))
    assert share == pytest.approx(100 * 4 * 4 / 30**2, abs=0.5)  # % of the pixels inside the border
    hue = group.margin(CLEAN, HUE)
    assert hue.lead == pytest.approx(-share, abs=2)
    assert HUE.difference(hue.lead).startswith("+")  # more wrong hues than the rival


def both_claims(study: Study, **errors: tuple[FloatArray, FloatArray]) -> list[Claim]:
    """The two claims; errors: of paper and dlmmse at the two levels."""
    return claims(linear(figures_with(study, bilinear=0.2 * NOISE, **errors)))


def test_claims_are_shown_or_refuted_by_the_figures(study: Study) -> None:
    colour, grey = 0.02 * COLOUR, 0.02 * GREY
    for paper, dlmmse, findings in (
        # Rival errs in grey: our gain is in luminance; it grows with noise.
        ((colour, colour), (colour + 0.05 * GREY, 0.2 * NOISE), ["shown", "shown"]),
        # Our gain is in colour alone; and it shrinks.
        ((grey, grey), (0.08 * COLOUR + grey, colour + grey), ["shown in part", "refuted"]),
        ((0.05 * NOISE, 0.05 * NOISE), (0.02 * NOISE, 0.1 * NOISE), ["refuted", "shown"]),
    ):
        assert [each.finding for each in both_claims(study, paper=paper, dlmmse=dlmmse)] == findings


@pytest.mark.parametrize(("spoiled", "finding", "scenes"), [(0.04, "shown", 6), (0.01, "shown in part", 5)])
def test_a_claim_is_shown_only_with_the_scenes_it_stands_on(tmp_path: Path, spoiled: float, finding: str, scenes: int) -> None:
    """On one of six scenes the rival is better: shown in part, however far ahead we are on the others."""
    study = study_of(tmp_path, methods=("paper", "dlmmse"), count=FEW)
    usual, odd = {0.0: 0.04 * GREY, 0.03: 0.08 * GREY}, {("scene3", 0.0): spoiled * GREY}

    def error(cell: Cell) -> FloatArray:
        return 0.02 * NOISE if cell.method == "paper" else odd.get((cell.scene.name, cell.level.level), usual[cell.level.level])

    group = linear(figures_of(study, error))
    assert ("(scene3, DLMMSE 2005) to" in standing(group, CLEAN, RGB)) == (spoiled == 0.01)  # the worst comes first
    claim = claims(group)[0]
    assert claim.finding == finding
    assert f"{scenes} of 6 scenes" in claim.scenes
    assert "chance" not in claim.scenes


def test_a_claim_on_few_scenes_may_be_chance(study: Study) -> None:
    few = both_claims(study, paper=(0.02 * NOISE, 0.02 * NOISE), dlmmse=(0.04 * GREY, 0.08 * GREY))
    assert [claim.scenes.partition(" (")[2] for claim in few] == ["fewer than 6 scenes: this may be chance)"] * 2


@pytest.mark.parametrize(("middle", "finding"), [(0.09, "shown"), (0.0797, "shown"), (0.06, "shown in part")])
def test_a_growing_lead_may_not_fall_in_between(tmp_path: Path, middle: float, finding: str) -> None:
    study = study_of(tmp_path, levels=PaperProtocol.levels((0.0, 0.01, 0.03)), methods=("paper", "dlmmse"))
    sizes = {0.0: 0.08, 0.01: middle, 0.03: 0.16}
    figures = figures_of(study, lambda cell: (sizes[cell.level.level] if cell.method == "dlmmse" else 0.05) * NOISE)
    assert claims(linear(figures))[1].finding == finding


def test_claims_need_a_noise_free_level_and_the_methods(tmp_path: Path) -> None:
    assert len(claims(linear(figures_with(study_of(tmp_path, levels=PaperProtocol.levels((0.03,))))))) == 0
    assert claims(linear(figures_with(study_of(tmp_path, methods=("bilinear",))))) == []


def test_a_set_with_a_missing_result_is_not_pooled(study: Study) -> None:
    full = figures_with(study)
    gone = next(cell for cell in full.results if cell.method == "dlmmse" and cell.level == NOISY)
    part = Figures(study, {cell: each for cell, each in full.results.items() if cell is not gone})
    assert linear(full).figure(NOISY, "dlmmse") is not None
    assert linear(part).figure(NOISY, "dlmmse") is None
    assert linear(part).figure(CLEAN, "dlmmse") is not None
    assert "–" in next(line for line in plain_text(part).splitlines() if "DLMMSE" in line)
    assert caveats(linear(part))[-1].startswith("Without Bayer, DLMMSE 2005 at sigma 0.03: results of it are missing")


def test_tables_hold_every_figure(tmp_path: Path) -> None:
    figures = measured(study_of(tmp_path, tiles=chosen_tiles([4, 6], ())), tmp_path)
    document = json.loads(encode_json(figures, "panchroma 1", ["a.txt: no picture"]))
    rows = list(csv.DictReader(io.StringIO(encode_csv(figures).decode())))
    # Two scenes and their pool, two levels, two rivals and ours at two periods.
    assert len(document["figures"]) == len(rows) == 3 * 2 * 4
    assert (document["failed"], document["protocol"]["levels"]) == (["a.txt: no picture"], [0.0, 0.03])
    place = ("scene0", "paper", 0.03, 4)
    own = next(each for each in document["figures"] if (each["scene"], each["method"], each["level"], each["period"]) == place)
    (found,) = [
        each for cell, each in figures.results.items() if (cell.scene.name, cell.level, cell.pattern) == ("scene0", NOISY, "K=4")
    ]
    for plane in ("rgb", "luminance", "chrominance"):
        quantiles = [own[f"{plane}_q{each}"] for each in (10, 25, 50, 75)]
        assert quantiles == pytest.approx(getattr(found.quality, plane), abs=1e-4)
    assert [own[name] for name in ("psnr", "psnr_luminance", "psnr_chrominance")] == pytest.approx(found.psnr, abs=1e-4)
    assert own["wrong_hue"] == pytest.approx(found.wrong_hue, abs=1e-6)
    same = next(row for row in rows if (row["scene"], row["method"], row["level"], row["period"]) == tuple(map(str, place)))
    assert float(same["rgb_q50"]) == own["rgb_q50"]
    assert set(document["verdict"][SET]["levels"][1]["winner"]) == {each.name for each in CRITERIA}


def test_patterns_are_compared_with_each_other_and_with_their_planes(tmp_path: Path) -> None:
    study = study_of(tmp_path, ("paper", "planes", "bilinear"), tiles=(*chosen_tiles([4, 6], ()), KODAK))
    sizes = {"paper": {"K=4": 0.03, "Kodak": 0.01}, "planes": {"K=6": 0.08, "Kodak": 0.04}, "bilinear": dict[str, float]()}
    figures = figures_of(study, lambda cell: sizes[cell.method].get(cell.pattern, 0.02) * NOISE)
    assert study.rivals == ["bilinear"]
    group = linear(figures)
    assert group.best_pattern(CLEAN, RGB) == KODAK
    *_, six, kodak = pattern_table(group, CLEAN).rows
    assert (kodak.title, *kodak.texts[:2], kodak.texts[-1], six.texts[-1]) == ("Kodak", "50 %", "2.00×", "+12.0", "+12.0")
    assert (kodak.best[2], six.best[2]) == (True, False)
    assert "★ 40." in build_page(figures, [], "p", []).decode()
    assert re.search(r"Kodak +50 %  2\.00× +40\.\d", plain_text(figures))
    document = json.loads(encode_json(figures, "p", []))
    verdict = document["verdict"][SET]["levels"][0]
    assert (verdict["best_pattern"]["rgb"], verdict["best_period"]) == ("Kodak", 6)
    row = next(each for each in document["figures"] if (each["method"], each["pattern"]) == ("paper", "Kodak"))
    assert (row["period"], row["panchromatic_share"], row["light"]) == (None, 0.5, 2.0)
    assert {each["pattern"] for each in document["figures"] if each["method"] == "bilinear"} == {None}


def test_scenes_of_other_channels_are_a_set_without_bayer_cameras(tmp_path: Path) -> None:
    """Two channels: there is no wrong hue, no Bayer camera, and no pattern with other letters."""
    study = study_of(tmp_path, tiles=(*chosen_tiles([6], ()), Tile("AB", CfaPattern.with_block(("AB",), 4))))
    other = replace(study.scenes[0], group=SPECTRAL, channels="AB", name="bands")
    study = replace(study, scenes=(*study.scenes, other))
    truth = {scene.name: TRUTH[..., : len(scene.channels)] for scene in study.scenes}
    results = {
        cell: Measures.of(truth[cell.scene.name] + np.float32(0.01), truth[cell.scene.name], cell.scene.channels)
        for cell in study.cells()
    }
    figures = Figures(study, results)
    assert {(cell.method, cell.pattern) for cell in results if cell.scene is other} == {("paper", "AB")}
    assert {cell.pattern for cell in results if cell.scene is not other} == {"K=6", ""}
    _, without = study.remarks()
    for words in ("no Bayer camera", "without AB", "without K=6"):
        assert any(words in remark for remark in without)
    text, written = plain_text(figures), encode_json(figures, "p", []).decode()
    assert "A Bayer camera is left out: these scenes have other channels than red, green and blue." in text
    assert not re.search(r"\bnan\b", text + build_page(figures, [], "p", []).decode())
    assert "NaN" not in written
    assert {row["wrong_hue"] for row in json.loads(written)["figures"] if row["group"] == SPECTRAL} == {None}


@pytest.mark.parametrize("name", ["=HYPERLINK(A1)", "+1", "-1", "@SUM(A1)", " =1", "\t=1", "\r=1", "＝1"])
def test_no_cell_of_a_csv_is_a_formula(tmp_path: Path, name: str) -> None:
    """OWASP, CSV injection: the names of scenes and patterns are others'; numbers stay numbers."""
    study = study_of(tmp_path, methods=("paper",), count=1, levels=(CLEAN,), tiles=(Tile(name, CfaPattern.bayer(6)),))
    study = replace(study, scenes=(replace(study.scenes[0], name=name),))
    pooled, alone = csv.DictReader(io.StringIO(encode_csv(figures_with(study, paper=3 * NOISE)).decode()))
    for cell in (alone["scene"], alone["pattern"], pooled["pattern"]):
        assert cell.startswith("'")
        assert cell.endswith(name.strip())
    assert float(alone["rgb_q50"]) < 0
    ordinary = replace(study, scenes=(replace(study.scenes[0], name="a=1"),))
    assert ",a=1," in encode_csv(figures_with(ordinary)).decode()
