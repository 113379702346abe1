"""Patterns of one's own from end to end: a scene, a shot, what is in it, its preview, its render,
compared with the truth.

Mosaics of cars, RCCB, RCCG and RCCC, from end to end: found, captured, calibrated, rendered.
"""

import json
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import tifffile
from PIL import Image

from panchroma.shared import CfaPattern, FloatArray, read_camera, read_dng
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from tests.tools.command import assert_refused, run
from tests.tools.io.files import save

# --- patterns -------------------------------------------------------------------------------------

WIDTH, HEIGHT = 181, 121
LEAVES = builtin_scene(WIDTH, HEIGHT)
MEASURED = "--bits 32 --space camera"
FIVE = "VRGWWW/NUGWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW"


def bands() -> FloatArray:
    """The leaves in five bands that change from place to place as their colours do."""
    red, green, blue = np.moveaxis(LEAVES.rgb, -1, 0)
    violet, near, ultra = 0.8 * blue + 0.1 * red, 0.6 * red + 0.3 * green, 0.5 * blue + 0.4 * green
    return np.stack([violet, red, green, near, ultra], axis=-1)


def test_five_bands(out: Path, tmp_path: Path) -> None:
    scene, shot = save(tmp_path / "bands.npy", bands()), out / "bands.dng"
    camera = f"--pattern {FIVE} --origin 2,1 --truth --sigma 0.01 --sensor-bits 14"
    run("simulate", scene, "-o", out, camera, code=0)
    assert np.array_equal(tifffile.imread(out / "bands.truth.tif"), bands())
    assert read_dng(shot).pattern == CfaPattern.of_letters(FIVE, (2, 1))
    shown = run("inspect", shot).out
    assert "gamma         1  (VRGNU)" in shown
    # 30 pixels see all of it, and 6 a fifth
    assert "2.60 times that of a Bayer sensor" in shown
    run("preview", shot, "-o", tmp_path, code=0)
    with Image.open(tmp_path / "bands.jpg") as grey:
        assert np.ptp(np.asarray(grey, int), axis=2).max() <= 2  # nobody knows its colours
    words = "no colour matrix for the channels VRGNU", "--space camera, as tif, exr or npy"
    assert_refused(run("render", shot, "-o", out), *words, name=str(shot))
    refused = run("render", shot, "-f dng -o", tmp_path)
    assert_refused(refused, "has VRGNU; use tif, exr or npy", name=str(shot))
    (record,) = run("render", shot, "-o", out, MEASURED, "--json", code=0).records
    assert record["learned"] is None
    truth, render = (tifffile.imread(out / name) for name in ("bands.truth.tif", "bands.tif"))
    assert truth.shape == render.shape
    assert -10 * np.log10(((truth - render) ** 2).mean()) > 23  # dB; 1 is white


# --- derived --------------------------------------------------------------------------------------

SIZE = ("--size", "320x240", "--pixel-format", "u16")


@pytest.mark.parametrize("name", ["rccb", "rccg", "rccc"])
def test_a_frame_without_a_header_becomes_a_picture(name: str, out: Path, tmp_path: Path) -> None:
    scene = "builtin:320x240"
    run("simulate", scene, "-o", out, "--pattern", name, "-f", "raw", "--light", "1", code=0)
    (raw,) = out.glob("*.raw")
    shots = tmp_path / "shots"
    camera = ("--pattern", name, "--sensor-bits", "12")
    with raw.open("rb") as stream, patch("sys.stdin", stream):
        run("capture", "-", *SIZE, *camera, "-o", shots, code=0)
    (shot,) = shots.glob("*.dng")
    assert read_dng(shot).pattern.derived is not None
    assert "is what W sees beyond the others" in run("inspect", shot, code=0).out
    said = run("render", shot, "-o", tmp_path, "-f", "png", code=0)
    assert (tmp_path / f"{shot.stem}.png").exists()
    assert ("shows R against C" in said.err) == (name == "rccc")


@pytest.mark.parametrize("tile", ["rccb", "RB/WW"])
def test_gamma_comes_from_a_chart(tile: str, out: Path, tmp_path: Path) -> None:
    """That of the missing channel is the mean of the others: its unit is free."""
    known = tmp_path / "known.json"
    levels = {"white_level": 4095, "black_level": [256] * 4}
    known.write_text(json.dumps({"schema": 1, "gamma": [0.9, 1.2, 0.7], **levels}))
    frames = ("chart:900x600", "dark:900x600")
    run("simulate", *frames, "-o", out, f"--pattern {tile} --light 0.8 --camera", known, code=0)
    chart, dark = (next(out.glob(f"{kind}*.dng")) for kind in ("chart", "dark"))
    camera = tmp_path / "camera.json"
    run("calibrate", chart, "--dark", dark, "-o", camera, code=0)
    found = read_camera(camera)
    assert found.calibration.gamma == pytest.approx((0.9, 0.8, 0.7), rel=0.03)
    assert found.pattern.derived == 1
    assert found.calibration.camera_to_xyz is not None


def test_a_sensor_with_one_kind_of_filter_needs_no_chart(out: Path, tmp_path: Path) -> None:
    frames = ("chart:300x200", "dark:300x200")
    run("simulate", *frames, "-o", out, "--pattern", "rccc", "--light", "0.8", code=0)
    dark = ("--dark", out / "dark-300x200.dng", "-o", tmp_path / "camera.json")
    said = run("calibrate", out / "chart-300x200.dng", *dark, code=1).err
    assert "the channels RC cannot tell the colours of a chart apart" in said
    said = run("calibrate", *dark, code=0).err
    assert "gamma: not measured" in said
    assert "ColorChecker" not in said
