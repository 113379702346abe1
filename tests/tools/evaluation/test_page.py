"""The page, as a browser shows it."""

import re
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from panchroma.tools.evaluation.cameras import Tile
from panchroma.tools.evaluation.evaluation_page import (
    AHEAD,
    BEHIND,
    build_page,
    draw_noise,
    plots_svg,
    render_crops,
)
from panchroma.tools.evaluation.figures import Place, judge
from panchroma.tools.evaluation.metrics import PLANES
from tests.browser import Browser
from tests.tools.evaluation.examples import KODAK, alone, measured, study_of


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    tiles = (Tile.of_period(4), Tile.of_period(6), KODAK)
    study = study_of(folder, methods=("paper", "bilinear", "dcb"), count=1, tiles=tiles)
    figures, path = measured(study, folder), folder / "evaluation.html"
    failures = ["odd.png: cannot be read"]
    path.write_bytes(build_page(figures, render_crops(figures, alone()), "panchroma 1", failures))
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
        assert browser.evaluate(texts.format("article h3"))[0].lower() in (AHEAD, BEHIND)
        widths = "Promise.all([...document.images].map(i => i.decode().then(() => i.naturalWidth)))"
        assert browser.evaluate(f"{widths}.then(w => Math.min(...w))") >= 48
        colours = "['color', 'backgroundColor'].map(name => getComputedStyle(document.body)[name])"
        ink, paper = (
            sum(map(int, re.findall(r"\d+", colour))) for colour in browser.evaluate(colours)
        )
        assert (ink - paper) * (1 if dark else -1) > 450


def test_plots_show_medians_and_quartiles_of_every_method(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=("paper", "bilinear", "dlmmse"))
    figures = measured(study, tmp_path)
    (group,) = figures.groups
    for plane, title in enumerate(PLANES):
        axes = Figure().subplots()
        draw_noise(figures, group, plane, axes)
        assert len(axes.containers) == len(study.methods)
        places = []
        for name, (line, _, (bars,)) in zip(study.methods, axes.containers, strict=True):
            rows = [figures.of(Place(group, level), name).values for level in study.levels]
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


def test_a_missing_result_leaves_a_gap(tmp_path: Path) -> None:
    figures = measured(study_of(tmp_path, methods=("paper", "bilinear")), tmp_path)
    lost = next(case for case in figures.results if case.method == "bilinear" and case.level.level)
    figures = type(figures)(
        figures.study, {case: kept for case, kept in figures.results.items() if case != lost}
    )
    axes = Figure().subplots()
    draw_noise(figures, figures.groups[0], 0, axes)
    (paper, *_), (bilinear, *_) = axes.containers
    assert np.isfinite(paper.get_ydata()).all()
    assert np.isfinite(bilinear.get_ydata()).tolist() == [True, False]
    assert b"bilinear" in plots_svg(figures)


def test_the_svg_holds_all_plots_and_names_and_is_the_same_each_time(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=("paper", "bilinear"), count=1)
    figures = measured(study, tmp_path)
    before = dict(mpl.rcParams)
    svg = plots_svg(figures)
    with mpl.rc_context({"axes.facecolor": "red", "lines.linewidth": 9, "svg.hashsalt": "other"}):
        assert svg == plots_svg(figures)
    assert dict(mpl.rcParams) == before
    texts = [element.text for element in ElementTree.fromstring(svg).iter() if element.text]
    expected = ("Linear photographs: RGB", "luminance", "chrominance", "paper", "bilinear")
    assert set(expected) <= set(texts)
    assert texts.count("PSNR, dB: median and quartiles") == 3
    assert not {"date", "Date"} & {
        element.tag.rpartition("}")[2] for element in ElementTree.fromstring(svg).iter()
    }
