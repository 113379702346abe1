import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared import CfaPattern
from shared.arrays import FloatArray
from tests.tools.evaluation.examples import measured, study_of
from tools.camera.protocols import PaperProtocol, Protocol
from tools.evaluation.claims import FEW, Claim, ahead, claims
from tools.evaluation.criteria import CHROMINANCE, CRITERIA, HUE, LUMINANCE, RGB, TENTH, WHOLE
from tools.evaluation.figures import Comparison, Figures, SetFigures
from tools.evaluation.measures import Measures
from tools.evaluation.page.page import build_page
from tools.evaluation.pattern_verdict import gains
from tools.evaluation.scene_sets import SPECTRAL
from tools.evaluation.study import Study
from tools.evaluation.tables import encode_csv, encode_json
from tools.evaluation.tiles import Tile, chosen_tiles
from tools.evaluation.verdict import caveats, comparisons, headline, losses, plain_text, worst_places

SET = "linear photographs"
CLEAN, NOISY = PaperProtocol(0.0), PaperProtocol(0.03)
LEVELS = (0.0, 0.03)
RNG = np.random.default_rng(0)
TRUTH = RNG.random((60, 60, 3)).astype(np.float32)
NOISE = RNG.standard_normal((60, 60, 3)).astype(np.float32)
GREY = np.repeat(NOISE[..., :1], 3, axis=2)


def figures_with(study: Study, errors: dict[tuple[str, float], FloatArray]) -> Figures:
    """A study whose renderings have the errors given, by method and level."""
    results = {cell: Measures.of(TRUTH + errors[cell.method, cell.level.level], TRUTH) for cell in study.cells()}
    return Figures(study, results)


def linear(figures: Figures) -> SetFigures:
    """The set of linear photographs."""
    return next(each for each in figures.sets if each.name == SET)


def even(study: Study, size: float = 0.05) -> Figures:
    """Figures of methods that all err alike."""
    return figures_with(study, {(name, level.level): np.float32(size) * NOISE for name in study.methods for level in study.levels})


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return study_of(tmp_path)


def colour(scale: float) -> FloatArray:
    error: FloatArray = (scale * (NOISE - NOISE.mean(axis=2, keepdims=True))).astype(np.float32)
    return error


def test_winner_margin_and_losses(study: Study) -> None:
    errors = {
        ("paper", 0.0): 0.02 * NOISE,
        ("bilinear", 0.0): 0.01 * NOISE,
        ("dlmmse", 0.0): 0.04 * NOISE,
        ("paper", 0.03): 0.02 * NOISE,
        ("bilinear", 0.03): 0.08 * NOISE,
        ("dlmmse", 0.03): 0.04 * NOISE,
    }
    figures = figures_with(study, errors)
    assert linear(figures).at(CLEAN).best(criterion=RGB) == "bilinear"
    assert linear(figures).at(NOISY).best(criterion=RGB) == "paper"
    double = 20 * np.log10(2)
    for level, rival, lead in ((CLEAN, "bilinear", -double), (NOISY, "dlmmse", double)):
        margin = linear(figures).at(level).margin()
        assert margin is not None
        assert margin[0] == rival
        assert margin[1] == pytest.approx(lead, abs=0.01)
    assert [lead > 0 for level in (CLEAN, NOISY) for lead in linear(figures).scene_leads(level)] == [False, False, True, True]
    lost = [each for each in linear(figures).comparisons if each.lost and each.criterion == RGB]
    assert [(each.scene, each.level, each.rival) for each in lost] == [
        (name, CLEAN, "bilinear") for name in (None, "scene0", "scene1")
    ]
    assert lost[1].lead == pytest.approx(-double, abs=0.01)
    assert "even" not in headline(linear(figures))
    assert "worse than the best at no noise in median RGB PSNR. But of the 10 other figures some are better" in headline(
        linear(figures)
    )
    said = "6.0 dB worse than the best rival, bilinear; ahead of every rival on 0 of 2 scenes, by -6.0 to -6.0 dB."
    assert said in comparisons(linear(figures))[0]
    said = "No noise, median RGB: all together -6.0 dB (bilinear); 2 of 2 scenes, most on scene0 -6.0 dB (bilinear)."
    assert said in plain_text(figures)


def test_every_figure_rival_level_and_scene_counts_as_a_loss(study: Study) -> None:
    """One of 2 x 2 x 3 x 11 comparisons is lost, whichever it is: the verdict says it, and where."""
    figures = even(study, 0.02)
    assert losses(linear(figures)).startswith("nowhere in 132 comparisons (11 figures, each rival, level and scene, and all scenes")
    before = linear(figures).comparisons
    for criterion in CRITERIA:
        for scene in (None, "scene0", "scene1"):
            one = Comparison(scene, NOISY, CRITERIA.index(criterion), "dlmmse", -2 * criterion.even)
            others = [each for each in before if (each.scene, each.level, each.criterion, each.rival) != one_of(one)]
            linear(figures).__dict__["comparisons"] = [*others, one]
            text = plain_text(figures)
            assert "Where we lose: in 1 of 132 comparisons" in text
            assert (
                f"Sigma 0.03, {criterion.title}: {'all together' if scene is None else f'1 of 2 scenes, most on {scene}'}" in text
            )


def one_of(comparison: Comparison) -> tuple[str | None, Protocol, int, str]:
    return comparison.scene, comparison.level, comparison.criterion, comparison.rival


def test_a_loss_in_colour_alone_is_no_win_everywhere(study: Study) -> None:
    """Ours is better in RGB and luminance; its chrominance is worse, and the verdict counts that in each of its three figures."""
    errors = {(name, level): 0.08 * GREY + colour(0.01) for name in ("bilinear", "dlmmse") for level in (0.0, 0.03)}
    figures = figures_with(study, {**errors, **{("paper", level): colour(0.02) for level in (0.0, 0.03)}})
    assert headline(linear(figures)).startswith(
        "Better than every Bayer rival at no noise and sigma 0.03 in median RGB PSNR. But of the"
    )
    lost = {CRITERIA[each.criterion].name for each in linear(figures).comparisons if each.lost}
    assert lost >= {"chrominance", "chrominance_q10", "psnr_chrominance"}
    assert not lost & {"rgb", "luminance", "rgb_q10", "luminance_q10", "psnr", "psnr_luminance"}
    written = json.loads(encode_json(figures, "p", []))["verdict"][SET]
    assert {each["figure"] for each in written["losses"]} == lost
    assert {(each["scene"], each["level"], each["rival"]) for each in written["losses"]} == {
        (scene, level, rival) for scene in (None, "scene0", "scene1") for level in (0.0, 0.03) for rival in ("bilinear", "dlmmse")
    }


def test_the_headline_says_what_it_does_not_stand_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = study_of(tmp_path)
    figures = even(study)
    few, denoising, learned = caveats(linear(figures))
    assert few == "Only 2 scenes: with fewer than 6, even being ahead on all of them may be chance."
    assert denoising.startswith("No rival here denoises")
    assert learned.startswith("No rival here is learned")
    lines = plain_text(figures).splitlines()
    place = lines.index(headline(linear(figures)))
    assert lines[place + 1 : place + 4] == [few, denoising, learned]
    monkeypatch.setattr("tools.evaluation.method.package_version", lambda name: "1")  # whatever is installed
    with_both = study_of(tmp_path, methods=("paper", "bm3d+menon", "demosaicnet"), count=FEW)
    assert caveats(linear(even(with_both))) == []
    quiet = study_of(tmp_path, methods=("paper", "bilinear"), levels=(CLEAN,))
    assert len(caveats(linear(even(quiet)))) == 2


def test_leads_are_counted_with_their_range() -> None:
    assert ahead([0.3, 2.1, 1.0]) == "ahead on 3 of 3 scenes, by 0.3 to 2.1 dB"
    assert ahead([0.3, -2.1, 0.01]) == "ahead on 1 of 3 scenes, by -2.1 to +0.3 dB"
    assert ahead([0.3]) == "ahead on 1 of 1 scene, by +0.3 dB"


def test_the_worst_places_are_judged_apart_from_the_median(study: Study) -> None:
    """Ours is better nearly everywhere, and has one square of another colour."""
    spoiled = 0.004 * NOISE
    spoiled[28:32, 28:32] += np.array((0.5, -0.3, 0.4), np.float32)
    errors = {(name, level): 0.01 * NOISE for name in ("bilinear", "dlmmse") for level in (0.0, 0.03)}
    figures = figures_with(study, {**errors, ("paper", 0.0): spoiled, ("paper", 0.03): spoiled})
    assert linear(figures).at(CLEAN).best(criterion=RGB) == "paper"
    assert [linear(figures).at(CLEAN).best(criterion=criterion) for criterion in (TENTH, WHOLE, HUE)] == ["bilinear"] * 3
    own = linear(figures).pooled(CLEAN, "paper")
    assert own is not None
    assert own.wrong_hue is not None
    assert own.wrong_hue == pytest.approx(4 * 4 / 30**2, abs=0.005)  # of the pixels inside the border
    hue = linear(figures).at(CLEAN).margin(HUE)
    assert hue is not None
    assert hue[1] == pytest.approx(-100 * own.wrong_hue, abs=2)
    sentence = worst_places(linear(figures))[0]
    assert sentence.startswith("No noise, worst places beside the best rivals: -")
    assert f"wrong hue in {100 * own.wrong_hue:.1f} % of the pixels, {100 * own.wrong_hue + hue[1]:.1f} %" in sentence
    assert sentence in plain_text(figures)


def test_the_best_period_is_named(tmp_path: Path) -> None:
    study = study_of(tmp_path, tiles=chosen_tiles([4, 6, 8], ()))
    error = {(0.0, "K=4"): 0.01, (0.0, "K=6"): 0.02, (0.0, "K=8"): 0.04, (0.03, "K=4"): 0.04}
    error |= {(0.03, "K=6"): 0.02, (0.03, "K=8"): 0.02}
    results = {
        cell: Measures.of(TRUTH + np.float32(error.get((cell.level.level, cell.pattern), 0.1)) * NOISE, TRUTH)
        for cell in study.cells()
    }
    figures = Figures(study, results)
    assert linear(figures).best_period(CLEAN) == pytest.approx((4, 20 * np.log10(2)), abs=0.01)
    assert linear(figures).best_period(NOISY) == (6, 0.0)
    said = "Best K of paper, and its margin over K = 6: no noise K = 4 (+6.0 dB), sigma 0.03 K = 6 (+0.0 dB)."
    assert said in plain_text(figures)
    assert [level["best_period"] for level in json.loads(encode_json(figures, "p", []))["verdict"][SET]["levels"]] == [4, 6]
    assert "Best K" not in plain_text(Figures(study_of(tmp_path), results))


def both_claims(study: Study, **errors: tuple[FloatArray, FloatArray]) -> list[Claim]:
    """The two claims; errors: of paper and dlmmse at the two levels."""
    flat = {(name, level): each for name, pair in errors.items() for level, each in zip(LEVELS, pair, strict=True)}
    flat |= {("bilinear", level): 0.2 * NOISE for level in LEVELS}
    return claims(linear(figures_with(study, flat)))


def findings(study: Study, **errors: tuple[FloatArray, FloatArray]) -> list[str]:
    return [claim.finding for claim in both_claims(study, **errors)]


def test_claims_are_shown_or_refuted_by_the_figures(study: Study) -> None:
    # Rival errs in grey: our gain is in luminance; it grows with noise.
    assert findings(study, paper=(colour(0.02), colour(0.02)), dlmmse=(colour(0.02) + 0.05 * GREY, 0.2 * NOISE)) == [
        "shown",
        "shown",
    ]
    # Our gain is in colour alone; and it shrinks.
    assert findings(study, paper=(0.02 * GREY, 0.02 * GREY), dlmmse=(colour(0.08) + 0.02 * GREY, colour(0.02) + 0.02 * GREY)) == [
        "shown in part",
        "refuted",
    ]
    assert findings(study, paper=(0.05 * NOISE, 0.05 * NOISE), dlmmse=(0.02 * NOISE, 0.1 * NOISE)) == ["refuted", "shown"]


def test_a_claim_is_shown_only_with_the_scenes_it_stands_on(tmp_path: Path) -> None:
    """On one of six scenes the rival is better: shown in part, however far ahead we are on the others."""
    study = study_of(tmp_path, methods=("paper", "dlmmse"), count=FEW)
    size = {("paper", 0.0): 0.02, ("dlmmse", 0.0): 0.04, ("paper", 0.03): 0.02, ("dlmmse", 0.03): 0.08}
    errors = {cell: size[cell.method, cell.level.level] for cell in study.cells()}
    for spoiled, finding, scenes in (
        (0.04, "shown", "6 of 6 scenes, by +6.0"),
        (0.01, "shown in part", "5 of 6 scenes, by -6.0 to +6.0"),
    ):
        for cell in errors:
            if (cell.scene.name, cell.method, cell.level) == ("scene3", "dlmmse", CLEAN):
                errors[cell] = spoiled
        results = {
            cell: Measures.of(TRUTH + np.float32(error) * (NOISE if cell.method == "paper" else GREY), TRUTH)
            for cell, error in errors.items()
        }
        claim = claims(linear(Figures(study, results)))[0]
        assert claim.finding == finding
        assert scenes.partition(",")[0] in claim.scenes
        assert "chance" not in claim.scenes
    few = both_claims(study_of(tmp_path), paper=(0.02 * NOISE, 0.02 * NOISE), dlmmse=(0.04 * GREY, 0.08 * GREY))
    assert [claim.scenes.partition(" (")[2] for claim in few] == ["fewer than 6 scenes: this may be chance)"] * 2


@pytest.mark.parametrize(("middle", "finding"), [(0.09, "shown"), (0.0797, "shown"), (0.06, "shown in part")])
def test_a_growing_lead_may_not_fall_in_between(tmp_path: Path, middle: float, finding: str) -> None:
    study = study_of(tmp_path, levels=PaperProtocol.levels((0.0, 0.01, 0.03)), methods=("paper", "dlmmse"))
    errors = {
        ("dlmmse", level.level): np.float32(size) * NOISE for level, size in zip(study.levels, (0.08, middle, 0.16), strict=True)
    }
    errors |= {("paper", level.level): 0.05 * NOISE for level in study.levels}
    assert claims(linear(figures_with(study, errors)))[1].finding == finding


def test_claims_need_a_noise_free_level_and_the_methods(tmp_path: Path) -> None:
    noisy = study_of(tmp_path, levels=PaperProtocol.levels((0.01, 0.03)))
    assert len(claims(linear(even(noisy)))) == 1
    rivals = study_of(tmp_path, methods=("bilinear",))
    assert claims(linear(even(rivals))) == []


def test_a_set_with_a_missing_result_is_not_pooled(study: Study) -> None:
    full = even(study)
    gone = next(cell for cell in full.results if cell.method == "dlmmse" and cell.level == NOISY)
    part = Figures(study, {cell: each for cell, each in full.results.items() if cell is not gone})
    assert linear(full).pooled(NOISY, "dlmmse") is not None
    assert linear(part).pooled(NOISY, "dlmmse") is None
    assert linear(part).pooled(CLEAN, "dlmmse") is not None
    assert "-" in next(line for line in plain_text(part).splitlines() if "DLMMSE" in line)
    assert caveats(linear(part))[-1].startswith("Without Bayer, DLMMSE 2005 at sigma 0.03: results of it are missing")


def test_tables_hold_every_figure(tmp_path: Path) -> None:
    figures = measured(study_of(tmp_path, tiles=chosen_tiles([4, 6], ())), tmp_path)
    document = json.loads(encode_json(figures, "panchroma 1", ["a.txt: no picture"]))
    rows = list(csv.DictReader(io.StringIO(encode_csv(figures).decode())))
    # Two scenes and their pool, two levels, two rivals and ours at two periods.
    assert len(document["figures"]) == len(rows) == 3 * 2 * 4
    assert document["failed"] == ["a.txt: no picture"]
    assert document["protocol"]["levels"] == [0.0, 0.03]
    own = next(each for each in document["figures"] if (each["scene"], each["method"], each["level"]) == ("scene0", "paper", 0.03))
    found = figures.of_scene("scene0", NOISY, "paper", Tile.of_period(own["period"]))
    assert found is not None
    assert own["rgb_q50"] == pytest.approx(found.quality.median[RGB], abs=1e-4)
    assert own["luminance_q25"] == pytest.approx(found.quality.luminance[1], abs=1e-4)
    assert own["chrominance_q75"] == pytest.approx(found.quality.chrominance[3], abs=1e-4)
    assert own["rgb_q10"] == pytest.approx(found.quality.rgb[0], abs=1e-4)
    assert own["wrong_hue"] == pytest.approx(found.wrong_hue, abs=1e-6)
    assert 0 < own["ssim"] < 1
    same = next(row for row in rows if (row["scene"], row["method"], row["level"]) == ("scene0", "paper", "0.03"))
    assert float(same["rgb_q50"]) == own["rgb_q50"]
    verdict = document["verdict"][SET]["levels"][1]
    assert set(verdict["winner"]) == {each.name for each in CRITERIA}
    assert [own[name] for name in ("psnr", "psnr_luminance", "psnr_chrominance")] == pytest.approx(found.psnr, abs=1e-4)
    assert (LUMINANCE, CHROMINANCE) == (1, 2)


def test_patterns_are_compared_with_each_other_and_with_their_planes(tmp_path: Path) -> None:
    kodak = Tile.named(CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW"), "")
    study = study_of(tmp_path, ("paper", "planes", "bilinear"), tiles=(*chosen_tiles([6], ()), kodak))
    error = {("paper", "K=6"): 0.02, ("paper", "Kodak"): 0.01, ("planes", "K=6"): 0.08, ("planes", "Kodak"): 0.04}
    results = {
        cell: Measures.of(TRUTH + np.float32(error.get((cell.method, cell.pattern), 0.02)) * NOISE, TRUTH) for cell in study.cells()
    }
    figures = Figures(study, results)
    assert study.rivals == ["bilinear"]
    assert linear(figures).best_pattern(CLEAN, RGB) == kodak
    assert list(gains(linear(figures), CLEAN, "planes").values()) == pytest.approx([20 * np.log10(4)] * 2, abs=0.02)
    text = plain_text(figures)
    assert "Best pattern at no noise: median RGB Kodak (40." in text
    assert "paper gains +12.0 to +12.0 dB over interpolated planes." in text
    assert re.search(r"Kodak +50 %  2\.00x +40\.\d +40\.\d", text)
    document = json.loads(encode_json(figures, "p", []))
    assert document["verdict"][SET]["levels"][0]["best_pattern"]["rgb"] == "Kodak"
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
    assert [remark for remark in without if "no Bayer camera" in remark]
    assert any("without AB" in remark for remark in without)
    assert any("without K=6" in remark for remark in without)
    text = plain_text(figures)
    assert "A Bayer camera is left out: these scenes have other channels than red, green and blue." in text
    assert not re.search(r"\bnan\b", text)
    assert "NaN" not in encode_json(figures, "p", []).decode()
    rows = json.loads(encode_json(figures, "p", []))["figures"]
    assert {row["wrong_hue"] for row in rows if row["group"] == SPECTRAL} == {None}
    assert not re.search(r"\bnan\b", build_page(figures, [], "p", []).decode())
