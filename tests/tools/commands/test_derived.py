"""Mosaics of cars, RCCB, RCCG and RCCC, from end to end: found, captured, calibrated, rendered."""

import json
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import tifffile

from panchroma.shared import read_camera, read_dng
from tests.data import photograph
from tests.tools.command import run

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
    said = run("render", shot, "-o", tmp_path, "-f", "png", code=0)
    assert (tmp_path / f"{shot.stem}.png").exists()
    assert ("shows R against C" in said.err) == (name == "rccc")


def test_channels_are_named_by_an_option(out: Path) -> None:
    scene = ("simulate", "builtin:120x90", "-o", out, "--overwrite", "--pattern", "RW/WB")
    run(*scene, "--channels", "RB", code=0)
    assert read_dng(out / "builtin-120x90.dng").pattern.derived is None
    assert "letters 'RB'" in run(*scene, "--channels", "RGC", code=2).err
    run(*scene, "--channels", "BGR", code=0)
    assert read_dng(out / "builtin-120x90.dng").pattern.channels == "BGR"
    said = run("inspect", out / "builtin-120x90.dng", code=0).out
    assert "G is what W sees beyond the others" in said


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


def test_a_photograph_keeps_its_green(out: Path) -> None:
    """As good as with filters of all three: within what a sixth of the samples less costs."""
    scene = photograph("kodak/kodim23.png")
    run("simulate", scene, "-o", out, "--pattern", "rccb", "--truth", "--sigma", "0.01", code=0)
    run("render", out / "kodim23.dng", "-o", out, "--bits", "32", "--space", "camera", code=0)
    truth, render = (tifffile.imread(out / name) for name in ("kodim23.truth.tif", "kodim23.tif"))
    error = np.square(truth - render).mean(axis=(0, 1))
    assert (-10 * np.log10(error)).min() > 33


def test_a_sensor_with_one_kind_of_filter_needs_no_chart(out: Path, tmp_path: Path) -> None:
    frames = ("chart:300x200", "dark:300x200")
    run("simulate", *frames, "-o", out, "--pattern", "rccc", "--light", "0.8", code=0)
    dark = ("--dark", out / "dark-300x200.dng", "-o", tmp_path / "camera.json")
    said = run("calibrate", out / "chart-300x200.dng", *dark, code=1).err
    assert "the channels RC cannot tell the colours of a chart apart" in said
    said = run("calibrate", *dark, code=0).err
    assert "gamma: not measured" in said
    assert "ColorChecker" not in said
