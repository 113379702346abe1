import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from panchroma.shared.calibration import BITS, SCHEMA, NoiseModel, SensorCalibration
from panchroma.shared.errors import InputError
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


def matrix(*first_row: float) -> Any:
    return first_row, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


SMALLEST = "whose largest figure is not 1e-06"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": SCHEMA + 1}, "schema"),
        ({"gama": [1, 1, 1]}, "unknown field 'gama'"),
        ({"channels": 3}, "channels is 3, expected str"),
        ({"sensor": None}, "sensor is None, expected str"),
        ({"neutral_estimated": 1}, "neutral_estimated is 1, expected bool"),
        ({"neutral_estimated": True}, "there is no neutral"),
        *(
            ({"channels": letters}, "channels is .*, expected two or more")
            for letters in ("R", "RGR", "rgb")
        ),
        ({"channels": "RGW"}, "W stands for panchromatic"),
        ({"gamma": (1.0, 1.0)}, "gamma has 2 figures, expected 3"),
        *(
            ({"gamma": (1.0, figure, 1.0)}, "gamma holds .*, expected 0.001 to 1000")
            for figure in (1e308, 1e-320)
        ),
        ({"black_level": (64.0, 64.0, 64.0)}, "black_level has 3 figures, expected 4"),
        ({"black_level": (64.0, 64.0, 64.0, 65000.0)}, "expected 0 <= black"),
        ({"black_level": (4094.9,) * 4, "white_level": 4095}, "at least 16 codes below white"),
        ({"white_level": 65536}, "white, which is 65535 at most"),
        ({"white_level": 4000.0}, "white_level is 4000.0, expected a whole number"),
        ({"noise": NoiseModel.gaussian(0.1, 3).__dict__}, "noise has 3 planes, expected 4"),
        (
            {"noise": {"shot": (1e308,) * 4, "read": (0.1,) * 4}},
            "noise.shot holds .*, expected 0, or 1e-12",
        ),
        ({"noise": {"shot": (-0.1,), "read": (0.1,)}}, "noise.shot has a negative"),
        ({"noise": {"shot": (0.1,), "read": (0.1, 0.1)}}, "1 planes, noise.read 2"),
        ({"noise": {"shot": [0.0] * 4}}, "noise is .*, expected an object with shot, read"),
        ({"neutral": (1.0, 1e-320, 1.0)}, "neutral holds .*, expected 1e-06 to"),
        *(({"camera_to_xyz": matrix(figure, 0.0, 0.0)}, SMALLEST) for figure in (1e300, 5e-324)),
        ({"camera_to_xyz": matrix(1.0, 1e9, 0.0)}, SMALLEST),
        ({"camera_to_xyz": ((1.0, 0.0, 0.0), (0.0, 1.0, 1.0), (0.0, 1.0, 1.00001))}, "full rank"),
        ({"camera_to_xyz": matrix(1.0, 0.0, 0.0)[:2]}, "expected 3 rows of 3 figures"),
        ({"defects": list(np.ndindex(1025, 1025))}, "defects holds 1050625 pixels"),
        *(
            ({"defects": places}, "defects is not")
            for places in ([[1, 2, 3]], [[1.5, 2]], [[-1, 2]], [[0, 2**40]], 7)
        ),
    ],
)
def test_wrong_documents_are_refused_by_field(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        SensorCalibration.from_json({**SensorCalibration().to_json(), **change})


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


@pytest.mark.parametrize("document", [None, [], "text", 5, {}])
def test_what_is_not_a_calibration_is_refused(document: Any) -> None:
    with pytest.raises(InputError, match="calibration"):
        SensorCalibration.from_json(document)
    with pytest.raises(InputError, match="7 bits: expected 8 to 16"):
        SensorCalibration.of_bits(7)
