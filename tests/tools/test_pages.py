"""Pages hold texts that others chose, as names of files and sensors: whatever these are, a page has the same elements."""

from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from shared import CfaPattern
from tests.browser import Browser
from tests.tools.calibration.known_camera import BLIND, REFERENCE, chart, frame, true_place
from tests.tools.evaluation.examples import pair, study_of
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads
from tools.batch.html import without_folders
from tools.calibration.conclude import conclude
from tools.calibration.measure import Measurements, measure_chart
from tools.calibration.report import write_report
from tools.evaluation.figures import Figures
from tools.evaluation.measures import Measures
from tools.evaluation.methods import choose
from tools.evaluation.page.gallery import WHY_AHEAD, WHY_PATTERNS, Crop, Exhibit, Rendered
from tools.evaluation.page.page import build_page
from tools.evaluation.study import Study
from tools.evaluation.tiles import Tile

HARMLESS = "a"
HOSTILE = """a"onfocus="document.title='owned'"autofocus x='<b>&quot;<!--${body}]]>`"""  # may be the name of a file
PIXELS = np.zeros((8, 8, 3), np.uint8)


class Outline(HTMLParser):
    """The elements of a page, each with the names of its attributes, and its texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, ...]] = []
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, *(name for name, _ in attrs)))
        self.texts += [value or "" for _, value in attrs]

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def exhibits(study: Study, text: str) -> list[Exhibit]:
    """One of each kind."""
    pictures = (Rendered("truth", PIXELS), Rendered(text, PIXELS, 30.0, True), Rendered(text, PIXELS, 20.0))
    places = (WHY_AHEAD, WHY_PATTERNS, text)
    return [Exhibit(Crop(study.scenes[0], study.levels[0], 20, 20, 8, 8, why), pictures, 1.0, (2, 1)) for why in places]


def of_evaluation(folder: Path, text: str) -> bytes:
    """Every name and remark is the text."""
    path = Path(of_quads(folder, [1, 0, 0, 0, 0], order="GRBG", inputs=QUADS))
    for end in (".onnx", ".json"):
        path.with_suffix(end).rename(folder / f"{text}{end}")
    (rival,) = choose([str(folder / f"{text}.onnx")])
    study = study_of(folder, methods=("paper", "bilinear", rival.name))
    scenes = tuple(replace(scene, name=f"{text}{number}", notes=(text,)) for number, scene in enumerate(study.scenes))
    tiles = tuple(Tile(f"{text}{period}", CfaPattern.bayer(period)) for period in (6, 4))
    study = replace(study, scenes=scenes, tiles=tiles)
    measures = Measures.of(*pair())
    return build_page(Figures(study, dict.fromkeys(study.cells(), measures)), exhibits(study, text), text, [text])


def of_calibration(_: Path, text: str) -> bytes:
    """The report on a chart."""
    taken = frame(chart().rgb, says=replace(BLIND, sensor=text))
    shot = measure_chart(text, taken, REFERENCE, true_place().corners)
    return write_report(conclude(Measurements(REFERENCE, taken, shots=[shot], skipped=[text])), {"date": text})


Maker = Callable[[Path, str], bytes]
MAKERS = (of_evaluation, of_calibration)


@pytest.mark.parametrize("make", MAKERS)
def test_a_text_stays_a_text(tmp_path: Path, make: Maker) -> None:
    harmless, hostile = (Outline(make(tmp_path, text).decode()) for text in (HARMLESS, HOSTILE))
    assert hostile.elements == harmless.elements
    assert sum(HOSTILE in text for text in hostile.texts) >= 4


@pytest.mark.parametrize("make", [of_evaluation])
def test_a_page_does_not_tell_where_files_are(tmp_path: Path, make: Maker) -> None:
    assert str(tmp_path) not in make(tmp_path, HARMLESS).decode()


def test_folders_are_cut_off_names_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    line = f"{tmp_path}/shots/a b.dng: is not like {tmp_path}/shots/c.dng"
    for names in ([str(tmp_path / "shots")], ["shots"], [f"{tmp_path}/shots/"], ["../" + tmp_path.name + "/shots"]):
        assert without_folders(line, names) == "shots/a b.dng: is not like shots/c.dng"
    assert without_folders("a.dng: 1/2", ["a.dng", "/"]) == "a.dng: 1/2"


def test_a_name_runs_no_script_and_its_lines_are_switched(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_bytes(of_evaluation(tmp_path, HOSTILE))
    with Browser(tmp_path / "profile") as browser:
        browser.open(page.as_uri())
        browser.until("document.readyState === 'complete'")
        browser.evaluate("document.querySelectorAll('input, select, button, label').forEach(e => e.focus())")
        assert browser.evaluate("document.title") == "Panchroma: is this camera better?"
        switch = "[...document.querySelectorAll('#noise input')].find(i => i.value.includes('owned'))"
        lines = f"[...document.querySelectorAll('#noise g')].filter(g => g.dataset.series === {switch}.value)"
        hidden = f"{lines}.map(g => g.matches('.off'))"
        before = browser.evaluate(hidden)
        assert len(before) == 3
        browser.evaluate(f"{switch}.click()")
        assert browser.evaluate(hidden) == [not each for each in before]
        assert browser.errors == []
