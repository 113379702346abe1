"""Defective samples in drawn scenes and photographs."""

from dataclasses import replace

import pytest

from offline import BEST, PAPER, render
from shared import Mosaic
from tests.data import photograph
from tests.offline.test_defects import SETTINGS, listing, mend, photographed, with_hot
from tools.evaluation.metrics import quality
from tools.scenes.drawn.builtin import builtin_scene
from tools.scenes.load import load_scene

SPECKS = 1e-4  # part of a drawn scene's pixels that may be taken for defects: they stand alone, one pixel small


@pytest.mark.parametrize("sigma", [0.0, 0.03])
def test_a_drawn_scene_loses_next_to_nothing(sigma: float) -> None:
    mosaic = photographed(builtin_scene(360, 240).rgb, sigma)
    assert (mend(mosaic, SETTINGS).signal != mosaic.signal).mean() <= SPECKS


@pytest.mark.parametrize("sigma", [0.0, 0.03])
def test_hot_pixels_of_a_photograph_cost_little(sigma: float) -> None:
    """0.1 % of them: at most 0.5 dB with a map, 1.5 dB without; and looking for them costs a sound photograph nothing."""
    scene = load_scene(str(photograph("linear/intel_tau_011.png"))).rgb
    mosaic = photographed(scene, sigma)
    hurt, hot = with_hot(mosaic, 0.001)
    off = replace(BEST, defects=PAPER.defects)

    def score(seen: Mosaic, settings: object = BEST) -> float:
        return quality(render(seen, settings).rgb, scene).median[0]  # type: ignore[arg-type]

    sound = score(mosaic)
    assert abs(sound - score(mosaic, off)) < 0.02
    assert sound - score(listing(hurt, hot)) < 0.5
    assert sound - score(hurt) < 1.5
    assert sound - score(hurt, off) > sound - score(hurt)
