"""What is measured of a lens, in shots and camera files."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared import Aberration, Camera, CfaPattern, Mosaic, SensorCalibration, Shading, read_camera, read_dng, write_dng
from shared.errors import InputError
from shared.sensor import simulate_sensor
from tests.scenes import darker_corners, displaced_channels

SHAPE = (61, 90)
BARE = SensorCalibration.of_bits(16, gamma=(0.9, 1.1, 0.8))
PATTERN = CfaPattern.bayer(6, origin=(4, 1))
FIGURES: dict[str, tuple[type[Shading] | type[Aberration], dict[str, Any]]] = {
    "shading": (Shading, {"gain": [[[1.0] * 4] * 4] * 4, "size": SHAPE}),
    "aberration": (Aberration, {"radial": [[0, 0]] * 3, "size": SHAPE}),
}
KNOWN = {"shading": darker_corners(SHAPE), "aberration": displaced_channels(SHAPE)}


def shot(part: str) -> Mosaic:
    """A shot of a lens of which this part is known."""
    scene = np.random.default_rng(1).uniform(0.1, 1, (*SHAPE, 3)).astype(np.float32)
    known = replace(BARE, **{part: KNOWN[part]})  # type: ignore[arg-type]
    return simulate_sensor(scene, PATTERN, known, 1.0, np.random.default_rng(0))


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


@pytest.mark.parametrize("part", FIGURES)
def test_it_is_of_one_sensor_and_its_document_is_checked(part: str) -> None:
    kind, figures = FIGURES[part]
    documents: list[Any] = [[], {"size": SHAPE}, {**figures, "more": 1}]
    for wrong in documents:
        with pytest.raises(InputError, match="is not an object with"):
            kind.from_json(wrong)
    for name, value in (("size", (0, 5)), ("size", 5), ("focal_length", "50"), ("focal_length", -1)):
        with pytest.raises(InputError, match=f"{name} is "):
            kind(**{**figures, name: value})
    known = replace(BARE, **{part: kind(**figures)})  # type: ignore[arg-type]
    assert part not in BARE.to_json()
    assert (BARE.lens, known.lens, BARE.id != known.id) == ((), (kind(**figures),), True)
    with pytest.raises(InputError, match="measured on frames of 90 x 61 pixels, and the frame has 90 x 90"):
        Mosaic(np.zeros((90, 90), np.float32), PATTERN, known)
    Mosaic(np.zeros((122, 180), np.float32), PATTERN, known)  # larger pixels of the same sensor
