"""The samples of a frame: what its blocks see, and the units that it may be in."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, RenderSettings, colour_bands, measure
from panchroma.offline.pipeline import clean_frame
from panchroma.shared import CfaPattern, NoiseModel, SensorCalibration
from panchroma.tools.simulation.sensor import simulate_sensor
from tests.offline.scenes import cleaned, every_case, shot
from tests.scenes import darker_corners


@every_case
def test_blocks_see_the_panchromatic_samples_in_and_next_to_them(
    pattern: CfaPattern, shape: tuple[int, int]
) -> None:
    frame = cleaned(shot(pattern, shape))
    grid, (height, width) = frame.sites.grid, pattern.block_shape
    light, lowest, highest = frame.around
    clipping = float(np.median(frame.signal))
    unclipped = replace(frame, clipping=clipping).unclipped
    for i, j in np.ndindex(frame.sites.shape):
        top, left = int(grid.whole_rows[i]), int(grid.whole_columns[j])
        near = np.s_[max(top - 1, 0) : top + height + 1, max(left - 1, 0) : left + width + 1]
        samples = frame.signal[near][pattern.panchromatic_mask(shape)[near]]
        assert lowest[i, j] == samples.min()
        assert highest[i, j] == samples.max()
        assert (light[i, j] >= samples.min()).all()
        assert (light[i, j] <= samples.max()).all()
        assert unclipped[i, j] == (frame.signal[near] < clipping).all()


@pytest.mark.parametrize("settings", [BEST, PAPER])
def test_no_site_stays_in_memory_in_double_precision(settings: RenderSettings) -> None:
    measured = measure(shot(CfaPattern.of_letters("kodak"), (90, 100)), settings)
    list(colour_bands(measured, settings))
    assert not {"samples", "around"} & vars(measured).keys()


def test_on_a_slope_luminance_at_a_site_is_that_of_its_place() -> None:
    (row, column), sound = np.indices((60, 60)), shot(CfaPattern.bayer(6), (60, 60))
    slope = cleaned(replace(sound, samples=(0.2 + row / 100 + column / 200).astype(np.float32)))
    wrong = (slope.around.filled - slope.sites.of(slope.signal))[1:-1, 1:-1]
    assert np.abs(wrong).max() < 1e-3
    assert np.abs(wrong.mean(axis=2)).max() < 1e-6


@pytest.mark.parametrize(
    "model", [NoiseModel((1e-3,) * 4, (0.02,) * 4), NoiseModel.gaussian(0.03, 4)]
)
@pytest.mark.parametrize(
    "pattern",
    [
        CfaPattern.bayer(6),
        CfaPattern.with_block(("CM", "YC"), 4),
        CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW"),
    ],
)
def test_noise_is_scaled_with_samples_whose_shading_is_made_even(
    pattern: CfaPattern, model: NoiseModel
) -> None:
    """An even surface through a lens whose corners are dark, and of another colour: the noise of a
    sample, and that of a block's sum.
    """
    shape, gamma = (300, 300), (0.8, 1.1, 1.25)
    lens = darker_corners(shape, colour=0.4)
    camera = SensorCalibration.of_bits(
        12, channels=pattern.channels, gamma=gamma, noise=model, shading=lens
    )
    scene, random = np.full((*shape, 3), 0.4, np.float32), np.random.default_rng(0)
    frame = clean_frame(simulate_sensor(scene, pattern, camera, 1.0, random), PAPER)
    every, channels = slice(0, frame.sites.shape[0]), frame.sites.channels
    gain = frame.sites.of(lens.of_plane(shape))
    true = (np.float32(0.4) / gain).astype(np.float32)
    share = (frame.gamma / frame.pattern.site_counts)[channels]
    surplus = frame.samples @ share - frame.around.filled.mean(axis=2)
    for place in gain[..., 0] > 3.5, gain[..., 0] < 1.5:
        error = np.square(frame.samples - true)[place].mean(axis=0)
        expected = frame.variance(true, every, channels)[place].mean(axis=0)
        assert error == pytest.approx(expected, rel=0.3)
        stated = frame.sum_noise(frame.around.filled)[place].mean()
        assert surplus[place].std() == pytest.approx(stated, rel=0.1)


def test_a_colour_sample_is_saturated_at_the_limit_of_its_place() -> None:
    """Through a lens whose corners are dark and of another colour."""
    camera = SensorCalibration.of_bits(12, shading=darker_corners((90, 90), colour=0.4))
    scene = np.full((90, 90, 3), 0.2, np.float32)
    mosaic = simulate_sensor(scene, CfaPattern.bayer(6), camera, 1.0, np.random.default_rng(0))
    frame = clean_frame(mosaic, PAPER)
    limits = frame.limits(slice(0, frame.sites.shape[0])).astype(np.float32)
    samples = np.full_like(frame.signal, 0.999 * frame.clipping)
    for site, place in enumerate(frame.sites.places):
        samples[place] = np.float32(0.999) * limits[..., site]
    assert frame.with_samples(samples.copy()).unclipped.all()
    samples[frame.sites.places[2]][4, 1] = np.float32(1.001) * limits[4, 1, 2]
    assert samples.max() < frame.clipping
    assert np.argwhere(~frame.with_samples(samples).unclipped).tolist() == [[4, 1]]


def test_samples_keep_their_unit_however_dark_the_frame() -> None:
    dark = shot(CfaPattern.bayer(6), (40, 40), None)
    faint = replace(dark, samples=dark.signal / np.float32(256))
    assert np.array_equal(clean_frame(faint).signal * np.float32(256), clean_frame(dark).signal)
