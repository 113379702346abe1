import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma.shared import Camera, CfaPattern, Mosaic, NoiseModel, SensorCalibration, read_camera
from panchroma.shared.errors import InputError

CALIBRATION = SensorCalibration(
    gamma=(0.9, 1.1, 0.8),
    noise=NoiseModel.gaussian(0.01, 4),
    black_level=(250.0,) * 4,
    white_level=4095,
    defects=((1, 2),),
    sensor="bench",
)
TILE = {"tile": ["RGW", "GBW", "WWW"]}
CAMERA = Camera(CALIBRATION, CfaPattern.bayer(6), {"gamma": {"shots": ["a.dng"]}})


def mosaic(pattern: CfaPattern, **changes: Any) -> Mosaic:
    calibration = replace(SensorCalibration.of_bits(12, headroom=False), **changes)
    return Mosaic(np.full((24, 24), 500, np.uint16), pattern, calibration)


def test_json_and_back_is_the_identity(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(CAMERA.to_json()))
    assert read_camera(path) == CAMERA
    assert CAMERA.calibration.camera == CALIBRATION.id
    assert replace(CAMERA.calibration, noise=None).camera == CALIBRATION.id
    assert Camera.from_json({"schema": 1, "gamma": [1, 2, 3]}).calibration.gamma == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pattern": 7}, "pattern: 7 is not an object with tile, origin and channels"),
        ({"pattern": {"tile": 3}}, "pattern: .* is not an object with tile"),
        ({"pattern": {**TILE, "origin": [0]}}, "pattern: .* is not an object with tile"),
        ({"pattern": {**TILE, "origin": [0, 0.5]}}, "origin is 0.5, expected a whole number"),
        ({"pattern": {**TILE, "size": 1}}, "pattern: .* is not an object with tile"),
        ({"pattern": {"tile": ["XYW", "YZW", "WWW"]}}, "RGB.*XYZ"),
        ({"size": [0, 24]}, "size is .*, expected .rows, columns."),
        ({"measured": []}, "measured"),
        ({"measured": {"taste": {}}}, "unknown entry 'taste'"),
        ({"measured": {"gamma": 1}}, "measured.gamma"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(
    change: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**CAMERA.to_json(), **change}))
    with pytest.raises(InputError, match=words) as caught:
        read_camera(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("tile", "channels", "expected"),
    [(("RWRW", "WBWB") * 2, "RB", "RB"), (("WWWW", "WRWR") * 2, "", "RC")],
)
def test_channels_that_only_one_part_names_are_those_of_both(
    tile: tuple[str, ...], channels: str, expected: str
) -> None:
    document = {"schema": 1, "gamma": [1, 2], "pattern": {"tile": tile}}
    camera = Camera.from_json(document | ({"channels": channels} if channels else {}))
    assert camera.pattern is not None
    assert (camera.calibration.channels, camera.pattern.channels) == (expected, expected)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        read_camera(tmp_path / "absent.json")
    (tmp_path / "torn.json").write_text('{"schema": 1,')
    with pytest.raises(InputError, match="not JSON"):
        read_camera(tmp_path / "torn.json")


@pytest.mark.parametrize(
    ("pattern", "changes", "words"),
    [
        (CfaPattern.bayer(6), {"sensor": "other"}, "'other'.*'bench'"),
        (CfaPattern.bayer(8), {}, "period 8.*period 6"),
        (CfaPattern.bayer(6, "BGGR"), {}, "BGWWWW.*RGWWWW"),
        (CfaPattern.bayer(6), {"white_level": 60000}, "16 bits.*12"),
        (CfaPattern.bayer(6), {"white_level": 1000}, "10 bits.*12"),
    ],
)
def test_another_camera_is_refused_and_both_are_named(
    pattern: CfaPattern, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        CAMERA.calibrated(mosaic(pattern, **changes))


def test_a_calibrated_shot_keeps_what_the_camera_does_not_know() -> None:
    shot = mosaic(CfaPattern.bayer(6), neutral=(0.5, 1.0, 0.7), defects=((3, 4),))
    expected = replace(CAMERA.calibration, neutral=(0.5, 1.0, 0.7))
    assert CAMERA.calibrated(shot).calibration == expected
    coloured = replace(CALIBRATION, neutral=(0.6, 1.0, 0.6), defects=())
    for measured, defects in ({}, ((3, 4),)), ({"defects": {"frames": 10}}, ()):
        known = Camera(coloured, CAMERA.pattern, measured).calibrated(shot).calibration
        assert (known.neutral, known.defects) == ((0.6, 1.0, 0.6), defects)
