"""A preview without the shading that the calibration knows."""

from dataclasses import replace

import numpy as np
import pytest

from device import Preview
from device.preview.even_light import even_light
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.sensor import simulate_additive
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
    codes, levels = even_light(mosaic)
    planes = PATTERN.filter_map(SHAPE)
    light = (codes - levels["black"][planes]) * levels["scale"][planes]
    np.testing.assert_allclose(light, mosaic.signal, atol=0.51 * float(levels["scale"].max()), rtol=1e-5)
    assert levels["scale"].max() < max(1.1 * mosaic.calibration.scale().max(), 3e-4)  # hardly coarser, or fine enough


@pytest.mark.parametrize(("scale", "linear"), [(1, True), (1, False), (3, False)])
def test_a_preview_does_not_show_shading(scale: int, linear: bool) -> None:
    even, undone = (Preview.for_mosaic(shot(16, False), scale, linear).run(shot(16, shading)) for shading in (False, True))
    apart = np.abs(undone.astype(float) - even)
    assert np.quantile(apart, 0.99) <= (0.005 if linear else 2)


def test_a_frame_without_shading_is_its_own() -> None:
    mosaic = shot(12, shading=False)
    codes, levels = even_light(mosaic)
    assert codes is mosaic.samples
    assert levels == {}


def test_noise_below_black_stays() -> None:
    calibration = replace(SensorCalibration.of_bits(12), shading=LENS)
    codes, levels = even_light(Mosaic(np.zeros(SHAPE, np.uint16), PATTERN, calibration))
    assert int(codes.min()) >= 0
    expected = -256 * calibration.scale()[-1] * LENS.of_plane(SHAPE)[5, 5]
    assert (codes[5, 5] - levels["black"][-1]) * levels["scale"][-1] == pytest.approx(expected, rel=1e-3)
