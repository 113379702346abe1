import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from panchroma.shared.calibration import BITS, NoiseModel, SensorCalibration
from tests.walking import one_field_changed

FULL = SensorCalibration(
    "RGB",
    gamma=(0.9, 1.1, 1.2),
    noise=NoiseModel((1e-4, 2e-4, 3e-4, 4e-4), (0.01, 0.02, 0.03, 0.04)),
    black_level=(60.0, 61.5, 62.0, 64.0),
    white_level=4000,
    camera_to_xyz=((0.4, 0.3, 0.2), (0.2, 0.7, 0.1), (0.0, 0.1, 0.7)),
    neutral=(0.5, 1.0, 0.7),
    sensor="bench camera",
)


@pytest.mark.parametrize("bits", BITS)
def test_levels_of_bits_leave_room_at_both_ends(bits: int) -> None:
    calibration = SensorCalibration.of_bits(bits)
    clipping = SensorCalibration.of_bits(bits, headroom=False)
    black, highest = 2**bits // 16, 2**bits - 1
    assert calibration.black_level == clipping.black_level == (black,) * 4
    assert (calibration.white_level, clipping.white_level) == (highest - black, highest)
    assert calibration.bits == clipping.bits == bits


def test_noise_is_poisson_plus_gaussian_per_plane() -> None:
    noise = NoiseModel((0.0, 0.04), (0.3, 0.1))
    assert noise.sigma(5.0, plane=0) == pytest.approx(0.3)
    assert noise.sigma(2.0) == noise.sigma(2.0, plane=1) == pytest.approx(math.sqrt(0.08 + 0.01))
    assert noise.sigma(-1.0) == pytest.approx(0.1)  # a sample below black has no shot noise
    assert NoiseModel.gaussian(0.02, 4) == NoiseModel((0.0,) * 4, (0.02,) * 4)


def test_values_of_any_type_are_taken_as_what_they_hold() -> None:
    fields: dict[str, Any] = {
        "gamma": np.array([1, 2, 3]),
        "black_level": np.array([60, 61, 62, 63]),
        "white_level": np.uint16(4000),
        "neutral": np.array([0.5, 1.0, 0.75], np.float32),
        "camera_to_xyz": np.eye(3),
    }
    ours = SensorCalibration(**fields)
    plain = SensorCalibration(**{name: value.tolist() for name, value in fields.items()})
    assert (ours, ours.id, ours.bits) == (plain, plain.id, 12)
    assert SensorCalibration(defects=((5, 1), (2, 3), (5, 1))).defects == ((2, 3), (5, 1))


def test_id_depends_on_every_field_but_the_camera() -> None:
    plain = replace(FULL)  # without a cached id
    ids = {name: other.id for name, other in one_field_changed(plain) if name != "lights"}
    assert ids.pop("camera") == plain.id
    assert len({plain.id, *ids.values()}) == len(ids) + 1
    # as before a calibration had parts of the lens
    assert SensorCalibration().id == "cf85a866dfbe7789"
