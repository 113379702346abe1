"""The page, as a browser shows it."""

import re
from pathlib import Path

import pytest

from panchroma.tools.evaluation.crops import AHEAD, BEHIND, render_crops
from panchroma.tools.evaluation.page import build_page
from panchroma.tools.evaluation.tiles import Tile
from panchroma.tools.evaluation.verdict import judge
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
