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
    study = study_of(
        folder,
        tiles=(Tile.of_period(4), Tile.of_period(6), KODAK),
        methods=("paper", "bilinear", "dlmmse", "dcb"),
    )
    figures = measured(study, folder)
    path = folder / "evaluation.html"
    path.write_bytes(
        build_page(
            figures,
            render_crops(figures, alone()),
            "panchroma 1",
            ["<b>odd</b>.png: cannot be read"],
        )
    )
    (folder / "sentences.txt").write_text("\n".join(judge(figures, figures.groups[0]).sentences))
    return path


def test_it_is_one_whole_file_with_verdict_crops_table_and_plots(written: Path) -> None:
    text = written.read_text("utf-8")
    assert all(source.startswith("data:") for source in re.findall(r'(?:src|href)="([^"]+)"', text))
    assert "<script" not in text
    assert re.search(
        "Content-Security-Policy.*\n.*default-src 'none'; img-src data:; style-src 'unsafe-inline'",
        text,
    )
    assert "&lt;b&gt;odd&lt;/b&gt;.png" in text
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
        sentences = (
            "[...document.querySelectorAll('.verdict p')].map(p => p.textContent).join('\\n')"
        )
        assert browser.evaluate(sentences) == (written.parent / "sentences.txt").read_text()
        titles = browser.evaluate(
            "[...document.querySelectorAll('article h3')].map(t => t.textContent.toLowerCase())"
        )
        assert titles[0] in (AHEAD, BEHIND)
        script = (
            "Promise.all([...document.images].map(i => i.decode().then(() => "
            "i.naturalWidth))).then(w => Math.min(...w))"
        )
        assert browser.evaluate(script) >= 48
        ink, paper = browser.evaluate(
            "[getComputedStyle(document.body).color, "
            "getComputedStyle(document.body).backgroundColor]"
        )
        light = [
            sum(map(int, each.removeprefix("rgb(").rstrip(")").split(","))) for each in (ink, paper)
        ]
        assert (light[0] - light[1]) * (1 if dark else -1) > 450
