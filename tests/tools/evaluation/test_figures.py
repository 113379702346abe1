"""Figures, who is ahead, and what the verdict says of it: the same rows for JSON, CSV, terminal and
page.

Squares that show where methods differ: chosen by the figures, and cut out of the whole
picture.

The page, as a browser shows it.
"""

import csv
import io
import json
import re
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import imagecodecs
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from panchroma.shared import ByteArray, CfaPattern, FloatArray
from panchroma.tools.evaluation import evaluation_page as page
from panchroma.tools.evaluation.cameras import Tile
from panchroma.tools.evaluation.figures import CRITERIA, FEW, HUE, RGB, WHOLE, Figures, Place, judge
from panchroma.tools.evaluation.metrics import (
    PLANES,
    WINDOW,
    Measures,
    colour_slopes,
    window_origins,
)
from panchroma.tools.evaluation.rivals.network import network
from panchroma.tools.evaluation.study import Case, Study
from panchroma.tools.evaluation.tables import encode_csv, encode_json, method_table, plain_text
from panchroma.tools.simulation.protocols import PaperProtocol, Protocol, SensorProtocol
from tests.browser import Browser
from tests.tools.evaluation.examples import KODAK, alone, measured, small_scene, study_of
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads

# --- figures --------------------------------------------------------------------------------------

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
    bilinear = 0.01 * NOISE, 0.08 * NOISE
    figures = figures_with(study, paper=0.02 * NOISE, bilinear=bilinear, dlmmse=0.04 * NOISE)
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

    rival = network(of_quads(tmp_path, [1, 0, 0, 0, 0], inputs=QUADS))  # it need not denoise
    learned = replace(study, methods=("paper", rival.name), sources=((rival.name, rival.source),))
    assert "scene, a learned rival included." in judge(figures_with(learned), SET).sentences[2]
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
    assert "loss on a scene is 24.0 dB in the worst tenth" in judge(figures, SET).sentences[1]


def test_too_much_colour_is_as_wrong_as_too_little(study: Study) -> None:
    """100 % of the dark colour is right: 90 % is nearer to it than 130 % and 60 %."""
    part, measures = {"paper": 0.9, "bilinear": 1.3, "dlmmse": 0.6}, Measures.of(TRUTH, TRUTH)
    sums = {name: np.outer((p, 1, p * p, p, 1, 1, 1), np.ones(5)) for name, p in part.items()}
    results = {case: replace(measures, kept=sums[case.method]) for case in study.cases()}
    figures, colour = Figures(study, results), CRITERIA[-1]
    assert colour.of(figures.of(CLEAN, "bilinear")) == pytest.approx(130, abs=0.1)
    assert figures.best(CLEAN, colour, study.methods) == "paper"
    lead = figures.lead(CLEAN, colour)
    assert lead.rival == "bilinear"
    assert lead.value == pytest.approx(20, abs=0.1)


def test_a_set_with_a_missing_result_is_not_pooled_and_its_line_has_a_gap(study: Study) -> None:
    full = figures_with(study)
    results = dict(full.results)
    results.popitem()  # the last method of the last scene at the last level: dlmmse
    partial = Figures(study, results)
    assert full.of(NOISY, "dlmmse") is not None
    assert partial.of(NOISY, "dlmmse") is None
    assert partial.of(CLEAN, "dlmmse") is not None
    assert "results of dlmmse are missing at sigma 0.03" in plain_text(partial)
    rivals = Figures(study, {case: full.results[case] for case in results if case.tile is None})
    assert judge(rivals, SET).sentences[0].endswith(" RGB scenes, and all their results.")
    axes = Figure().subplots()
    page.draw_noise(partial, SET, 0, axes)
    lines = [np.isfinite(line.get_ydata()).tolist() for line, *_ in axes.containers]
    assert lines == [[True, True], [True, True], [True, False]]


def test_tables_hold_every_figure(tmp_path: Path) -> None:
    tiles = (Tile.named(CfaPattern.bayer(4)), Tile.named(CfaPattern.bayer(6)), KODAK)
    figures = figures_with(study_of(tmp_path, methods=("paper", "bilinear"), tiles=tiles))
    document = json.loads(encode_json(figures, "panchroma 1", ["a.txt: no picture"], {}))
    objects = document["figures"]
    rows = list(csv.DictReader(io.StringIO(encode_csv(figures).decode())))
    # Two scenes and their pool, two levels, a rival and ours with three patterns.
    assert len(objects) == len(rows) == 3 * 2 * 4
    assert document["failed"] == ["a.txt: no picture"]
    assert " light. Verdict, crops and plots: K=6.\n" in plain_text(figures)
    # a terminal has no use for blanks that it spells out
    assert "  RGB, 10 %  " in plain_text(figures)
    assert "\\x" not in plain_text(figures)
    protocol = document["protocol"]
    assert (protocol["kind"], protocol["levels"]) == ("paper", [0.0, 0.03])
    assert (protocol["pattern"], list(protocol["patterns"])) == ("K=6", ["K=4", "K=6", "Kodak"])
    names, place = ("scene", "method", "level", "period"), ("scene0", "paper", 0.03, 4)
    (own,) = (item for item in objects if tuple(item[name] for name in names) == place)
    (row,) = (row for row in rows if tuple(row[name] for name in names) == (*map(str, place),))
    title = "scene0, sigma 0.03: paper K=4"
    (measures,) = (figures.results[case] for case in figures.results if case.title == title)
    expected = dict(zip(("psnr", "psnr_luminance", "psnr_chrominance"), measures.psnr, strict=True))
    for plane, quantiles in zip(PLANES, measures.quality, strict=True):
        titles = (f"{plane}_q{percent}" for percent in (10, 25, 50, 75))
        expected |= zip(titles, quantiles, strict=True)
    for name, places in zip(("", "_error"), colour_slopes(measures.kept), strict=True):
        expected |= {f"kept_{place}{name}": value for place, value in enumerate(places, 1)}
    for name, value in expected.items():
        assert own[name] is None if np.isnan(value) else own[name] == pytest.approx(value, abs=1e-4)
    assert own["wrong_hue"] == pytest.approx(measures.wrong_hue, abs=1e-6)
    assert float(row["rgb_q50"]) == own["rgb_q50"]
    assert next(item for item in objects if item["pattern"] == "Kodak")["period"] is None
    assert protocol["patterns"]["Kodak"]["light"] == 2
    assert {item["pattern"] for item in objects if item["method"] == "bilinear"} == {None}


@pytest.mark.parametrize(
    ("level", "noise"), [(PaperProtocol(0.5), "sigma"), (SensorProtocol(0.5), "light")]
)
def test_rows_say_what_their_level_is(tmp_path: Path, level: Protocol, noise: str) -> None:
    figures = figures_with(study_of(tmp_path, count=1, levels=(level,)))
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


# --- crops ----------------------------------------------------------------------------------------

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
    crop = page.Crop(scene, level, page.WORST, names, 117, 131, WINDOW, WINDOW)
    frame = crop._replace(row=0, column=0, height=scene.rows, width=scene.columns)
    squares, pictures = (page.render_crop(study, place, light) for place in (crop, frame))
    for square, picture in zip(squares, pictures, strict=True):
        assert square.shape == (WINDOW, WINDOW, 3)
        assert np.quantile(np.abs(square - picture[crop.window]), 0.99) < INVISIBLE


def test_squares_are_where_methods_differ_most_and_where_we_are_worst(tmp_path: Path) -> None:
    size = (240, 264)
    study = large(tmp_path, size, methods=("preview", "bilinear", "dlmmse"))
    figures = measured(study, tmp_path)
    crops = list(page.choose_crops(figures))
    assert {crop.why for crop in crops} <= set(page.REASONS)
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
        assert crop.why != page.AHEAD or errors["preview"] < errors[rival]
        assert crop.why != page.BEHIND or errors["preview"] > errors[rival]
        for other in crops:  # no two squares of a level show the same
            apart = max(abs(crop.row - other.row), abs(crop.column - other.column))
            assert other is crop or other.level != crop.level or apart >= WINDOW


def pixels(address: str) -> ByteArray:
    return imagecodecs.png_decode(b64decode(address.partition(",")[2]))


def test_exhibits_show_truth_ours_and_the_best_rival(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=("paper", "bilinear", "dcb"), count=1)
    figures = measured(study, tmp_path)
    exhibits = page.render_crops(figures, alone())
    assert exhibits
    for exhibit in exhibits:
        (*titles, rival), (_, *psnrs), shown = zip(*exhibit["pictures"], strict=True)
        assert titles == ["truth", "Sparse colour, paper"]
        assert rival.startswith("Bayer, ")
        assert len({pixels(address).shape for address in shown}) == 1
        assert all(10 < psnr < 90 for psnr in psnrs)
    # Without rivals the worst places are shown, and nothing without ours.
    for methods, expected in ((("paper",), [2, 2]), (("bilinear",), [])):
        others = Figures(replace(study, methods=methods), figures.results)
        exhibits = page.render_crops(others, alone())
        assert [len(exhibit["pictures"]) for exhibit in exhibits] == expected


def shown(study: Study, place: int = 15, size: tuple[int, int] = (48, 60)) -> ByteArray:
    scene, level = study.scenes[0], study.levels[0]
    crop = page.Crop(scene, level, page.WORST, study.methods, place, place, *size)
    return pixels(page.render_exhibit(study, crop)["pictures"][0][2])


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


# --- page -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    tiles = (Tile.named(CfaPattern.bayer(4)), Tile.named(CfaPattern.bayer(6)), KODAK)
    study = study_of(folder, methods=("paper", "bilinear", "dcb"), count=1, tiles=tiles)
    figures, path = measured(study, folder), folder / "evaluation.html"
    failures = ["odd.png: cannot be read"]
    exhibits = page.render_crops(figures, alone())
    path.write_bytes(page.build_page(figures, exhibits, "panchroma 1", failures))
    (folder / "sentences.txt").write_text("\n".join(judge(figures, figures.groups[0]).sentences))
    return path


def test_it_is_one_whole_file_with_verdict_crops_table_and_plots(written: Path) -> None:
    text = written.read_text("utf-8")
    assert "<script" not in text
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert re.search(f"Content-Security-Policy.*\n.*{policy}", text)
    assert "odd.png: cannot be read" in text
    for name in ("paper, K=4", "paper, K=6", "paper, Kodak"):
        assert text.count(f"Sparse colour, {name}</th>") == 2
    assert text.count('class="plot"') == 3


@pytest.mark.parametrize(("width", "dark"), [(1300, False), (360, True)])
def test_a_browser_shows_it_without_errors_and_without_network(
    tmp_path: Path, written: Path, width: int, dark: bool
) -> None:
    with Browser(tmp_path, width, 860, dark=dark) as browser:
        browser.open(written.as_uri())
        browser.until("document.readyState === 'complete'")
        assert browser.errors == []
        assert browser.requests == [written.as_uri()]
        assert browser.evaluate("document.documentElement.scrollWidth") == width
        texts = "[...document.querySelectorAll('{}')].map(e => e.textContent)"
        sentences = (written.parent / "sentences.txt").read_text().split("\n")
        assert browser.evaluate(texts.format(".verdict p")) == sentences
        assert browser.evaluate(texts.format("article h3"))[0].lower() in (page.AHEAD, page.BEHIND)
        widths = "Promise.all([...document.images].map(i => i.decode().then(() => i.naturalWidth)))"
        assert browser.evaluate(f"{widths}.then(w => Math.min(...w))") >= 48
        colours = "['color', 'backgroundColor'].map(name => getComputedStyle(document.body)[name])"
        channels = (re.findall(r"\d+", colour) for colour in browser.evaluate(colours))
        ink, paper = (sum(map(int, colour)) for colour in channels)
        assert (ink - paper) * (1 if dark else -1) > 450


def test_plots_show_medians_and_quartiles_of_every_method(study: Study) -> None:
    figures = figures_with(study)
    for plane, title in enumerate(PLANES):
        axes = Figure().subplots()
        page.draw_noise(figures, SET, plane, axes)
        assert len(axes.containers) == len(study.methods)
        places = []
        for name, (line, _, (bars,)) in zip(study.methods, axes.containers, strict=True):
            rows = [figures.of(Place(SET, level), name).values for level in study.levels]
            for percent, drawn in (
                (25, [ends[0, 1] for ends in bars.get_segments()]),
                (50, line.get_ydata()),
                (75, [ends[1, 1] for ends in bars.get_segments()]),
            ):
                assert list(drawn) == pytest.approx([row[f"{title}_q{percent}"] for row in rows])
            places.append(line.get_xdata())
        apart = np.abs(np.subtract.outer(np.ravel(places), np.ravel(places)))
        assert apart[~np.eye(len(apart), dtype=bool)].min() > 0.1  # no bar hides another
        assert (np.rint(places) == [0, 1]).all()  # and each is nearest to its own level


def test_the_svg_holds_all_plots_and_names_and_is_the_same_each_time(study: Study) -> None:
    figures = figures_with(study)
    before = dict(mpl.rcParams)
    svg = page.plots_svg(figures)
    with mpl.rc_context({"axes.facecolor": "red", "lines.linewidth": 9, "svg.hashsalt": "other"}):
        assert svg == page.plots_svg(figures)
    assert dict(mpl.rcParams) == before
    texts = [element.text for element in ElementTree.fromstring(svg).iter()]
    assert {"Linear photographs: RGB", "luminance", "chrominance", *study.methods} <= set(texts)
    assert texts.count("PSNR, dB: median and quartiles") == 3
    assert b"date>" not in svg.lower()
