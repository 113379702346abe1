"""Chromaticities of blocks by the network: true to the constraint, whatever the exposure, nearer to
the truth than those of single blocks.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panchroma.offline import BEST, PAPER, clean_frame, estimate_colour, render
from panchroma.offline.frame import BlockSums, Frame, Sites
from panchroma.offline.stages import block_network
from panchroma.offline.stages.block_network import LINES, PLANES, PROPOSALS, alike_blocks, mixed
from panchroma.offline.stages.chromaticity import block_sums
from panchroma.offline.stages.colour_network import BASIS
from panchroma.offline.stages.denoising import denoise_luminance
from panchroma.offline.stages.luminance import recover_luminance
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.shared.progress import SILENT
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from tests.offline.scenes import photographed, sampled
from tests.scenes import leaves

PATTERNS = ("K=3", "K=4", "K=6", "K=8", "RGWW/BWWW/WWWW/WWWW", "kodak")
GAMMA = (0.8, 1.15, 1.05)


def filled(mosaic: Mosaic) -> Frame:
    """A mosaic, cleaned, with its luminance."""
    frame = clean_frame(mosaic)
    luminance = recover_luminance(frame.mosaic, BEST.luminance)
    luminance = denoise_luminance(luminance, frame.mosaic, BEST.denoising)
    return replace(frame, luminance=luminance)


def taken(
    rgb: FloatArray, pattern: str = "K=6", sigma: float = 0.0, gamma: tuple[float, ...] = GAMMA
) -> Frame:
    """The frame that a camera takes of a scene."""
    camera, tile = SensorCalibration(gamma=gamma), CfaPattern.of_letters(pattern)
    return filled(simulate_additive(rgb, tile, camera, sigma, np.random.default_rng(1)))


def scene() -> FloatArray:
    """Fallen leaves through a lens."""
    return np.asarray(gaussian_filter(leaves(180, 240), (0.8, 0.8, 0)), np.float32)


def colours(frame: Frame, rgb: FloatArray) -> DoubleArray:
    """The mean colour at the sites of each block, (rows, columns, 3)."""
    sites = Sites.in_frame(frame.mosaic)
    return np.stack([sites.of(plane).mean(axis=2) for plane in np.moveaxis(rgb, 2, 0)], axis=2)


def error(blocks: FloatArray, frame: Frame, rgb: FloatArray) -> float:
    """Root of the mean square of what chromaticities miss of the colour of blocks."""
    true = colours(frame, rgb)
    light = true @ frame.gamma
    return float(np.sqrt(np.mean((blocks[frame.grid.whole] * light[..., None] - true) ** 2)))


def learned(frame: Frame) -> tuple[FloatArray, FloatArray]:
    return block_network.learned_chromaticities(frame, BEST.chromaticity, BEST.pooling, SILENT)


@pytest.mark.parametrize("sigma", [0.0, 0.03])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_chromaticities_add_up_and_are_nearer_to_the_truth(pattern: str, sigma: float) -> None:
    frame = taken(scene(), pattern, sigma)
    blocks, lines = learned(frame)
    np.testing.assert_allclose(lines[..., :3] @ frame.gamma, 1, atol=1e-3)
    np.testing.assert_allclose(blocks @ frame.gamma, 1, atol=1e-3)  # Eq. 7
    pooled = replace(BEST, chromaticity=PAPER.chromaticity)
    for settings, share in ((replace(pooled, pooling=PAPER.pooling), 0.9), (pooled, 0.97)):
        others = estimate_colour(frame, frame.luminance, settings).blocks
        assert error(blocks, frame, scene()) < share * error(others, frame, scene())


def test_grey_is_grey() -> None:
    grey = np.linspace(0.02, 0.9, 120, dtype=np.float32)[:, None, None] * np.ones((1, 90, 3))
    blocks, _ = learned(taken(grey.astype(np.float32)))
    wrong = np.abs(blocks - 1 / np.sum(GAMMA))
    assert wrong.max() < 0.03  # in the first row, where luminance ends
    assert wrong[2:].max() < 2e-3


def test_exposure_changes_no_plane() -> None:
    """Samples and noise four times as large."""
    frame = taken(scene(), sigma=0.01)
    noise = replace(frame.noise, read=tuple(4 * read for read in frame.noise.read))
    calibration = replace(frame.mosaic.calibration, noise=noise)
    brighter = replace(frame.mosaic, samples=4 * frame.signal, calibration=calibration)
    (expected, dim), (planes, light) = (
        block_network.block_planes(
            shot, alike_blocks(shot, BEST.chromaticity, BEST.pooling, SILENT)
        )
        for shot in (frame, sampled(brighter, 4 * frame.luminance))
    )
    assert planes.shape == (PLANES, *frame.sites.shape)
    np.testing.assert_allclose(planes, expected, atol=0.01)
    np.testing.assert_allclose(light, 4 * dim, rtol=1e-5)


def test_proposals_are_weighed_and_moved_in_the_plane_of_constant_luminance() -> None:
    """In the middle of 3 x 3 blocks, by the sums that the text describes."""
    random = np.random.default_rng(0)
    proposals = random.dirichlet(np.ones(3), (PROPOSALS, 3, 3))  # (proposal, row, column, channel)
    slopes = random.normal(size=(len(LINES), 3, 3, 3))
    planes = np.zeros((PLANES, 3, 3), np.float32)
    is_proposal = np.repeat([0, 1], (len(LINES), PROPOSALS))[:, None, None, None]
    triples = 3 * np.concatenate([slopes, proposals]) - is_proposal
    planes[-3 * len(triples) :] = triples.transpose(0, 3, 1, 2).reshape(-1, 3, 3)
    answer = random.normal(size=(4 + block_network.CHOICES, 3, 3)).astype(np.float32)
    weights = np.exp(answer[4:, 1, 1]) / np.exp(answer[4:, 1, 1]).sum()
    choices = np.concatenate([proposals[0].reshape(9, 3), proposals[1:, 1, 1]])
    chromaticity = weights @ choices + answer[:2, 1, 1] @ BASIS * 0.1 / 3
    slope = weights[-len(LINES) :] @ slopes[:, 1, 1] + answer[2:4, 1, 1] @ BASIS * 0.1 / 3
    expected = np.concatenate([chromaticity, slope - slope.mean()])  # luminance stays
    np.testing.assert_allclose(mixed(planes, answer)[:, 1, 1], expected, atol=1e-6)


def test_lines_go_through_all_inks() -> None:
    """Stripes of red ink on yellow paper, as wide as the blocks are far apart: the line of each
    block has the colour of both.
    """
    inks = np.array([[0.8, 0.7, 0.3], [0.3, 0.05, 0.04]], np.float32)
    stripes = np.broadcast_to(inks[np.arange(120) // 5 % 2], (90, 120, 3))
    _, lines = learned(taken(np.ascontiguousarray(stripes), gamma=(1.0, 1.0, 1.0)))
    for ink in inks:
        light = float(ink.sum())
        colour = lines[..., :3] * light - lines[..., 3:6]
        assert np.median(np.abs(colour[4:-4, 4:-4] - ink).max(axis=2)) < 0.03


def test_lines_end_where_no_site_around_is_as_dark_or_bright() -> None:
    frame = taken(scene(), sigma=0.02)
    _, lines = learned(frame)
    at_sites = frame.sites.of(frame.luminance)
    for row, column in ((0, 0), (7, 12), (frame.sites.shape[0] - 1, 5)):
        around = at_sites[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        ends = lines[frame.grid.whole][row, column, 6:]
        assert np.array_equal(ends, [around.min(), around.max()])


@pytest.mark.parametrize(("darker", "most"), [(0.8, 0.024), (0.9, 0.0095)])
def test_a_thin_line_beside_an_edge_of_equal_luminance_keeps_its_colour(
    darker: float, most: float
) -> None:
    """Yellow beside blue that is a little darker, with lines of 1 pixel, darker still, on the blue:
    what tells yellow from blue says little of these. Lines without end leave 0.032 and 0.0125.
    """
    inks = np.array([[0.5, 0.42, 0.1], [0.1, 0.25, 0.55]], np.float32)
    rows, columns = np.indices((90, 120))
    picture = inks[(columns + rows // 3 > 75).astype(int)]
    thin = (columns + rows // 2) % 17 == 0
    thin &= columns + rows // 3 > 76
    picture[thin] *= darker
    found = render(taken(picture).mosaic).rgb
    wrong = np.abs(found - picture).max(axis=2)[6:-6, 6:-6]
    assert np.median(wrong[thin[6:-6, 6:-6]]) < most


@pytest.mark.parametrize("shape", [(500, 30), (30, 500)])
def test_no_border_of_a_chunk_shows(
    shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chunks that see all that the network can, and small ones that see less: the noise is 0.02."""
    mosaic = photographed(leaves(*shape), CfaPattern.bayer(3), 0.02)
    frame, halo = filled(mosaic), block_network._HALO
    monkeypatch.setattr(block_network, "_HALO", 64)
    whole = learned(frame)[0]
    monkeypatch.setattr(block_network, "_SIDE", 16)
    assert np.array_equal(learned(frame)[0], whole)
    monkeypatch.setattr(block_network, "_HALO", halo)
    difference = learned(frame)[0] - whole
    assert 0 < np.sqrt(np.square(difference).mean()) < 2e-3
    assert np.abs(difference).max() < 0.05


def test_samples_of_other_frames_count() -> None:
    frame = taken(scene(), sigma=0.04, gamma=(1.0, 1.0, 1.0))
    others = BlockSums(*np.zeros((2, *frame.sites.shape, 3)))
    for seed in range(2, 9):
        shot = photographed(scene(), frame.pattern, 0.04, seed)
        others += block_sums(sampled(shot, frame.luminance))
    found = (learned(replace(frame, others=sums))[0] for sums in (None, others))
    alone, together = (error(blocks, frame, scene()) for blocks in found)
    assert together < 0.8 * alone


def test_other_patterns_go_without_it() -> None:
    assert all(block_network.serves(CfaPattern.of_letters(pattern)) for pattern in PATTERNS)
    assert not block_network.serves(CfaPattern.of_letters("RCCB"))
    assert not block_network.serves(CfaPattern.with_block(("RGB", "XWY"), 6))


def test_the_answer_holds_beside_clipped_light() -> None:
    """Dark type on over-exposed paper, rendered: the paper is even, and neutral."""
    paper = np.full((120, 120, 3), 1.6, np.float32)
    paper[40:44, 20:100] = paper[60:100, 50:53] = 0.05
    camera, random = SensorCalibration(), np.random.default_rng(0)
    mosaic = simulate_sensor(paper, CfaPattern.bayer(6), camera, 1.0, random)
    chromaticity = render(mosaic).chromaticity[10:110, 10:110]
    bright = paper[10:110, 10:110, 0] > 1
    assert np.quantile(np.abs(chromaticity[bright] - 1 / 3), 0.99) < 0.03
