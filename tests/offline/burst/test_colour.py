"""What the colour samples of a burst say about every pixel."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import PAPER, Band, Frame, clean_frame
from panchroma.offline.bands import run_stages
from panchroma.offline.burst.colour import ColourSamples, Spreading, averaged_sites, relit_sites
from panchroma.offline.frame import BlockSums
from panchroma.offline.numerics.linked import SIDE
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import FloatArray
from tests.scenes import darker_corners

LETTERS = "ACDEF"


def edge(shape: tuple[int, int]) -> FloatArray:
    """Luminance with a soft wave and an edge in the middle."""
    y, x = np.indices(shape)
    return (1 + 0.01 * np.sin(y / 3) + (x > shape[1] // 2)).astype(np.float32)


def gamma_of(channels: int) -> FloatArray:
    return np.linspace(0.8, 1.3, channels, dtype=np.float32)


def tinted(shape: tuple[int, int], left: float, right: float, channels: int = 3) -> FloatArray:
    """A picture's chromaticity: tints on both sides of the edge, 0 = grey."""
    gamma, ramp = gamma_of(channels), np.linspace(-1, 1, channels, dtype=np.float32)
    tint = np.where(np.arange(shape[1]) > shape[1] // 2, right, left)[:, None] * ramp
    return np.broadcast_to((1 / channels + tint) / gamma, (*shape, channels)).astype(np.float32)


def samples_of(
    truth: FloatArray, luminance: FloatArray, count: int, variance: float = 0.0
) -> ColourSamples:
    """Samples of a picture at pixels of it."""
    random = np.random.default_rng(0)
    height, width, channels = truth.shape
    y, x, of = (random.integers(most, size=count) for most in (height, width, channels))
    filled = luminance[y, x]
    values = truth[y, x, of] * filled + random.normal(0, variance**0.5, count).astype(np.float32)
    places, ones = np.stack([y, x], axis=1).astype(np.float32), np.ones(count, np.float32)
    variances = ones * np.float32(variance)
    return ColourSamples(0, places, of.astype(np.uint8), values, filled, variances, variances, ones)


def spread(
    samples: ColourSamples, luminance: FloatArray, before: FloatArray, rows: int = 10**6
) -> FloatArray:
    """The corrected chromaticity. rows: of each band that it is computed in."""
    channels = before.shape[2]
    calibration = SensorCalibration(LETTERS[:channels], gamma=tuple(gamma_of(channels).tolist()))
    pattern = CfaPattern.with_block((LETTERS[:channels],), 8)
    measured = Frame(Mosaic(luminance, pattern, calibration), np.inf)
    stage = Spreading(samples, measured)
    height, whole = len(luminance), Band(0, luminance, before)
    bands = (whole.rows(top, min(top + rows, height)) for top in range(0, height, rows))
    result = np.concatenate([band.chromaticity for band in run_stages(bands, [stage], height)])
    assert np.abs((result * measured.gamma).sum(axis=2) - 1).max() < 1e-5  # luminance stays
    return result


@pytest.mark.parametrize("channels", [2, 3, 5])
def test_both_sides_of_an_edge_take_the_colours_that_samples_show(channels: int) -> None:
    shape = (40, 60)
    truth, before = tinted(shape, 0.06, -0.04, channels), tinted(shape, 0, 0, channels)
    luminance = edge(shape)
    missed = np.abs(spread(samples_of(truth, luminance, 3000), luminance, before) - truth)
    for side in (np.s_[:, :30], np.s_[:, 32:]):
        assert missed[side].mean() < 0.1 * np.abs(before - truth)[side].mean()


def test_without_samples_near_a_pixel_its_correction_fades() -> None:
    shape = (100, 60)
    luminance = np.ones(shape, np.float32)
    before, truth = tinted(shape, 0, 0), tinted(shape, 0.05, 0.05)
    samples = samples_of(truth, luminance, 4000)
    upper = replace(samples, weight=(samples.places[:, 0] < 20).astype(np.float32))
    change = np.abs(spread(upper, luminance, before) - before).max(axis=(1, 2))
    assert change[10] > 20 * change[60] >= 20 * change[90]


@pytest.mark.parametrize("count", [0, 500])
def test_a_picture_that_its_samples_confirm_stays(count: int) -> None:
    shape = (30, 40)
    before, luminance = tinted(shape, 0.05, -0.05), edge(shape)
    after = spread(samples_of(before, luminance, count), luminance, before)
    assert np.abs(after - before).max() < 1e-6


def test_bands_leave_no_trace() -> None:
    shape = (2 * SIDE + 40, SIDE + 30)
    luminance, before = edge(shape), tinted(shape, 0, 0)
    samples = samples_of(tinted(shape, 0.06, -0.04), luminance, 6000)
    whole = spread(samples, luminance, before)
    for rows in (1, 50, SIDE):
        assert np.array_equal(spread(samples, luminance, before, rows), whole)


@pytest.mark.parametrize("sigma", [0.03, 0.1])
@pytest.mark.parametrize("shape", [(40, 44), (2 * SIDE, 2 * SIDE)])
def test_samples_in_noise_spread_far(sigma: float, shape: tuple[int, int]) -> None:
    before, truth = tinted(shape, 0, 0), tinted(shape, 0.08, 0.08)
    luminance = edge(shape)
    samples = samples_of(truth, luminance, shape[0] * shape[1] // 6, sigma**2)
    result = spread(samples, luminance, before)
    assert np.abs(result - truth).mean() < 0.4 * np.abs(before - truth).mean()


def test_the_samples_of_a_channel_at_a_site_are_averaged_by_their_noise() -> None:
    pattern = CfaPattern.bayer(6, origin=(0, 0))  # R G / G B
    calibration = SensorCalibration(noise=NoiseModel.gaussian(0.1, planes=4))
    frame = Frame(Mosaic(np.full((12, 12), 0.6, np.float32), pattern, calibration), np.inf)
    # of the reference; at the red of the block below; too far from it; green; panchromatic place
    places = np.array([(0, 0), (6, 0), (6, 0), (6, 0.3), (6, 0), (8, 8)], np.float32)
    values, variance = np.full(6, 0.9, np.float32), np.full(6, 0.01, np.float32)
    values[2], variance[2] = 0.3, 0.005
    channels, ones = np.array([0, 0, 0, 0, 1, 0], np.uint8), np.ones(6, np.float32)
    usual = np.full(6, 0.01, np.float32)
    samples = ColourSamples(1, places, channels, values, ones, variance, usual, ones)
    result = averaged_sites(frame, samples)
    expected = np.full((12, 12), 0.6)
    expected[6, 0] = (0.6 + 0.9 + 2 * 0.3) / 4
    assert np.allclose(result.signal, expected, atol=1e-6)
    left = np.ones((2, 2, 4))
    left[1, 0, 0] = 1 / 4
    assert result.site_noise is not None
    assert np.allclose(result.site_noise, left, atol=1e-6)
    once, twice = (one.scaled_variance(slice(0, 2)) for one in (frame, result))
    assert once is not None
    assert twice is not None
    assert np.allclose(twice[1, 0, 0] * 4, once[1, 0, 0])


@pytest.mark.parametrize("tile", ["K=6", "kodak"])
@pytest.mark.parametrize("below", [0, 2])
def test_a_saturated_sample_is_replaced_whatever_the_shading_of_its_channel(
    tile: str, below: int
) -> None:
    """In the corners colour samples saturate below the level of panchromatic ones."""
    shape = (120, 180)
    camera = SensorCalibration.of_bits(12, shading=darker_corners(shape, colour=0.3))
    codes = np.full(shape, 3839 - below, np.uint16)  # saturated, or by two codes not
    mosaic = Mosaic(codes, CfaPattern.of_letters(tile), camera)
    frame = clean_frame(mosaic, PAPER)
    assert frame.signal.min() < 0.7 * frame.signal.max()
    weight, colour = np.full((*frame.sites.shape, 3), 4.0), np.array([0.9, 0.6, 0.3])
    relit = relit_sites(
        frame, np.full(shape, 5, np.float32), BlockSums(weight, 4 * colour * weight)
    )
    is_replaced = frame.sites.of(relit.signal) == (20 * colour)[frame.sites.channels].astype("f4")
    assert not is_replaced.any() if below else is_replaced.all()
    assert np.count_nonzero(relit.signal != frame.signal) == np.count_nonzero(is_replaced)
