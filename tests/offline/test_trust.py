"""Which blocks vouch for their colour: equal to the reference, and right about edges, clipped light and noise."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageDraw

from offline import BEST, PAPER, render
from offline.blocks import sum_noise
from offline.cleaned import Cleaned
from offline.stages.highlights import clipping_level
from offline.stages.trust import in_keeping, trust_in_blocks, with_trusted_colour
from shared import CfaPattern, Mosaic, NoiseModel
from tests.offline.scenes import cleaned, every_case, shot
from tests.offline.test_highlights import NEUTRAL, exposed
from tests.reference import chromaticity, trust
from tests.reference.compare import assert_close
from tests.reference.sensor import observe

SITES = BEST.trust


def silent(mosaic: Mosaic) -> Cleaned:
    """A frame of sensor codes, as if it had no noise."""
    return cleaned(replace(mosaic, calibration=replace(mosaic.calibration, noise=None)), clipping_level(mosaic))


@every_case
@pytest.mark.parametrize("sigma", [None, 0.02])
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None) -> None:
    mosaic = shot(pattern, shape, sigma)
    gamma, noise, signal = mosaic.calibration.gamma, mosaic.calibration.noise, mosaic.signal.astype(np.float64)
    expected = trust.trust_in_blocks(signal, pattern, gamma, noise, SITES.tolerance)
    frame = cleaned(mosaic)
    found = trust_in_blocks(frame, SITES)
    assert_close(found, expected, 1e-6)
    coarse = np.random.default_rng(0).uniform(0.1, 0.5, (*expected.shape, len(gamma)))
    coarse /= (coarse @ np.array(gamma))[..., None]
    blocks = chromaticity.extend(coarse, pattern, shape).astype(np.float32)
    mixed = chromaticity.extend(trust.with_trusted_colour(coarse, expected, gamma), pattern, shape)
    assert_close(with_trusted_colour(blocks, replace(frame, trust=found)), mixed, 3e-6)


def test_the_paper_trusts_every_block() -> None:
    mosaic = shot(CfaPattern.bayer(6), (40, 40), None)
    assert trust_in_blocks(cleaned(mosaic), PAPER.trust) is None
    blocks = np.full((*mosaic.pattern.grid(mosaic.shape).shape, 3), 1 / 3, np.float32)
    assert with_trusted_colour(blocks, cleaned(mosaic)) is blocks


def test_noise_on_a_flat_surface_breaks_no_trust() -> None:
    noise = NoiseModel.gaussian(0.03, 4)
    clean = observe(np.full((120, 120, 3), 0.05), CfaPattern.bayer(6))
    samples = clean.signal + np.random.default_rng(0).normal(0, 0.03, clean.shape).astype(np.float32)
    mosaic = type(clean)(samples, clean.pattern, replace(clean.calibration, noise=noise))
    assert trust_in_blocks(cleaned(mosaic), SITES).mean() > 0.95


def test_a_block_across_an_edge_beside_clipped_samples_is_not_trusted() -> None:
    """White paper, clipped, with black strokes that end at the red sites of some blocks: they look cyan, and are not."""
    scene = np.broadcast_to(np.array(NEUTRAL) * 2.2, (60, 60, 3)).astype(np.float32)
    scene[28:31, 30::6] = 0.02  # blocks begin at multiples of six
    mosaic = exposed(scene)
    found = trust_in_blocks(silent(mosaic), SITES)
    assert found[5, 5:].max() < 0.3
    assert np.delete(found, 5, axis=0).min() > 0.9
    blocks = np.broadcast_to(np.array(NEUTRAL) / sum(NEUTRAL), (*mosaic.pattern.grid(mosaic.shape).shape, 3)).astype(np.float32)
    row = int(np.flatnonzero(mosaic.pattern.grid(mosaic.shape).rows == 30)[0])
    tinted = blocks.copy()
    tinted[row, 6:] = (0.05, 0.55, 0.4)
    assert (
        np.abs(with_trusted_colour(tinted, replace(silent(mosaic), trust=found)) - blocks).max()
        < 0.3 * np.abs(tinted - blocks).max()
    )


@pytest.mark.parametrize("light", [1.6, 2.0])
def test_over_exposed_print_is_neutral(light: float) -> None:
    """Of a stroke under a block beside clipped paper, some sites see more than others: that is no colour."""
    page = Image.new("L", (192, 120), 245)
    for line in range(8):
        ImageDraw.Draw(page).text((4, 2 + 14 * line), "Black print on white paper, in small type", fill=20)
    scene = (np.asarray(page, np.float32)[..., None] / 255) ** 2.2 * np.array(NEUTRAL) * light
    balanced = render(exposed(scene.astype(np.float32)), BEST).rgb / np.array(NEUTRAL)
    assert np.quantile(np.ptp(balanced, axis=2), 0.99) < 0.4  # 0.8 and 1.4 if blocks that contradict their neighbours are trusted


def test_a_block_is_in_keeping_with_those_around_it_unless_it_is_darker() -> None:
    total = np.full((9, 9), 4.0)
    total[2, 2], total[6, 6] = 3.0, 5.0
    found = in_keeping(total)
    assert found[2, 2] < 0.05
    assert np.delete(found.ravel(), 2 * 9 + 2).min() > 0.6
    assert np.array_equal(in_keeping(np.zeros((3, 3))), np.ones((3, 3)))


def test_a_saturated_light_vouches_for_its_colour() -> None:
    colour = np.array([0.9, 0.7, 0.4])
    mosaic = exposed(np.broadcast_to(colour * 2.4, (48, 48, 3)).astype(np.float32))
    assert mosaic.signal.max() >= clipping_level(mosaic)
    assert trust_in_blocks(silent(mosaic), SITES).min() > 0.99


@pytest.mark.parametrize(
    "pattern", [CfaPattern.bayer(6), CfaPattern.with_block(("CM", "YC"), 4), CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW")]
)
@pytest.mark.parametrize("model", [NoiseModel.gaussian(0.02, 4), NoiseModel((1e-3,) * 4, (2e-3,) * 4)])
def test_the_noise_of_a_blocks_sum_is_known(pattern: CfaPattern, model: NoiseModel) -> None:
    """1.6 times that of one sample for a Bayer block: three channels, one of which is seen twice, and the light around them."""
    gamma = (0.8, 1.1, 1.25)
    clean = observe(np.full((240, 240, 3), 0.4), pattern, gamma)
    spread = [model.sigma(0.4, plane) for plane in range(3)] + [model.sigma(0.4 * sum(gamma))]
    noise = np.random.default_rng(0).normal(size=clean.shape) * np.array(spread)[pattern.filter_map(clean.shape)]
    found = cleaned(replace(clean, samples=(clean.signal + noise).astype(np.float32)))
    weights = (np.array(gamma) / np.bincount(found.sites.channels))[found.sites.channels]
    surplus = found.samples @ weights - found.around.light.mean(axis=2)
    told = sum_noise(found.sites, found.around.light, np.array(gamma), model)
    assert surplus.std() == pytest.approx(float(told.mean()), rel=0.06)
