"""A render undoes the shading of light and colour that the calibration knows."""

import numpy as np
import pytest

from panchroma.offline import render
from panchroma.shared import CfaPattern, FloatArray, SensorCalibration, Shading
from panchroma.tools.simulation.lens import lens_shading
from panchroma.tools.simulation.sensor import simulate_sensor

SHAPE = (240, 360)
DARK = lens_shading(2, 0.15, 4, SHAPE)


def white(light: float, shading: Shading | None) -> FloatArray:
    """A render of a warm white surface on grey, near a corner, by a sensor that clips."""
    rgb = np.full((*SHAPE, 3), 0.3, np.float32)
    rgb[30:90, 30:90] = np.array([1.0, 0.8, 0.6], np.float32) * light
    sensor = SensorCalibration.of_bits(12, headroom=False, neutral=(1.0, 0.8, 0.6), shading=shading)
    shot = simulate_sensor(rgb, CfaPattern.bayer(6), sensor, 1.0, np.random.default_rng(0))
    return render(shot).rgb[45:75, 45:75]


def test_saturation_is_judged_before_the_gain() -> None:
    # Twice full scale, and no sample of it is saturated: there is nothing to restore.
    assert white(2.0, DARK).mean(axis=(0, 1)) == pytest.approx([2.0, 1.6, 1.2], rel=0.02)
    # Panchromatic samples are saturated, and the blocks tell how bright the surface is.
    assert white(3.5, DARK).mean(axis=(0, 1)) == pytest.approx([3.5, 2.8, 2.1], rel=0.03)
    assert white(1.6, None).mean(axis=(0, 1)) == pytest.approx([1.6, 1.28, 0.96], rel=0.05)
