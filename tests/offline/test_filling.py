"""The network that corrects filled luminance: what it gains, and what it must leave alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panchroma.offline.settings import BEST, UNLEARNED
from panchroma.offline.stages.luminance import recover_luminance
from panchroma.offline.stages.luminance_network import SIDE, correct_fill, network_inputs
from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.arrays import FloatArray
from panchroma.shared.calibration import NoiseModel
from tests.offline.scenes import photographed
from tests.scenes import leaves

# As a lens shows them: it has learned from what is seen through one.
LEAVES: FloatArray = gaussian_filter(leaves(220, 330), (0.6, 0.6, 0))


def filled(mosaic: Mosaic) -> FloatArray:
    """What the network is given."""
    return recover_luminance(mosaic, UNLEARNED.luminance)


@pytest.mark.parametrize("sigma", [0.0, 0.03])
@pytest.mark.parametrize("block", [("RG", "GB"), ("RG", "BW"), ("WB", "GR")])
@pytest.mark.parametrize("period", [4, 5, 6, 8])
def test_it_takes_errors_away_under_blocks_alone(
    period: int, block: tuple[str, str], sigma: float
) -> None:
    pattern = CfaPattern.with_block(block, period, origin=(1, 2))
    mosaic = photographed(LEAVES, pattern, sigma)
    before, after = filled(mosaic), recover_luminance(mosaic, BEST.luminance)
    measured = mosaic.pattern.panchromatic_mask(mosaic.shape)
    assert np.array_equal(before[measured], after[measured])
    truth = LEAVES.sum(axis=2)
    left = np.square(after - truth)[~measured].mean() / np.square(before - truth)[~measured].mean()
    assert left < 0.8


def test_three_sites_are_corrected_alike_wherever_the_fourth_pixel_is() -> None:
    pattern, whole = CfaPattern.of_letters("RGWW/BWWW/WWWW/WWWW"), LEAVES[:, :328]  # whole tiles
    luminance, images = filled(photographed(whole, pattern)), []
    for down, across in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        mirrored = CfaPattern(tuple(row[::across] for row in pattern.tile[::down]))
        seen = photographed(whole[::down, ::across], mirrored)
        images.append(correct_fill(luminance[::down, ::across].copy(), seen)[::down, ::across])
    assert not np.array_equal(images[0], luminance)
    for image in images[1:]:
        assert image == pytest.approx(images[0], abs=1e-5)


@pytest.mark.parametrize("letters", ["WBWG/BWGW/WGWR/GWRW", "RGBW/WWWW/WWWW/WWWW", "RGW/GBW/WWW"])
def test_other_blocks_stay_as_they_were_filled(letters: str) -> None:
    mosaic = photographed(LEAVES, CfaPattern.of_letters(letters))
    assert np.array_equal(recover_luminance(mosaic, BEST.luminance), filled(mosaic))


@pytest.mark.parametrize(("noise", "most"), [(0.0, 0.021), (0.0215, 0.0258)])
def test_it_is_asked_where_there_is_contrast_beyond_noise_alone(noise: float, most: float) -> None:
    """A checkerboard, whose contrast grows from block to block, around one."""
    contrasts = np.repeat(np.linspace(0.004, 0.1, 25), SIDE).astype(np.float32)
    wide = 1 + np.where(np.indices((SIDE, 25 * SIDE)).sum(axis=0) % 2, contrasts, -contrasts)
    blocks = np.array([0]), np.arange(0, 25 * SIDE, SIDE)
    asked, _, units = network_inputs(wide, blocks, NoiseModel.gaussian(noise, 4))
    assert asked.tolist() == np.flatnonzero(contrasts[::SIDE] > most).tolist()
    assert units[:, 0] == pytest.approx(contrasts[::SIDE][asked], rel=1e-3)
