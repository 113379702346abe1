"""Pages hold texts that others chose, as names of files and sensors: whatever these are, a page has
the same elements.
"""

import subprocess
import sys
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from panchroma.shared import CfaPattern
from panchroma.tools.calibration.conclude import conclude
from panchroma.tools.calibration.measure import Measurements, measure_chart
from panchroma.tools.calibration.report import build_report
from panchroma.tools.evaluation.cameras import Tile
from panchroma.tools.evaluation.evaluation_page import REASONS, build_page
from panchroma.tools.evaluation.figures import Figures
from panchroma.tools.evaluation.methods import choose
from panchroma.tools.evaluation.metrics import Measures
from panchroma.tools.io.page import embed_picture, without_folders
from tests.data import ROOT
from tests.python import run_python
from tests.tools.calibration.known_camera import BLIND, REFERENCE, chart, frame, true_place
from tests.tools.evaluation.examples import pair, study_of
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads

# may be the name of a file
HOSTILE = """a"onfocus="document.title='owned'"autofocus x='<b>&quot;<!--${body}]]>`"""
PIXELS = np.zeros((8, 8, 3), np.uint8)


class Outline(HTMLParser):
    """The elements of a page, each with the names of its attributes, its attributes, and its
    texts.
    """

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, ...]] = []
        self.attributes: list[tuple[str, str]] = []
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, *(name for name, _ in attrs)))
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def stated(self, *names: str) -> set[str]:
        """The values of attributes of these names."""
        return {value for name, value in self.attributes if name in names and value}


def of_evaluation(folder: Path, text: str) -> bytes:
    """Every name and remark is the text."""
    (rival,) = choose([of_quads(folder, [1, 0, 0, 0, 0], text, order="GRBG", inputs=QUADS)])
    sources = ((rival.name, rival.source),)
    study = study_of(folder, methods=("paper", "bilinear", rival.name), sources=sources)
    scenes = tuple(
        replace(scene, name=f"{text}{number}", notes=(text,))
        for number, scene in enumerate(study.scenes)
    )
    tiles = tuple(Tile(f"{text}{period}", CfaPattern.bayer(period)) for period in (6, 4))
    study = replace(study, scenes=scenes, tiles=tiles)
    measures = Measures.of(*pair())
    pictures = [(text, psnr, embed_picture(PIXELS)) for psnr in (200.0, 30.0, 20.0)]
    exhibits = [{"title": why, "where": text, "pictures": pictures} for why in REASONS]
    figures = Figures(study, dict.fromkeys(study.cases(), measures))
    return build_page(figures, exhibits, text, [text])


def of_calibration(_: Path, text: str) -> bytes:
    """The report on a chart."""
    taken = frame(chart().rgb, says=replace(BLIND, sensor=text))
    shot = measure_chart(text, taken, Measurements(REFERENCE), true_place().corners)
    measured = Measurements(REFERENCE, taken, shots=[shot], skipped=[text])
    return build_report(conclude(measured, {"date": text}))


@pytest.mark.parametrize("make", [of_evaluation, of_calibration])
def test_a_text_stays_a_text(tmp_path: Path, make: Callable[[Path, str], bytes]) -> None:
    harmless, hostile = (Outline(make(tmp_path, text).decode()) for text in ("a", HOSTILE))
    assert hostile.elements == harmless.elements
    shown = [*hostile.texts, *(value for _, value in hostile.attributes)]
    assert sum(HOSTILE in text for text in shown) >= 4


SETTINGS = """text.usetex: True
axes.facecolor: red
svg.fonttype: path
"""
PLOT = """
import os
backend = os.environ.get("MPLBACKEND")
from panchroma.tools.io.page import embed_plot
def draw(axes):
    axes.plot([1, 2], [3, 4], label="$a_1$ <b> 漢")
    axes.legend()
print(embed_plot(draw))
import matplotlib
assert os.environ.get("MPLBACKEND") == backend
assert not matplotlib.rcParams["axes.grid"]
"""


@pytest.mark.parametrize(
    ("variable", "value"),
    [
        ("MPLCONFIGDIR", "FOLDER"),
        ("MPLBACKEND", "module://no_such_package.backend"),
        ("MPLBACKEND", "no_such_name"),  # which matplotlib refuses when it is imported
        ("", ""),  # a program that has plotted itself
    ],
)
def test_plots_show_texts_as_they_are_whatever_the_users_settings(
    variable: str, value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("MATPLOTLIBRC", "MPLCONFIGDIR", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    line = [sys.executable, "-W", "default", "-c", PLOT]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "Warning" not in done.stderr
    drawing = b64decode(done.stdout.removeprefix("data:image/svg+xml;base64,")).decode()
    assert ">$a_1$ &lt;b&gt; 漢</text>" in drawing
    script, settings = PLOT, tmp_path / "matplotlibrc"
    settings.write_text(SETTINGS)
    if variable:
        monkeypatch.setenv(variable, value.replace("FOLDER", str(tmp_path)))
    else:
        script = f"import matplotlib; matplotlib.rc_file({str(settings)!r})\n{PLOT}"
    assert run_python(script) == done.stdout


def test_folders_are_cut_off_names_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    line = f"{tmp_path}/shots/a b.dng: is not like {tmp_path}/shots/c.dng"
    for name in (f"{tmp_path}/shots", "shots", f"{tmp_path}/shots/", f"../{tmp_path.name}/shots"):
        assert without_folders(line, [name]) == "shots/a b.dng: is not like shots/c.dng"
    assert without_folders("a.dng: 1/2", ["a.dng", "/"]) == "a.dng: 1/2"
