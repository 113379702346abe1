"""Errors at the colour sites: exact where the model holds, and none of them invented."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import median_filter

from panchroma.offline import BEST, PAPER, UNLEARNED, render
from panchroma.offline.bands import Band
from panchroma.offline.stages.chromaticity import block_sums
from panchroma.offline.stages.correction import Correction, SiteResidual, update_luminance
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.tools.simulation.sensor import simulate_sensor
from tests.offline.scenes import every_case, materials, photographed, sampled, shot, true_light
from tests.reference.chromaticity import extend
from tests.reference.compare import assert_close
from tests.reference.sensor import observe
from tests.scenes import leaves

BAYER = CfaPattern.bayer(6, origin=(1, 2))


def corrected(band: Band, mosaic: Mosaic, clipping: float = np.inf) -> Band:
    """The picture corrected by the samples of a mosaic."""
    frame, rows = sampled(mosaic, band.luminance, clipping), (band.first, band.end)
    return Correction(frame)(SiteResidual(frame)(band, rows), rows)


def settled(mosaic: Mosaic, light: FloatArray, sigma: float = 1e-3) -> FloatArray:
    """Luminance settled with the chromaticities that Eqs. 8-9 find in it."""
    frame = sampled(mosaic, light)
    blocks = extend(block_sums(frame).solved(sigma, frame.gamma), mosaic.pattern, mosaic.shape)
    return update_luminance(replace(frame, blocks=blocks.astype(np.float32)))


def wrong_light(mosaic: Mosaic) -> FloatArray:
    """Luminance of `shot`, with errors at the colour sites, as hole filling makes them."""
    true = true_light(mosaic.pattern, mosaic.shape)
    wrong = true * np.random.default_rng(9).uniform(0.9, 1.1, true.shape).astype(np.float32)
    return np.where(mosaic.pattern.panchromatic_mask(mosaic.shape), true, wrong)


def test_the_update_brings_luminance_closer_where_chromaticity_is_known() -> None:
    mosaic = shot(BAYER, (90, 96), None)
    light = wrong_light(mosaic)
    true = true_light(BAYER, mosaic.shape)
    scene = materials(mosaic.shape, 3)
    grid = BAYER.grid(mosaic.shape)
    places = np.ix_(grid.rows.clip(0, 89), grid.columns.clip(0, 95))
    blocks = (scene / true[..., None])[places].astype(np.float32)
    result = update_luminance(replace(sampled(mosaic, light), blocks=blocks))
    assert np.square(result - true).mean() < 0.5 * np.square(light - true).mean()


def test_settled_luminance_has_no_seams_where_strips_of_blocks_meet(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mosaic = shot(CfaPattern.bayer(3), (212, 12), 0.01)
    light = wrong_light(mosaic)
    expected = settled(mosaic, light)
    monkeypatch.setattr("panchroma.offline.stages.correction.BLOCK_ROWS", 1000)
    assert np.array_equal(settled(mosaic, light), expected)


def render_of(mosaic: Mosaic) -> Band:
    """A picture that is wrong everywhere, a little."""
    light, random = true_light(mosaic.pattern, mosaic.shape), np.random.default_rng(3)
    scene = materials(mosaic.shape, len(mosaic.pattern.channels))
    colour = scene / light[..., None] + random.normal(0, 0.02, scene.shape)
    colour /= (colour @ np.array(mosaic.calibration.gamma))[..., None]
    wrong = light * random.uniform(0.95, 1.05, light.shape)
    return Band(0, wrong.astype(np.float32), colour.astype(np.float32))


@every_case
def test_without_noise_the_picture_reads_as_the_samples_do(
    pattern: CfaPattern, shape: tuple[int, int]
) -> None:
    mosaic = shot(pattern, shape, None)
    band = render_of(mosaic)
    sites, result = sampled(mosaic, band.luminance).sites, corrected(band, mosaic)
    for channel, place in zip(sites.channels, sites.places, strict=True):
        found = result.chromaticity[*place, channel] * result.luminance[place]
        assert_close(found, mosaic.signal[place], 1e-5)
    gamma = np.array(mosaic.calibration.gamma)
    assert_close(result.chromaticity @ gamma, np.ones(shape), 1e-5)  # Eq. 7


def test_noise_alone_corrects_next_to_nothing() -> None:
    """A flat scene, rendered exactly: the residuals are noise, and the picture keeps almost all of
    its quality.
    """
    scene, sigma = np.full((180, 180, 3), 0.3, np.float32), 0.02
    mosaic = photographed(scene, BAYER, sigma, seed=1)
    grey = np.full_like(scene, 1 / 3)
    result = corrected(Band(0, scene.sum(axis=2), grey), mosaic)
    change = result.chromaticity * result.luminance[..., None] - scene
    sites = ~BAYER.panchromatic_mask(mosaic.shape)
    assert np.sqrt(np.square(change[sites]).mean()) < 0.15 * sigma


def test_in_even_noise_no_sample_makes_a_speck() -> None:
    random, camera = np.random.default_rng(0), SensorCalibration.of_bits(12)
    grey = np.full((240, 360, 3), 0.4, np.float32)
    rgb = render(simulate_sensor(grey, BAYER, camera, 1 / 64, random), BEST).rgb
    apart = np.abs(rgb - median_filter(rgb, (5, 5, 1))).max(axis=2)
    assert apart.max() < 0.12 * rgb.mean()


def test_blocks_at_the_limit_say_nothing() -> None:
    mosaic = shot(BAYER, (60, 60), None)
    limit, band = float(np.quantile(mosaic.signal, 0.8)), render_of(mosaic)
    samples, result = sampled(mosaic, band.luminance, limit), corrected(band, mosaic, limit)
    assert 0 < samples.unclipped.mean() < 1
    for place in samples.sites.places:
        is_same = result.luminance[place] == band.luminance[place]
        assert (is_same == ~samples.unclipped).mean() > 0.99


def test_at_an_edge_without_luminance_none_is_invented() -> None:
    """Two colours of one brightness: the residuals along the edge are colour, and luminance is
    right everywhere.
    """
    scene = np.full((60, 60, 3), (0.1, 0.3, 0.5))
    scene[:, :31] = 0.5, 0.3, 0.1
    light, grey = np.full((60, 60), 0.9, np.float32), np.full(scene.shape, 1 / 3, np.float32)
    result = corrected(Band(0, light, grey), observe(scene, CfaPattern.bayer(6)))
    assert np.array_equal(result.luminance, light)
    assert np.abs(result.chromaticity - grey).max() > 0.1


@pytest.mark.parametrize("tile", ["RGWW/GBWW/WWWW/WWWW", "WBWG/BWGW/WGWR/GWRW", "RW/WB"])
def test_samples_at_the_sites_bring_a_picture_closer(tile: str) -> None:
    scene = leaves(96, 100)
    mosaic = photographed(scene, CfaPattern.of_letters(tile, channels="RGB"))
    errors = [
        np.square(render(mosaic, settings).rgb - scene).mean()
        for settings in (replace(UNLEARNED, correction=PAPER.correction), UNLEARNED)
    ]
    assert errors[1] < 0.97 * errors[0]
