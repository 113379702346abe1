"""The Bayer burst: exact where exact is possible, better with every frame, and as well aligned as ours."""

import numpy as np
import pytest

from panchroma.offline.burst import Motion
from panchroma.shared.arrays import FloatArray
from panchroma.tools.evaluation.metrics import psnr
from panchroma.tools.evaluation.rivals.dlmmse import demosaic_dlmmse
from panchroma.tools.io.versions import package_version
from panchroma.tools.simulation.bayer import sample_bayer
from panchroma.tools.simulation.burst import SimulatedBurst, burst_frames
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from tests.bayer import bayer_mosaic
from tests.benchmarks.bayer_burst import render_bayer_burst

NEUTRAL = 0.6, 1.0, 0.5
EDGE = 8  # pixels: from beyond the frame's edge there are no samples
QUAD = [Motion((float(down), float(across))) for down in (0, 1) for across in (0, 1)]
CONVERGED = 1e-3  # what a few rounds of back-projection leave


def light(count: int, pixels: float) -> list[FloatArray]:
    """Frames of fine leaves and print."""
    scene = builtin_scene(660, 440).rgb[60:220, 60:240]
    return [frame.rgb for frame in burst_frames(scene, SimulatedBurst(count, pixels), np.random.default_rng(1))]


def shifted(scene: FloatArray, motion: Motion) -> FloatArray:
    return np.roll(scene, [int(step) for step in motion.shift], axis=(0, 1))


def test_four_shifts_by_a_pixel_measure_every_channel_everywhere() -> None:
    scene = light(1, 0)[0]
    mosaics = [sample_bayer(shifted(scene, motion)) for motion in QUAD]
    picture = render_bayer_burst(mosaics, 0, NEUTRAL, motions=QUAD)
    inner = np.s_[EDGE:-EDGE, EDGE:-EDGE]
    assert picture.dtype == np.float32
    assert np.abs(picture - scene)[inner].mean() < CONVERGED
    assert np.abs(demosaic_dlmmse(mosaics[0]) - scene)[inner].mean() > 10 * CONVERGED


def test_frames_are_aligned_and_each_adds_detail() -> None:
    frames = light(6, 3)
    mosaics = [sample_bayer(frame) for frame in frames]
    found = [psnr(render_bayer_burst(mosaics[:count], 0, NEUTRAL), frames[0], EDGE) for count in (1, 3, 6)]
    assert np.diff(found).min() > 1


@pytest.mark.skipif(package_version("bm3d") is None, reason="bm3d is missing: pip install 'panchroma[rivals]'")
def test_noise_is_averaged_and_removed() -> None:
    even, sigma = np.full((64, 66, 3), 0.4, np.float32), 0.03
    mosaics = [bayer_mosaic(even, sigma, np.random.default_rng(n)) for n in range(4)]
    found = [psnr(render_bayer_burst(mosaics[:count], sigma, NEUTRAL, motions=QUAD[:count]), even, EDGE) for count in (1, 4)]
    assert found[0] > psnr(demosaic_dlmmse(mosaics[0]), even, EDGE) + 6
    assert found[1] > found[0] + 3
