"""The camera's preview beside what is easily had: of photographs, and of scattered patterns."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.sensor import simulate_additive
from tests.bayer import bayer_mosaic
from tests.data import photograph
from tools.evaluation.metrics import Quality, quality
from tools.evaluation.rivals.bilinear import demosaic_bilinear
from tools.pictures.previews import linear_preview
from tools.scenes.drawn.builtin import builtin_scene
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


SCATTERED = {
    "Kodak": CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2)),
    "Kaizu": CfaPattern.of_letters("RWGWBW/WRWGWB/GWBWRW/WGWBWR/BWRWGW/WBWRWG"),
    "few panchromatic": CfaPattern.of_letters("RG/BW"),
}


def tile_means(mosaic: Mosaic) -> FloatArray:
    """What is easily had: luminance at the sites is the mean around them, colour the quotient of sums over a tile."""
    signal, planes = mosaic.signal.astype(float), mosaic.pattern.filter_map(mosaic.shape)
    clear, size = planes == len(mosaic.pattern.channels), mosaic.pattern.period

    def mean(values: np.ndarray, side: int) -> np.ndarray:
        return np.asarray(uniform_filter(values, side, mode="mirror"))

    light = np.where(clear, signal, mean(np.where(clear, signal, 0.0), 3) / mean(clear.astype(float), 3))
    sums = [mean(np.where(planes == n, signal, 0), size) / (mean(np.where(planes == n, light, 0), size) + 1e-3) for n in range(3)]
    return np.stack([light * each / (sum(sums) + 1e-3) for each in sums], axis=-1).astype(np.float32)


@pytest.mark.parametrize("name", SCATTERED)
def test_quality_of_scattered_patterns(name: str) -> None:
    """Ahead of what is easily had, in a scene without colour too, where luminance alone makes colours; even light has none."""
    scene, pattern = builtin_scene(300, 200).rgb, SCATTERED[name]
    grey = np.repeat(scene.mean(axis=2, keepdims=True), 3, axis=2)

    def reached(light: FloatArray, sigma: float) -> tuple[Quality, Quality]:
        mosaic = simulate_additive(light, pattern, SensorCalibration.of_bits(14), sigma, np.random.default_rng(0))
        return quality(linear_preview(mosaic), light), quality(tile_means(mosaic), light)

    ours, easy = reached(scene, 0.0)
    assert ours.rgb[2] > easy.rgb[2] + 0.3  # its strokes are finer than the gaps between the sites of a channel
    assert ours.luminance[2] > easy.luminance[2] + 2
    for sigma in (0.0, 0.02):
        ours, easy = reached(grey, sigma)
        assert min(np.subtract(ours.median, easy.median)) > 3
        assert ours.chrominance[0] > easy.chrominance[0] + 3
    even, _ = reached(np.full_like(scene, 0.4), 0.0)
    assert even.chrominance[0] > 80
