"""Figures of the paper's method on real photographs, as an independent, slow implementation of the paper has them."""

import pytest

from tests.data import photograph
from tools.camera.protocols import PaperProtocol
from tools.evaluation.measures import Measures
from tools.evaluation.scene_sets import Reading
from tools.evaluation.study import Study, render_cell
from tools.evaluation.tiles import Tile

Triple = tuple[float, float, float]
# K = 6; medians of RGB, luminance, chrominance at sigma 0, 0.01, 0.03, rounded to 0.1 dB, of its own draw of the noise.
PAPER: dict[str, tuple[Triple, Triple, Triple]] = {
    "raw/rose.dng": ((48.8, 66.4, 49.0), (44.0, 49.6, 45.4), (36.7, 40.3, 39.3)),
    "linear/intel_tau_003.png": ((50.5, 62.4, 50.9), (45.8, 49.5, 48.2), (37.9, 40.2, 41.9)),
    "linear/intel_tau_011.png": ((45.4, 52.2, 47.1), (42.9, 47.7, 45.2), (37.0, 39.7, 40.7)),
}
TOLERANCE = 0.15  # dB


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_method_scores_what_it_should(name: str) -> None:
    reading, levels = Reading(), PaperProtocol.levels((0.0, 0.01, 0.03))
    scene = reading.info(str(photograph(name)))
    study = Study((scene,), ("paper",), levels, (Tile.of_period(6),), 0, reading)
    for cell, expected in zip(study.cells(), PAPER[name], strict=True):
        measures = Measures.of(render_cell(cell, 0, reading), reading.scene(scene.source).rgb)
        assert measures.quality.median == pytest.approx(expected, abs=TOLERANCE)
