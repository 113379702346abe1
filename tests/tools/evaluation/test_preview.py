"""The camera's preview beside what is easily had: of photographs, and of scattered patterns."""

import numpy as np
import pytest

from shared import CfaPattern, SensorCalibration
from shared.sensor import simulate_additive
from tests.bayer import bayer_mosaic
from tests.data import photograph
from tools.evaluation.metrics import quality
from tools.evaluation.rivals.interpolation import demosaic_bilinear
from tools.pictures.previews import linear_preview
from tools.scenes.load import load_scene

BELOW_PAPER = 2.0
"""dB of median RGB PSNR that a preview may lie below the `paper` preset, noise-free."""
PAPER_FIGURES = {"raw/rose.dng": 48.8, "linear/intel_tau_003.png": 50.5, "linear/intel_tau_011.png": 45.4}


@pytest.mark.parametrize("name", PAPER_FIGURES)
def test_quality_on_photographs(name: str) -> None:
    scene = load_scene(str(photograph(name))).rgb
    for sigma in (0, 0.01, 0.03):
        mosaic = simulate_additive(scene, CfaPattern.bayer(), SensorCalibration(), sigma, np.random.default_rng(0))
        reached = quality(linear_preview(mosaic), scene).median[0]
        bilinear = demosaic_bilinear(bayer_mosaic(scene, sigma, np.random.default_rng(0)))
        least = quality(bilinear, scene).median[0] if sigma else PAPER_FIGURES[name] - BELOW_PAPER
        assert reached > least, (sigma, reached, least)
