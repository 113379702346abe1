"""What is measured of a lens, in shots and camera files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shared import Camera, CfaPattern, Mosaic, SensorCalibration, read_camera, read_dng, write_dng
from shared.sensor import simulate_sensor
from tests.scenes import darker_corners, displaced_channels

SHAPE = (61, 90)
BARE = SensorCalibration.of_bits(16, gamma=(0.9, 1.1, 0.8))
KNOWN = {"shading": darker_corners(SHAPE), "aberration": displaced_channels(SHAPE)}


def shot(part: str) -> Mosaic:
    """A shot of a lens of which this part is known."""
    scene = np.random.default_rng(1).uniform(0.1, 1, (*SHAPE, 3)).astype(np.float32)
    known = replace(BARE, **{part: KNOWN[part]})  # type: ignore[arg-type]
    return simulate_sensor(scene, CfaPattern.bayer(6, origin=(4, 1)), known, 1.0, np.random.default_rng(0))


@pytest.mark.parametrize("part", KNOWN)
def test_files_keep_it(part: str, tmp_path: Path) -> None:
    taken = shot(part)
    write_dng(tmp_path / "shot.dng", taken, np.zeros((10, 10, 3), np.uint8))
    assert read_dng(tmp_path / "shot.dng").calibration == taken.calibration
    (tmp_path / "camera.json").write_text(json.dumps(Camera(replace(taken.calibration, noise=None)).to_json()))
    camera = read_camera(tmp_path / "camera.json")
    assert getattr(camera.calibration, part) == KNOWN[part]
    assert getattr(camera.calibrated(replace(taken, calibration=BARE)).calibration, part) == KNOWN[part]
    assert getattr(Camera(BARE).calibrated(taken).calibration, part) == KNOWN[part]  # what the camera file does not know
