"""What a picture states of its errors: its literal transcription, its units, and whether it is true of photographs."""

from dataclasses import replace

import numpy as np
import pytest

from offline import BEST, PAPER, colour_bands, measure, render, row_stages, with_uncertainty
from offline.burst import Motion, merge_burst, render_burst_bands
from offline.measured import Measured
from offline.parts import Part
from offline.rows.uncertainty import Uncertainty
from shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration, Shading
from shared.errors import InputError
from shared.sensor import simulate_additive
from tests.offline.scenes import every_case, gamma_of, shot
from tests.reference import geometry
from tests.reference import uncertainty as reference
from tests.reference.compare import assert_close

FLOAT32 = 2e-5  # variances of shares of light, from sums of squares in float64
WEIGHTS = ((0.3, 0.4, 0.5, 0.6, 0.7, 0.8), (0.2, 0.3, 0.4, 0.5, 0.6, 0.7))


@every_case
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    random, gamma = np.random.default_rng(0), gamma_of(pattern)
    down, across = geometry.patch_counts(pattern, shape)
    blocks = random.uniform(0.1, 1, (down + 1, across + 1, len(gamma))).astype(np.float32)
    before, after = random.uniform(0.5, 1, (2, *shape)).astype(np.float32)
    colour = random.uniform(0.1, 1, (*shape, len(gamma))).astype(np.float32)
    planes = len(pattern.planes)
    noise, grain = NoiseModel((0.01,) * planes, (0.02,) * planes), NoiseModel((0.02,) * planes, (0.05,) * planes)
    calibration = SensorCalibration(gamma=gamma, channels=pattern.channels, noise=noise)
    measured = Measured(pattern, calibration, before, blocks)
    stage, part = Uncertainty(measured, grain, weights=WEIGHTS), Part(0, after, colour)
    found = stage(part, (0, shape[0])).uncertainty
    known = noise.variance(after).astype(np.float64)
    variances = known, np.maximum(grain.variance(after) - 1.1 * known, 0)
    l1, l0, c, c_j = (each.astype(np.float64) for each in (after, before, colour, blocks))
    assert_close(found, reference.uncertainty(l1, l0, c, c_j, variances, pattern, gamma, WEIGHTS), FLOAT32)
    assert found.min() >= 0


def test_to_state_it_changes_no_bit_of_the_picture_and_bands_state_the_same() -> None:
    mosaic = shot(CfaPattern.bayer(4, origin=(1, 2)), (330, 61))
    plain, stating = render(mosaic), render(mosaic, uncertainty=True)
    assert plain.uncertainty is None
    assert np.array_equal(plain.rgb, stating.rgb)
    bands = list(colour_bands(measure(mosaic), stages=with_uncertainty(mosaic, row_stages)))
    assert len(bands) > 1
    assert np.array_equal(np.concatenate(bands), np.concatenate([stating.rgb, stating.uncertainty], axis=2))


def test_half_the_light_is_off_by_half_as_much() -> None:
    mosaic = shot(CfaPattern.bayer(6), (60, 66))
    noise = mosaic.calibration.noise
    calibration = replace(mosaic.calibration, noise=NoiseModel(noise.shot, tuple(each / 2 for each in noise.read)))
    one = render(mosaic, uncertainty=True).uncertainty
    half = render(Mosaic((mosaic.signal / 2).astype(np.float32), mosaic.pattern, calibration), uncertainty=True).uncertainty
    np.testing.assert_allclose(2 * half, one, rtol=2e-2)


def test_a_grey_wall_without_noise_is_exact_and_noise_makes_it_uncertain() -> None:
    scene = np.full((120, 126, 3), 0.5, np.float32)
    stated = []
    for sigma in (0.0, 0.01, 0.03):
        mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), sigma, np.random.default_rng(0))
        stated.append(np.median(render(mosaic, uncertainty=True).uncertainty, axis=(0, 1)))
    assert stated[0].max() < 1e-4
    assert (stated[1] > 10 * stated[0]).all()
    assert (stated[2] > 1.5 * stated[1]).all()


def test_light_that_is_lost_may_be_off_by_all_of_it() -> None:
    scene = np.full((60, 60, 3), 0.3, np.float32)
    scene[28:32, 28:32] = 3.0
    mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), 0.0, np.random.default_rng(0))
    calibration = SensorCalibration.of_bits(12)
    clipped = Mosaic(
        Mosaic(mosaic.signal.clip(0, calibration.full_scale), mosaic.pattern, calibration).codes, mosaic.pattern, calibration
    )
    found = render(clipped, uncertainty=True)
    lost = found.lost == 255
    assert lost.any()
    assert (found.uncertainty[lost] >= found.luminance[lost, None]).all()


def test_light_that_falls_off_is_made_even_with_its_uncertainty() -> None:
    pattern, shape = CfaPattern.bayer(6), (60, 66)
    points = 1 + 0.1 * (np.arange(5)[:, None] - 2 + np.zeros(5))  # a ramp, 1 in the middle
    shading = Shading((points.tolist(),) * len(pattern.planes), shape)
    measured = measure(shot(pattern, shape))
    colour = np.random.default_rng(0).uniform(0.2, 0.5, (*shape, 3)).astype(np.float32)
    shaded = replace(measured, calibration=replace(measured.calibration, shading=shading))
    gain = shading.of_plane(shape)
    plain = Uncertainty(measured, None)(Part(0, measured.luminance, colour), (0, 60)).uncertainty
    even = Uncertainty(shaded, None)(Part(0, measured.luminance * gain, colour), (0, 60)).uncertainty
    np.testing.assert_allclose(even, gain[..., None] * plain, rtol=1e-3)


def test_the_paper_does_not_know_how_far_it_is_off() -> None:
    with pytest.raises(InputError, match="best and unlearned"):
        render(shot(CfaPattern.bayer(6), (30, 30)), PAPER, uncertainty=True)


def test_merged_frames_are_less_uncertain() -> None:
    scene, random = np.full((96, 96, 3), 0.4, np.float32), np.random.default_rng(1)
    scene[:, 48:] *= 0.5
    frames = [simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration(), 0.03, random) for _ in range(4)]
    merged = merge_burst(frames, reference=0, motions=[Motion((0.0, 0.0))] * 4)
    found = np.concatenate(list(render_burst_bands(merged, BEST, uncertain=frames[0])))
    alone = render(frames[0], uncertainty=True).uncertainty
    assert found.shape == (96, 96, 7)
    assert (np.median(found[..., 3:] / alone, axis=(0, 1)) < (0.7, 0.9, 0.9, 0.9)).all()
