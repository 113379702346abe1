"""The learned rival: any size, and better than interpolation."""

import numpy as np
import pytest

from shared.arrays import FloatArray
from tools.camera.bayer import sample_bayer
from tools.evaluation.metrics import psnr
from tools.evaluation.rivals.demosaicnet import METHODS, demosaic_demosaicnet
from tools.evaluation.rivals.interpolation import demosaic_bilinear
from tools.scenes.drawn.builtin import builtin_scene

pytestmark = pytest.mark.skipif(
    METHODS[0].missing is not None, reason="PyTorch or demosaicnet is missing: pip install 'panchroma[learned-rivals]'"
)


def scene(height: int, width: int) -> FloatArray:
    return builtin_scene(330, 220).rgb[60 : 60 + height, 40 : 40 + width]


@pytest.mark.parametrize("shape", [(61, 80), (90, 75)])
def test_it_is_better_than_interpolation(shape: tuple[int, int]) -> None:
    rgb = scene(*shape)
    mosaic = sample_bayer(rgb)
    found = demosaic_demosaicnet(mosaic)
    assert found.shape == rgb.shape
    assert found.dtype == np.float32
    assert psnr(found, rgb, 4) > psnr(demosaic_bilinear(mosaic), rgb, 4) + 1


def test_a_grey_surface_stays_grey() -> None:
    assert np.abs(demosaic_demosaicnet(sample_bayer(np.full((40, 44, 3), 0.4, np.float32))) - 0.4).max() < 0.01


def test_pieces_are_not_seen() -> None:
    rgb = np.concatenate([scene(150, 60)] * 4)
    mosaic = sample_bayer(rgb)
    whole, upper = demosaic_demosaicnet(mosaic), demosaic_demosaicnet(mosaic[:420])
    assert np.abs(whole[:370] - upper[:370]).max() < 1e-4
