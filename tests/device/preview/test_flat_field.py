"""A preview without the shading that the calibration knows."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.device import Preview
from panchroma.device.preview.flat_field import correct_flat_field
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from tests.scenes import darker_corners, leaves

SHAPE = (240, 360)
LENS = darker_corners(SHAPE)
PATTERN = CfaPattern.bayer(6)


def shot(bits: int, shading: bool, light: float = 1.0) -> Mosaic:
    calibration = SensorCalibration.of_bits(bits, shading=LENS if shading else None)
    rgb = leaves(*SHAPE) * np.float32(light)
    taken = simulate_additive(rgb, PATTERN, calibration, 0.0, np.random.default_rng(0))
    return Mosaic(taken.codes, PATTERN, taken.calibration)


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_codes_without_shading_are_the_light(bits: int) -> None:
    mosaic = shot(bits, shading=True)
    codes, levels = correct_flat_field(mosaic)
    planes = PATTERN.filter_map(SHAPE)
    light = (codes - levels["black"][planes]) * levels["scale"][planes]
    rounding = 0.51 * float(levels["scale"].max())
    np.testing.assert_allclose(light, mosaic.signal, atol=rounding, rtol=1e-5)
    # hardly coarser, or fine enough
    assert levels["scale"].max() < max(1.1 * mosaic.calibration.scale().max(), 3e-4)


@pytest.mark.parametrize(("scale", "linear"), [(1, True), (1, False), (3, False)])
def test_a_preview_does_not_show_shading(scale: int, linear: bool) -> None:
    even, undone = (
        Preview.for_mosaic(shot(16, False), scale, linear).run(shot(16, shading))
        for shading in (False, True)
    )
    apart = np.abs(undone.astype(float) - even)
    assert np.quantile(apart, 0.99) <= (0.005 if linear else 2)


def test_noise_below_black_stays() -> None:
    calibration = replace(SensorCalibration.of_bits(12), shading=LENS)
    codes, levels = correct_flat_field(Mosaic(np.zeros(SHAPE, np.uint16), PATTERN, calibration))
    assert int(codes.min()) >= 0
    expected = -256 * calibration.scale()[-1] * LENS.of_plane(SHAPE)[5, 5]
    found = (codes[5, 5] - levels["black"][-1]) * levels["scale"][-1]
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("scale", [1, 3])
@pytest.mark.parametrize("headroom", [True, False])
def test_light_that_is_not_saturated_keeps_its_colour_where_the_gain_is_large(
    scale: int, headroom: bool
) -> None:
    calibration = SensorCalibration.of_bits(12, headroom=headroom, shading=LENS)
    # 0.4 of full scale before the gain
    red = np.broadcast_to(np.array((1.1, 0.05, 0.02), np.float32), (*SHAPE, 3))
    gain = LENS.of_plane(SHAPE)[..., None]
    assert gain[0, 0] > 3
    taken = simulate_additive(red * gain, PATTERN, calibration, 0.0, np.random.default_rng(0))
    mosaic = Mosaic(taken.codes, PATTERN, calibration)
    assert mosaic.codes.max() < 0.5 * 4095
    corner = Preview.for_mosaic(mosaic, scale).run(mosaic)[: 20 // scale, : 20 // scale].astype(int)
    assert corner[..., 0].min() > 250
    assert (corner[..., 0] - corner[..., 1:].max(axis=2)).min() > 100


@pytest.mark.parametrize("scale", [1, 3])
def test_what_is_saturated_is_white_wherever_the_gain_is_small_or_large(scale: int) -> None:
    neutral = (0.6, 1.0, 0.7)
    calibration = SensorCalibration.of_bits(12, headroom=False, shading=LENS, neutral=neutral)
    codes = np.full(SHAPE, 4095, np.uint16)
    for _, *lattice in PATTERN.lattices:
        codes[*lattice] = 2000  # panchromatic samples alone are saturated
    assert Preview(PATTERN, scale).run(Mosaic(codes, PATTERN, calibration)).min() == 255


@pytest.mark.parametrize(("scale", "linear"), [(1, True), (1, False), (3, True)])
@pytest.mark.parametrize(("shot", "read"), [(0.0, 0.03), (4e-3, 0.004)])
def test_corners_are_as_smooth_as_their_noise_after_the_gain_asks_for(
    scale: int, linear: bool, shot: float, read: float
) -> None:
    corner = np.s_[: 24 // scale, : 24 // scale]
    gain = float(LENS.of_plane(SHAPE)[:24, :24].mean())
    noise = NoiseModel((shot,) * 4, (read,) * 4)
    camera = SensorCalibration.of_bits(14, noise=noise, shading=LENS)
    scene = 0.3 * leaves(*SHAPE)
    taken = simulate_sensor(scene, PATTERN, camera, 1.0, np.random.default_rng(0))
    preview = Preview.for_mosaic(taken, scale, linear)
    pictures = [preview.run(taken)]
    for factor in (gain, 1.0):  # the same light and noise, stated rightly, and as before the gain
        stated = replace(noise, shot=(shot * factor,) * 4, read=(read * factor,) * 4)
        even = SensorCalibration.of_bits(16, noise=stated)
        pictures.append(preview.run(Mosaic(taken.signal, PATTERN, even)))
    found, right, wrong = (picture[corner].astype(float) for picture in pictures)
    assert np.square(found - right).mean() < np.square(found - wrong).mean() / 16
