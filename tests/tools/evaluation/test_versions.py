"""The numbers that say whether a kept result is current stand for the code beside them."""

import pytest

from panchroma.tools.evaluation.cameras import CameraPair
from panchroma.tools.evaluation.measures import Measures
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.evaluation.study import MEASURING
from panchroma.tools.evaluation.tiles import Tile
from panchroma.tools.simulation.noise import PaperProtocol, Protocol, SensorProtocol
from tests.tools.evaluation.examples import small_scene

NOISY, DARK = PaperProtocol(0.02), SensorProtocol(0.25)
# By the versions of the measurement, the protocol and the method.
FIGURES = {
    (2, 1, 1, "bilinear", NOISY): (33.206, 38.882, 34.554, 32.828, 36.989, 34.929, 52.148),
    (2, 1, 1, "dlmmse", NOISY): (32.954, 34.137, 39.169, 33.005, 34.334, 38.795, 50.066),
    (2, 1, 1, "bilinear", DARK): (32.967, 37.514, 35.044, 33.591, 37.563, 35.815, 43.739),
    (2, 1, 1, "dlmmse", DARK): (34.526, 36.089, 40.271, 34.458, 36.149, 39.374, 35.822),
}


@pytest.mark.parametrize("level", [NOISY, DARK])
@pytest.mark.parametrize("name", ["bilinear", "dlmmse"])
def test_figures_are_those_of_their_versions(name: str, level: Protocol) -> None:
    """If they differ: raise the version beside the code that you changed, or kept results stay;
    then state the new figures.
    """
    truth, method = small_scene(60, 66, 0), methods()[name]
    cameras = CameraPair(level, 0, truth, Tile.of_period(6).pattern, None)
    measures = Measures.of(method.render(cameras), truth)
    figures = (*measures.quality.median, *measures.psnr, measures.errors[0, 0] * 1e5)
    expected = FIGURES[MEASURING, level.version, method.version, name, level]
    assert figures == pytest.approx(expected, abs=0.002)
