"""The samples of a frame: what its blocks see, and the units that it may be in."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, RenderSettings, colour_bands, measure
from panchroma.offline.frame import sum_noise
from panchroma.offline.render import clean_frame
from panchroma.shared import CfaPattern, NoiseModel
from tests.offline.scenes import cleaned, every_case, shot
from tests.reference.sensor import observe


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
    "pattern",
    [
        CfaPattern.bayer(6),
        CfaPattern.with_block(("CM", "YC"), 4),
        CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW"),
    ],
)
@pytest.mark.parametrize(
    "model", [NoiseModel.gaussian(0.02, 4), NoiseModel((1e-3,) * 4, (2e-3,) * 4)]
)
def test_the_noise_of_a_blocks_sum_is_known(pattern: CfaPattern, model: NoiseModel) -> None:
    """1.6 times that of one sample for a Bayer block: three channels, one of which is seen twice,
    and the light around them.
    """
    gamma = (0.8, 1.1, 1.25)
    clean = observe(np.full((240, 240, 3), 0.4), pattern, gamma)
    spread = [model.sigma(0.4, plane) for plane in range(3)] + [model.sigma(0.4 * sum(gamma))]
    noise = (
        np.random.default_rng(0).normal(size=clean.shape)
        * np.array(spread)[pattern.filter_map(clean.shape)]
    )
    frame = cleaned(replace(clean, samples=(clean.signal + noise).astype(np.float32)))
    weights = (np.array(gamma) / np.bincount(frame.sites.channels))[frame.sites.channels]
    surplus = frame.samples @ weights - frame.around.filled.mean(axis=2)
    expected = sum_noise(frame.sites, frame.around.filled, np.array(gamma), model)
    assert surplus.std() == pytest.approx(float(expected.mean()), rel=0.06)


def test_samples_keep_their_unit_however_dark_the_frame() -> None:
    dark = shot(CfaPattern.bayer(6), (40, 40), None)
    faint = replace(dark, samples=dark.signal / np.float32(256))
    assert np.array_equal(clean_frame(faint).signal * np.float32(256), clean_frame(dark).signal)
