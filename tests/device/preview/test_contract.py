"""The example of another runtime on the page of the preview: it is run as it stands there."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panchroma.device import Preview
from panchroma.device.preview.graph import build_preview
from panchroma.shared import Camera, CfaPattern, Mosaic, NoiseModel, SensorCalibration, Shading
from panchroma.shared.colorimetry import SRGB_TO_XYZ
from panchroma.shared.shading import basis
from tests.data import ROOT
from tests.python import run_python


@pytest.mark.parametrize(
    ("pattern", "scale"),
    [
        (CfaPattern.bayer(6, "GRBG", origin=(0, 5)), 1),
        (CfaPattern.bayer(6, origin=(4, 1)), 2),
        (CfaPattern.bayer(6, "BGGR", origin=(3, 2)), 3),
        (CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2)), 2),
    ],
)
@pytest.mark.parametrize(
    ("shape", "points"),
    [((61, 83), None), ((61, 83), (9, 5)), ((60, 84), (4, 6)), ((17, 100), (5, 13))],
)
def test_the_example_gives_the_bytes_of_the_preview(
    tmp_path: Path,
    pattern: CfaPattern,
    scale: int,
    shape: tuple[int, int],
    points: tuple[int, int] | None,
) -> None:
    """Without shading, or with that of a lens in any number of control points."""
    calibration = SensorCalibration.of_bits(
        12,
        gamma=(0.9, 1.1, 0.8),
        noise=NoiseModel((2e-4,) * 4, (3e-3,) * 4),
        black_level=(250.0, 251.0, 255.5, 260.0),
        camera_to_xyz=tuple(tuple(0.8 * value + 0.03 for value in row) for row in SRGB_TO_XYZ),
        neutral=(0.5, 1.2, 0.7),
    )
    if points:
        falls = np.add.outer(*(np.linspace(-1, 0.8, number) ** 2 for number in points))
        gains = 1 + np.array([0.5, 0.4, 0.3, 0.4])[:, None, None] * falls
        down, across = (
            basis(side, number, np.array([(side - 1) / 2]))
            for side, number in zip(shape, points, strict=True)
        )
        gains /= down @ gains @ across.T
        calibration = replace(calibration, shading=Shading(gains.tolist(), shape))
    codes = np.random.default_rng(scale).integers(200, 4096, shape).astype(np.uint16)
    mosaic = Mosaic(codes, pattern, calibration)
    (tmp_path / "preview.onnx").write_bytes(build_preview(pattern, scale))
    (tmp_path / "camera.json").write_text(json.dumps(Camera(calibration, pattern).to_json()))
    np.save(tmp_path / "codes.npy", codes)
    page = (ROOT / "device" / "preview" / "README.md").read_text("utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    run_python(example + 'np.save("picture.npy", picture)', folder=tmp_path)
    picture = np.load(tmp_path / "picture.npy")
    expected = Preview(pattern, scale, threads=1).run(mosaic)
    assert (picture.dtype, picture.shape) == (np.uint8, (shape[0] // scale, shape[1] // scale, 3))
    assert np.array_equal(picture, expected)
