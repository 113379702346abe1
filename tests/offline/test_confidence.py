"""Which blocks vouch for their colour: right about edges, clipped light and noise."""

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import minimum_filter

from panchroma.offline import BEST, PAPER, render
from panchroma.offline.frame import Frame
from panchroma.offline.stages.confidence import block_confidence, replace_doubtful_colour
from panchroma.offline.stages.highlights import clipping_level, restore_highlights
from panchroma.shared import CfaPattern, Mosaic, NoiseModel
from panchroma.shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import cleaned, shot
from tests.offline.stage_tests import StageTests
from tests.offline.test_highlights import NEUTRAL, exposed
from tests.reference.sensor import observe

SETTINGS = BEST.confidence
FONTS = Path(matplotlib.get_data_path()) / "fonts/ttf"


def silent(mosaic: Mosaic) -> Frame:
    """A frame of sensor codes, its highlights restored, as if it had no noise."""
    calibration = replace(mosaic.calibration, noise=None)
    frame = cleaned(replace(mosaic, calibration=calibration), clipping_level(mosaic))
    return restore_highlights(frame, BEST.highlights)


class TestTrust(StageTests):
    def run(self, mosaic: Mosaic) -> FloatArray:
        frame = cleaned(mosaic)
        means = frame.sites.means(frame.samples)
        blocks = frame.sites.grid.extend(
            (means / (means @ frame.gamma)[..., None]).astype(np.float32)
        )
        return replace_doubtful_colour(blocks, frame, SETTINGS)


def test_the_paper_trusts_every_block() -> None:
    mosaic = shot(CfaPattern.bayer(6), (40, 40), None)
    blocks = np.full((*mosaic.pattern.grid(mosaic.shape).shape, 3), 1 / 3, np.float32)
    assert replace_doubtful_colour(blocks, cleaned(mosaic), PAPER.confidence) is blocks


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
    mixed = replace_doubtful_colour(tinted, frame, SETTINGS)
    assert np.abs(mixed - blocks).max() < 0.4 * np.abs(tinted - blocks).max()


def printed(font: str, paper: tuple[float, ...], ink: tuple[float, ...]) -> FloatArray:
    """A page of type, (120, 192, 3), as shares of the neutral."""
    page = Image.new("L", (192, 120), 0)
    face = ImageFont.truetype(FONTS / f"{font}.ttf", 11)
    for line in range(8):
        place = 4, 2 + 14 * line
        ImageDraw.Draw(page).text(place, "Print on paper, in small type", fill=255, font=face)
    cover = np.asarray(page, np.float32)[..., None] / 255
    scene: FloatArray = (1 - cover) * np.array(paper, np.float32) + cover * np.array(ink)
    return scene.astype(np.float32)


@pytest.mark.parametrize("pattern", [CfaPattern.bayer(6), CfaPattern.bayer(4)])
@pytest.mark.parametrize(
    ("font", "paper", "ink"),
    [
        ("DejaVuSerif", (0.83, 0.83, 0.83), (0.01, 0.01, 0.01)),
        ("DejaVuSans", (0.8, 0.75, 0.6), (0.02, 0.03, 0.2)),
    ],
)
@pytest.mark.parametrize("light", [1.5, 2.0])
def test_over_exposed_print_is_even_and_readable(
    pattern: CfaPattern,
    font: str,
    paper: tuple[float, ...],
    ink: tuple[float, ...],
    light: float,
) -> None:
    """Blocks on bare paper are not clipped, and know its light and colour."""
    scene = printed(font, paper, ink)
    shot = exposed(scene * np.array(NEUTRAL) * light * 3 / sum(NEUTRAL), pattern=pattern)
    rendering = render(shot, BEST)
    found = rendering.rgb / (np.array(NEUTRAL) * light * 3 / sum(NEUTRAL))
    bare = minimum_filter((scene == scene[0, 0]).all(axis=2), 5)
    apart = found[bare] - np.array(paper)
    assert (shot.signal >= clipping_level(shot)).mean() > 0.4
    assert np.quantile(np.abs(apart), 0.95) < 0.025
    assert np.quantile(np.ptp(apart, axis=1), 0.99) < 0.07
    assert rendering.lost is not None
    assert rendering.lost.max() == 0
    grey, true = found.mean(axis=2), scene.mean(axis=2)
    assert np.corrcoef(grey.ravel(), true.ravel())[0, 1] > 0.97


def drawn_signs() -> DoubleArray:
    """Tubes of saturated light on black, whose blocks do not add up to the light around them."""
    row, column = np.indices((96, 120))
    scene = np.full((96, 120, 3), 0.005)
    for number, colour in enumerate([(0.6, 0.02, 0.05), (0.02, 0.15, 0.6), (0.02, 0.6, 0.1)]):
        across = np.abs(row + 0.3 * column - 30 * number - 28)
        scene += np.clip(1.7 - across, 0, 1)[..., None] * np.array(colour)
    return scene


def test_thin_light_of_saturated_colour_has_few_dots() -> None:
    scene = drawn_signs()
    wrong = render(observe(scene, CfaPattern.bayer(4)), BEST).rgb - scene
    assert -10 * np.log10(np.square(wrong).mean()) > 32.5


def test_a_saturated_light_vouches_for_its_colour() -> None:
    mosaic = exposed(
        np.broadcast_to(np.array([0.9, 0.7, 0.4]) * 2.4, (48, 48, 3)).astype(np.float32)
    )
    assert mosaic.signal.max() >= clipping_level(mosaic)
    assert block_confidence(silent(mosaic), SETTINGS).min() > 0.99
