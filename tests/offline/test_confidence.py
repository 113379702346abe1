"""Which blocks vouch for their colour: right about edges, clipped light and noise."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageDraw

from panchroma.offline import BEST, PAPER, render
from panchroma.offline.frame import Cleaned
from panchroma.offline.stages.confidence import block_confidence, replace_doubtful_colour
from panchroma.offline.stages.highlights import clipping_level
from panchroma.shared import CfaPattern, Mosaic, NoiseModel
from panchroma.shared.arrays import FloatArray
from tests.offline.scenes import cleaned, shot
from tests.offline.stage_tests import StageTests
from tests.offline.test_highlights import NEUTRAL, exposed
from tests.reference.sensor import observe

SETTINGS = BEST.confidence


def silent(mosaic: Mosaic) -> Cleaned:
    """A frame of sensor codes, as if it had no noise."""
    return cleaned(
        replace(mosaic, calibration=replace(mosaic.calibration, noise=None)), clipping_level(mosaic)
    )


class TestTrust(StageTests):
    def run(self, mosaic: Mosaic) -> FloatArray:
        frame = cleaned(mosaic)
        means = frame.sites.means(frame.samples)
        blocks = frame.sites.grid.extend(
            (means / (means @ frame.gamma)[..., None]).astype(np.float32)
        )
        return replace_doubtful_colour(
            blocks, replace(frame, confidence=block_confidence(frame, SETTINGS))
        )


def test_the_paper_trusts_every_block() -> None:
    mosaic = shot(CfaPattern.bayer(6), (40, 40), None)
    assert block_confidence(cleaned(mosaic), PAPER.confidence) is None
    blocks = np.full((*mosaic.pattern.grid(mosaic.shape).shape, 3), 1 / 3, np.float32)
    assert replace_doubtful_colour(blocks, cleaned(mosaic)) is blocks


def test_noise_on_a_flat_surface_breaks_no_trust() -> None:
    noise = NoiseModel.gaussian(0.03, 4)
    clean = observe(np.full((120, 120, 3), 0.05), CfaPattern.bayer(6))
    samples = clean.signal + np.random.default_rng(0).normal(0, 0.03, clean.shape).astype(
        np.float32
    )
    mosaic = Mosaic(samples, clean.pattern, replace(clean.calibration, noise=noise))
    assert block_confidence(cleaned(mosaic), SETTINGS).mean() > 0.95


def test_a_block_across_an_edge_beside_clipped_samples_is_not_trusted() -> None:
    """White paper, clipped, with black strokes that end at the red sites of some blocks: they look
    cyan, and are not.
    """
    scene = np.broadcast_to(np.array(NEUTRAL) * 2.2, (60, 60, 3)).astype(np.float32)
    scene[28:31, 30::6] = 0.02  # blocks begin at multiples of six
    mosaic = exposed(scene)
    frame, grid = silent(mosaic), mosaic.pattern.grid(mosaic.shape)
    confidence = block_confidence(frame, SETTINGS)
    assert confidence[5, 5:].max() < 0.3
    assert np.delete(confidence, 5, axis=0).min() > 0.9
    blocks = np.broadcast_to(np.array(NEUTRAL) / sum(NEUTRAL), (*grid.shape, 3)).astype(np.float32)
    tinted = blocks.copy()
    tinted[grid.rows == 30, 6:] = (0.05, 0.55, 0.4)
    mixed = replace_doubtful_colour(tinted, replace(frame, confidence=confidence))
    assert np.abs(mixed - blocks).max() < 0.3 * np.abs(tinted - blocks).max()


@pytest.mark.parametrize("light", [1.6, 2.0])
def test_over_exposed_print_is_neutral(light: float) -> None:
    """Of a stroke under a block beside clipped paper, some sites see more than others: that is no
    colour.
    """
    page = Image.new("L", (192, 120), 245)
    for line in range(8):
        ImageDraw.Draw(page).text(
            (4, 2 + 14 * line), "Black print on white paper, in small type", fill=20
        )
    scene = (np.asarray(page, np.float32)[..., None] / 255) ** 2.2 * np.array(NEUTRAL) * light
    balanced = render(exposed(scene.astype(np.float32)), BEST).rgb / np.array(NEUTRAL)
    # 0.8 and 1.4 if blocks that contradict their neighbours are trusted
    assert np.quantile(np.ptp(balanced, axis=2), 0.99) < 0.4


def test_a_saturated_light_vouches_for_its_colour() -> None:
    mosaic = exposed(
        np.broadcast_to(np.array([0.9, 0.7, 0.4]) * 2.4, (48, 48, 3)).astype(np.float32)
    )
    assert mosaic.signal.max() >= clipping_level(mosaic)
    assert block_confidence(silent(mosaic), SETTINGS).min() > 0.99
