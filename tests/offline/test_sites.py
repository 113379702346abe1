"""Errors at the colour sites: equal to the reference, exact where the model holds, and none of them invented."""

from dataclasses import replace

import numpy as np
import pytest

from offline.frame import unclipped_blocks
from offline.numerics.pieces import BLOCK_ROWS
from offline.parts import Part
from offline.stage import Switch
from offline.stages.correction import Missed, correct_sites, settle_luminance, site_reach
from shared import CfaPattern, Mosaic, NoiseModel
from shared.arrays import DoubleArray, FloatArray
from tests.offline.scenes import cleaned, every_case, gamma_of, materials, sampled, shot
from tests.reference import chromaticity, sites
from tests.reference.compare import assert_close
from tests.reference.render import sigma_of_colour
from tests.reference.sensor import luminance_of, observe

# Luminance and samples are float32, errors of both are small differences of them.
FLOAT32 = 3e-6


def corrected(part: Part, mosaic: Mosaic, clipping: float = np.inf) -> Part:
    """The picture corrected by the samples of a mosaic."""
    measured, gamma = sampled(mosaic, part.luminance, clipping), np.array(mosaic.calibration.gamma, np.float32)
    return correct_sites(Missed(measured, gamma)(part, (part.first, part.end)), measured, gamma)


def wrong_light(mosaic: Mosaic) -> FloatArray:
    """The true luminance of `shot` with errors at the colour sites, as hole filling makes them."""
    true = luminance_of(materials(mosaic.shape, len(mosaic.pattern.channels), 0), mosaic.calibration.gamma)
    wrong = true * np.random.default_rng(9).uniform(0.9, 1.1, true.shape)
    clear = mosaic.pattern.panchromatic_mask(mosaic.shape)
    return np.where(clear, true, wrong).astype(np.float32)


def coarse_of(mosaic: Mosaic, light: FloatArray) -> DoubleArray:
    """Eqs. 8-9 of the whole blocks."""
    return chromaticity.estimate(
        mosaic.signal.astype(np.float64),
        light.astype(np.float64),
        mosaic.pattern,
        mosaic.calibration.gamma,
        sigma_of_colour(mosaic),
    )


@every_case
@pytest.mark.parametrize("sigma", [None, 0.02])
def test_settled_luminance_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None) -> None:
    mosaic = shot(pattern, shape, sigma)
    light, noise = wrong_light(mosaic), mosaic.calibration.noise
    coarse = coarse_of(mosaic, light)
    blocks = chromaticity.extend(coarse, pattern, shape).astype(np.float32)
    signal = mosaic.signal.astype(np.float64)
    variance = sites.noise_of(signal, pattern, noise)
    gamma = mosaic.calibration.gamma
    expected = sites.settle(light.astype(np.float64), coarse, signal, variance, pattern, gamma)
    measured = sampled(mosaic, light)
    found = settle_luminance(light, blocks, measured, np.array(gamma, np.float32), Switch(used=True))
    assert_close(found, expected, FLOAT32)
    assert np.array_equal(found[pattern.panchromatic_mask(shape)], light[pattern.panchromatic_mask(shape)])
    assert settle_luminance(light, blocks, measured, np.array(gamma, np.float32), Switch()) is light


def test_settled_luminance_has_no_seams_where_strips_of_blocks_meet() -> None:
    test_settled_luminance_equals_the_reference(CfaPattern.bayer(3), (3 * 2 * BLOCK_ROWS + 20, 12), None)


@every_case
def test_a_block_is_unclipped_with_all_that_is_next_to_it(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic, (height, width), grid = shot(pattern, shape, None), pattern.block_shape, pattern.grid(shape)
    frame = cleaned(mosaic, float(np.quantile(mosaic.signal, 0.97)))
    around = [
        [np.s_[max(row - 1, 0) : row + height + 1, max(column - 1, 0) : column + width + 1] for column in grid.whole_columns]
        for row in grid.whole_rows
    ]
    expected = [[(mosaic.signal[each] < frame.clipping).all() for each in row] for row in around]
    assert np.array_equal(unclipped_blocks(frame), expected)


def test_settling_brings_luminance_closer_where_chromaticity_is_known() -> None:
    pattern, shape = CfaPattern.bayer(6, origin=(1, 2)), (90, 96)
    mosaic = shot(pattern, shape, None)
    light = wrong_light(mosaic)
    scene = materials(shape, 3, 0)
    true = luminance_of(scene, mosaic.calibration.gamma)
    grid = pattern.grid(shape)
    places = np.ix_(grid.rows.clip(0, shape[0] - 1), grid.columns.clip(0, shape[1] - 1))
    blocks = (scene / true[..., None])[places].astype(np.float32)
    measured = sampled(mosaic, light)
    found = settle_luminance(light, blocks, measured, np.array(mosaic.calibration.gamma, np.float32), Switch(used=True))
    before, after = (float(np.square(each - true).mean()) for each in (light, found))
    assert after < 0.5 * before


def render_of(mosaic: Mosaic) -> Part:
    """A picture that is wrong everywhere, a little."""
    scene = materials(mosaic.shape, len(mosaic.pattern.channels), 0)
    light = luminance_of(scene, mosaic.calibration.gamma)
    random = np.random.default_rng(3)
    colour = scene / light[..., None] + random.normal(0, 0.02, scene.shape)
    colour /= (colour @ np.array(mosaic.calibration.gamma))[..., None]
    return Part(0, (light * random.uniform(0.95, 1.05, light.shape)).astype(np.float32), colour.astype(np.float32))


@every_case
@pytest.mark.parametrize("sigma", [None, 0.005])
def test_correction_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None) -> None:
    mosaic = shot(pattern, shape, sigma)
    part, noise, gamma = render_of(mosaic), mosaic.calibration.noise, mosaic.calibration.gamma
    light, colour, signal = (each.astype(np.float64) for each in (part.luminance, part.chromaticity, mosaic.signal))
    variance, fill_error = sites.noise_of(signal, pattern, noise), sites.fill_errors(light, pattern)
    expected = sites.correct(light, colour, signal, fill_error, variance, pattern, gamma)
    found = corrected(part, mosaic)
    assert_close(found.chromaticity * found.luminance[..., None], expected, FLOAT32)
    assert_close(found.chromaticity @ np.array(gamma), np.ones(shape), 1e-5)  # Eq. 7
    assert np.abs(expected - colour * light[..., None]).max() > 1e-3


@every_case
def test_without_noise_the_picture_reads_as_the_samples_do(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = shot(pattern, shape, None)
    part = render_of(mosaic)
    measured, found = sampled(mosaic, part.luminance), corrected(part, mosaic)
    for channel, place in zip(measured.sites.channels, measured.sites.places, strict=True):
        seen = found.chromaticity[*place, channel] * found.luminance[place]
        assert_close(seen, mosaic.signal[place], 1e-5)


def test_a_part_is_corrected_as_the_whole_is() -> None:
    pattern, shape = CfaPattern.bayer(6, origin=(3, 1)), (120, 40)
    mosaic = shot(pattern, shape, 0.01)
    picture, gamma = render_of(mosaic), np.array(mosaic.calibration.gamma, np.float32)
    measured, reach = sampled(mosaic, picture.luminance), site_reach(pattern.period)
    missed = Missed(measured, gamma)
    whole = missed(picture, (0, shape[0]))
    expected = correct_sites(whole, measured, gamma)
    for first, end in ((0, 70), (31, 99), (50, 120)):
        part = missed(picture.rows(first, end), (first, end))
        assert np.array_equal(part.missed, whole.missed[first:end])
        found = correct_sites(part, measured, gamma)
        top = first + reach if first else 0
        bottom = end - reach if end < shape[0] else end
        assert np.array_equal(found.rows(top, bottom).chromaticity, expected.rows(top, bottom).chromaticity)
        assert np.array_equal(found.rows(top, bottom).luminance, expected.rows(top, bottom).luminance)


def test_noise_alone_corrects_next_to_nothing() -> None:
    """A flat scene, rendered exactly: what the samples miss is noise, and the picture keeps almost all of its quality."""
    pattern, shape, sigma = CfaPattern.bayer(6), (180, 180), 0.02
    scene = np.full((*shape, 3), 0.3)
    clean = observe(scene, pattern)
    samples = clean.signal + np.random.default_rng(1).normal(0, sigma, shape).astype(np.float32)
    noise = NoiseModel.gaussian(sigma, 4)
    mosaic = Mosaic(samples, pattern, replace(clean.calibration, noise=noise))
    light = np.full(shape, 0.9, np.float32)
    part = Part(0, light, np.full((*shape, 3), 1 / 3, np.float32))
    found = corrected(part, mosaic)
    change = found.chromaticity * found.luminance[..., None] - scene
    colour_sites = ~pattern.panchromatic_mask(shape)
    assert np.sqrt(np.square(change[colour_sites]).mean()) < 0.15 * sigma


def test_blocks_at_the_limit_say_nothing() -> None:
    pattern, shape = CfaPattern.bayer(6), (60, 60)
    mosaic = shot(pattern, shape, None)
    limit = float(np.quantile(mosaic.signal, 0.8))
    part = render_of(mosaic)
    measured, found = sampled(mosaic, part.luminance, limit), corrected(part, mosaic, limit)
    assert 0 < measured.unclipped.mean() < 1
    for place in measured.sites.places:
        same = (found.luminance[place] == part.luminance[place]) == ~measured.unclipped
        assert same.mean() > 0.99


def test_gamma_only_scales_the_channels() -> None:
    """A scene whose channels are divided by gamma is the same to a panchromatic sensor, and is corrected alike."""
    pattern, shape = CfaPattern.bayer(6), (48, 48)
    scaled = np.array([0.5, 1.0, 2.0])
    mosaic = observe(materials(shape, 3, 0), pattern)
    other = observe(materials(shape, 3, 0) / scaled, pattern, tuple(scaled.tolist()))
    part = render_of(mosaic)
    same = replace(part, chromaticity=(part.chromaticity / scaled).astype(np.float32))
    one, two = corrected(part, mosaic), corrected(same, other)
    assert_close(two.chromaticity * scaled, one.chromaticity, 1e-5)
    assert gamma_of(pattern)  # the other tests use unequal gammas


def test_at_an_edge_without_luminance_none_is_invented() -> None:
    """Two colours of one brightness: the picture misses colour at the sites along the edge, and luminance is right everywhere."""
    pattern, shape = CfaPattern.bayer(6), (60, 60)
    scene = np.empty((*shape, 3))
    scene[:, :31], scene[:, 31:] = (0.5, 0.3, 0.1), (0.1, 0.3, 0.5)
    mosaic = observe(scene, pattern)
    light = np.full(shape, 0.9, np.float32)
    blurred = np.broadcast_to(np.array([1, 1, 1]) / 3, scene.shape)
    part = Part(0, light, blurred.astype(np.float32))
    found = corrected(part, mosaic)
    assert np.array_equal(found.luminance, light)
    assert np.abs(found.chromaticity - blurred).max() > 0.1


def test_errors_that_cannot_be_are_not_shared_out_in_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Correlations beyond one have no most probable errors: the picture is refused, not wrong."""
    monkeypatch.setattr("offline.stages.correction.nearness", lambda *_: np.full((4, 4), 3.0) - 2 * np.eye(4))
    mosaic = shot(CfaPattern.bayer(6), (48, 48), None)
    assert np.isnan(corrected(render_of(mosaic), mosaic).chromaticity).any()
