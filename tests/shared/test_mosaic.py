from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from panchroma.shared.calibration import SensorCalibration
from panchroma.shared.errors import InputError
from panchroma.shared.mosaic import Mosaic
from panchroma.shared.pattern import CfaPattern
from tests.reference import geometry

PATTERN = CfaPattern.bayer(4, "GRBG", (1, 3))
CALIBRATION = SensorCalibration(
    gamma=(0.8, 1.0, 1.2), black_level=(100.0, 110.0, 120.5, 130.0), white_level=3900
)  # different blacks: a plane taken for another shows
SHAPE = (13, 9)


def codes() -> Any:
    return np.random.default_rng(1).integers(0, 4096, SHAPE, np.uint16)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_every_code_survives_scene_units(bits: int) -> None:
    """And values stay what they are."""
    calibration = SensorCalibration.of_bits(bits)
    every = Mosaic(np.arange(2**bits, dtype=np.uint16).reshape(-1, 32), PATTERN, calibration)
    scene = every.in_scene_units()
    assert np.array_equal(scene.codes, every.samples)
    assert np.array_equal(scene.signal, every.signal)
    assert scene.in_scene_units() is scene
    wide: Any = scene.signal.astype(np.float64)
    assert Mosaic(wide, PATTERN, calibration).samples.dtype == np.float32
    swapped: Any = every.samples.astype(every.samples.dtype.newbyteorder())
    assert np.array_equal(Mosaic(swapped, PATTERN, calibration).samples, every.samples)


def test_quantisation_rounds_to_the_nearest_and_stays_within_the_code_range() -> None:
    scale = CALIBRATION.scale()[3]
    values = np.zeros(SHAPE, np.float32)
    place = next(place for place in np.ndindex(SHAPE) if geometry.letter(PATTERN, *place) == "W")
    outside = {-500.0: 0, 500.0: 4095, -3e38: 0, 3e38: 4095}
    for value, code in {0.4 * scale: 130, 0.6 * scale: 131, 3.0: 3900, **outside}.items():
        values[place] = value
        assert Mosaic(values, PATTERN, CALIBRATION).codes[place] == code


def test_every_plane_has_its_own_levels_wherever_the_frame_begins() -> None:
    """Against the definition in double precision, every phase of the pattern; no value lies near
    the middle of two codes.
    """
    blacks = 900.0, 1000.0, 1100.0, 1200.0
    calibration = SensorCalibration(gamma=(0.8, 1.0, 1.2), black_level=blacks, white_level=60000)
    for origin in np.ndindex(4, 4):
        pattern = CfaPattern.bayer(4, "GBRG", origin)
        steps = np.random.default_rng(2).integers(0, 65000, SHAPE) + 0.3
        values = np.empty(SHAPE)
        for place in np.ndindex(SHAPE):
            black = blacks["RGBW".index(geometry.letter(pattern, *place))]
            values[place] = (steps[place] - black) / (60000 - black) * 3.0
        codes = np.floor(steps).astype(np.uint16)
        assert np.array_equal(Mosaic(values.astype(np.float32), pattern, calibration).codes, codes)
        signal, rest = Mosaic(codes, pattern, calibration).signal, 0.3 / (60000 - 1200) * 3.0
        np.testing.assert_allclose(signal, values, atol=1.01 * rest)


@pytest.mark.parametrize("floating", [False, True])
def test_nothing_that_comes_or_goes_shares_memory_that_can_change(floating: bool) -> None:
    samples = codes().astype(np.float32) if floating else codes()
    mosaic = Mosaic(samples, PATTERN, CALIBRATION)
    before = mosaic.samples.copy()
    samples[:] = 0
    assert np.array_equal(mosaic.samples, before)
    for array in (mosaic.samples, mosaic.signal, mosaic.codes):
        assert not array.flags.writeable
        assert array.flags.c_contiguous


def test_codes_that_nobody_can_change_are_not_copied() -> None:
    wide = codes()
    for view in (wide[:, :7], wide[::-1, ::-1]):
        assert not np.shares_memory(Mosaic(view, PATTERN, CALIBRATION).samples, wide)
    wide.flags.writeable = False
    assert np.shares_memory(Mosaic(wide[:, :7], PATTERN, CALIBRATION).samples, wide)
    turned = Mosaic(wide.T[::-1, ::2], PATTERN, CALIBRATION).samples
    assert turned.flags.c_contiguous
    assert np.array_equal(turned, wide.T[::-1, ::2])
    for memory, kept in ((wide.tobytes(), True), (bytearray(wide), False)):
        samples = np.frombuffer(memory, np.uint16).reshape(SHAPE)
        assert np.shares_memory(Mosaic(samples, PATTERN, CALIBRATION).samples, samples) == kept


def test_another_calibration_has_to_fit_too() -> None:
    mosaic = Mosaic(codes(), PATTERN, CALIBRATION)
    other = mosaic.calibrated(replace(CALIBRATION, black_level=(90.0,) * 4))
    assert other.samples is mosaic.samples
    assert np.array_equal(other.signal, Mosaic(codes(), PATTERN, other.calibration).signal)
    with pytest.raises(InputError, match="different sensors"):
        mosaic.calibrated(SensorCalibration.of_bits(12, channels="XY", gamma=(1.0, 1.0)))
    with pytest.raises(InputError, match="more than the calibration's 10 bits"):
        mosaic.calibrated(SensorCalibration.of_bits(10))
