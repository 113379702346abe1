"""The page, as a browser shows it."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.browser import Browser
from tests.tools.evaluation.examples import KODAK, alone, measured, pair, study_of
from tools.evaluation.figures import Figures
from tools.evaluation.measures import PLANES, Measures
from tools.evaluation.methods import methods
from tools.evaluation.page.gallery import WHY_AHEAD, WHY_BEHIND, render_gallery
from tools.evaluation.page.page import _table, build_page
from tools.evaluation.page.plots import lines_of, noise_plots
from tools.evaluation.report import Row, Table
from tools.evaluation.tiles import chosen_tiles

FAILURE = "<b>odd</b>.png: cannot be read"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    figures = measured(study_of(folder, tiles=chosen_tiles([4, 6], [KODAK]), methods=("paper", "bilinear", "dlmmse", "ea")), folder)
    path = folder / "evaluation.html"
    path.write_bytes(build_page(figures, render_gallery(figures, alone()), "panchroma 1", [FAILURE]))
    return path


def test_the_page_is_one_whole_file(written: Path) -> None:
    text = written.read_text("utf-8")
    assert all(source.startswith(("data:", "#")) for source in re.findall(r'(?:src|href)="([^"]+)"', text.split("<script>")[0]))
    ids = re.findall(r' id="([^"]+)"', text)
    assert len(ids) == len(set(ids)) > 30
    assert "Permission is hereby granted" in text  # the licence of the slider
    assert FAILURE not in text
    assert "&lt;b&gt;odd&lt;/b&gt;.png" in text


def test_no_two_methods_look_alike(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=tuple(methods()), tiles=chosen_tiles([6], ()))
    (group,) = Figures(study, measured(study_of(tmp_path), tmp_path).results).sets
    looks = {(line.colour, line.dashed) for line in lines_of(group)}
    assert len(looks) == len(methods())
    dots = re.findall(r"Bayer, bilinear, 0.03: (.*?) dB \(25 % (.*?), 75 % (.*?)\)", noise_plots(group))
    figure = group.figure(study.levels[1], "bilinear")
    for plane, found in zip(PLANES, dots, strict=True):
        assert found == tuple(f"{figure.values[f'{plane}_q{each}']:.1f}" for each in (50, 25, 75))


def test_the_papers_method_is_drawn_at_first(tmp_path: Path) -> None:
    study = study_of(tmp_path, methods=("best", "unlearned", "paper", "bilinear", "malvar", "dlmmse"))
    (group,) = Figures(study, dict.fromkeys(study.cells(), Measures.of(*pair()))).sets
    assert {line.name for line in lines_of(group) if line.shown} == {"best", "paper", "dlmmse", "bilinear"}
    assert [line.name for line in lines_of(group) if line.band] == ["best", "bilinear", "dlmmse"]


@contextmanager
def showing(page: Path, profile: Path, *size: int, dark: bool = False) -> Iterator[Browser]:
    """A browser that has loaded the page."""
    with Browser(profile, *size, dark=dark) as opened:
        opened.open(page.as_uri())
        opened.until("document.readyState === 'complete'")
        yield opened


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory, written: Path) -> Iterator[Browser]:
    with showing(written, tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def test_it_loads_without_errors_and_without_network(browser: Browser, written: Path) -> None:
    assert browser.errors == []
    assert browser.requests == [written.as_uri()]


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (400, 860)])
def test_a_win_and_a_loss_open_the_page(tmp_path: Path, written: Path, width: int, height: int) -> None:
    with showing(written, tmp_path, width, height) as window:
        titles = window.evaluate("[...document.querySelectorAll('.opening h2')].map(t => t.innerText.split(':')[0].toLowerCase())")
        gallery = window.evaluate("document.querySelector('#gallery').textContent")
        assert titles == [why for why in (WHY_AHEAD, WHY_BEHIND) if f"{why}; row" in gallery] != []
        names = window.evaluate("[...document.querySelectorAll('.opening img')].map(i => i.alt)")
        assert len(names) == 3 * len(titles)
        assert names[:2] == ["truth", "Sparse colour, paper"]
        assert window.evaluate("document.querySelector('p.headline').getBoundingClientRect().bottom") < height
        assert window.evaluate("[...document.querySelectorAll('main table')].some(t => t.checkVisibility())") is False


def test_no_star_stands_at_a_tie() -> None:
    rows = [Row("a", ["1.0", "2.0"], [True, True]), Row("b", ["1.0", "1.9"], [False, False])]
    assert re.findall(r"★ (\S+?)<", _table(Table(["", "x", "y"], rows))) == ["2.0"]


def test_all_pictures_decode(browser: Browser) -> None:
    script = (
        "Promise.all([...document.images].map(i => i.decode().then(() => i.naturalWidth))).then(w => [w.length, Math.min(...w)])"
    )
    count, narrowest = browser.evaluate(script)
    assert count >= 2 * 6
    assert narrowest >= 48


def test_pictures_under_the_slider_are_chosen_and_enlarged(browser: Browser) -> None:
    same = "[...document.querySelector('#gallery .exhibit').querySelectorAll('.viewer img')].map(i => i.alt)"
    first, second = browser.evaluate(same)
    assert second == "Sparse colour, paper"
    assert first in ("bilinear", "DLMMSE 2005", "OpenCV edge-aware")
    browser.evaluate("document.querySelector('#gallery .exhibit .strip button').click()")
    assert browser.evaluate(same) == [first, "truth"]
    browser.evaluate(
        "(() => { const s = document.querySelector('#gallery select'); s.value = '1'; s.dispatchEvent(new Event('change')); })()"
    )
    assert browser.evaluate(same) == ["Sparse colour, paper", "truth"]
    wide = "document.querySelector('#gallery img-comparison-slider').getBoundingClientRect().width"
    before = browser.evaluate(wide)
    browser.evaluate("document.querySelector('#gallery .exhibit .zoom button[value=\"1\"]').click()")
    assert browser.evaluate(wide) > before


@pytest.mark.parametrize("width", [1300, 1000, 400])
def test_drop_downs_show_whole_names(tmp_path: Path, written: Path, width: int) -> None:
    with showing(written, tmp_path, width, 800) as window:
        script = """[...document.querySelectorAll('select')].map(select => {
            const style = getComputedStyle(select), context = document.createElement('canvas').getContext('2d');
            context.font = style.font;
            const longest = Math.max(...[...select.options].map(option => context.measureText(option.text).width));
            return select.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight) - 24 - longest;
        })"""
        assert min(window.evaluate(script)) > 0  # 24 pixels: the arrow
        chosen = "[...document.querySelectorAll('select')].every(s => s.title === s.selectedOptions[0].text)"
        assert window.evaluate(chosen) is True


def test_patterns_are_shown_with_pictures_and_figures(browser: Browser) -> None:
    facts = "[t.querySelectorAll('rect').length, t.querySelector('b').innerText]"
    tiles = f"[...document.querySelectorAll('#patterns .tile')].map(t => {facts})"
    assert browser.evaluate(tiles) == [[16, "K=4"], [36, "K=6"], [16, "Kodak"]]
    rows = browser.evaluate("[...document.querySelectorAll('#patterns tbody th')].map(t => t.textContent)")
    assert rows == ["K=4", "K=6", "Kodak"] * 2
    places = browser.evaluate("document.querySelectorAll('#patterns .exhibit').length")
    assert places >= 2


def test_tables_and_lines_are_switched(browser: Browser) -> None:
    shown = "[...document.querySelectorAll('[role=tabpanel]')].map(p => !p.hidden)"
    assert browser.evaluate(shown) == [True, *[False] * 11]
    browser.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    browser.evaluate("document.querySelectorAll('[role=tab]')[0].focus()")
    browser.key("ArrowRight")
    assert browser.evaluate(shown) == [False, True, *[False] * 10]
    lines = "[...document.querySelectorAll('#noise [data-series=paper]')].map(l => getComputedStyle(l).display !== 'none')"
    assert browser.evaluate(lines) == [True] * 3
    browser.evaluate("document.querySelector('#noise input[value=paper]').click()")
    assert browser.evaluate(lines) == [False] * 3


def test_it_fits_a_phone_in_the_dark(tmp_path: Path, written: Path) -> None:
    with showing(written, tmp_path, 360, 740, dark=True) as phone:
        assert phone.evaluate("document.documentElement.scrollWidth") == 360
        ink, paper = phone.evaluate("[getComputedStyle(document.body).color, getComputedStyle(document.body).backgroundColor]")
        light = [sum(map(int, each.removeprefix("rgb(").rstrip(")").split(","))) for each in (ink, paper)]
        assert light[0] - light[1] > 450
        assert phone.evaluate("document.querySelector('#gallery img-comparison-slider').getBoundingClientRect().width") <= 340
        assert phone.errors == []
