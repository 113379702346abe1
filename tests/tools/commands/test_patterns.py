"""Patterns of one's own from end to end: a scene, a shot, what is in it, its preview, its render,
compared with the truth.
"""

from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from panchroma.shared import CfaPattern, SensorCalibration, read_dng
from panchroma.shared.arrays import FloatArray
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from tests.tools.command import assert_refused, run
from tests.tools.io.files import save

WIDTH, HEIGHT = 181, 121
LEAVES = builtin_scene(WIDTH, HEIGHT)
MEASURED = "--bits 32 --space camera"
FIVE = "VRGWWW/NUGWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW"
BROADBAND = "CMWWWW/YCWWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW"


def bands() -> FloatArray:
    """The leaves in five bands that change from place to place as their colours do."""
    red, green, blue = np.moveaxis(LEAVES.rgb, -1, 0)
    violet, near, ultra = 0.8 * blue + 0.1 * red, 0.6 * red + 0.3 * green, 0.5 * blue + 0.4 * green
    return np.stack([violet, red, green, near, ultra], axis=-1)


def quality(out: Path, stem: str) -> float:
    """PSNR of the render in the camera's channels, dB; 1 is white."""
    truth, render = (tifffile.imread(out / name) for name in (f"{stem}.truth.tif", f"{stem}.tif"))
    assert truth.shape == render.shape
    return float(-10 * np.log10(((truth - render) ** 2).mean()))


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
    assert quality(out, "bands") > 23


def test_broadband_filters_show_the_colours_of_the_scene(out: Path) -> None:
    source, stem = f"builtin:{WIDTH}x{HEIGHT}", f"builtin-{WIDTH}x{HEIGHT}"
    run("simulate", source, "-o", out, f"--pattern {BROADBAND} --truth --light 1", code=0)
    calibration = read_dng(out / f"{stem}.dng").calibration
    assert (calibration.channels, calibration.full_scale) == ("CMY", 1.5)
    run("render", out / f"{stem}.dng", "-o", out, MEASURED, code=0)
    assert quality(out, stem) > 25
    plain = SensorCalibration(camera_to_xyz=LEAVES.camera_to_xyz, neutral=LEAVES.neutral)
    expected = ColourTransform.to_space(plain).apply(LEAVES.rgb)
    run("render", out / f"{stem}.dng", "-o", out, "-f npy --space srgb", code=0)
    shown = np.load(out / f"{stem}.npy")
    assert np.abs(np.median(shown - expected, axis=(0, 1))).max() < 0.02
    assert np.abs(shown.mean(axis=(0, 1)) - expected.mean(axis=(0, 1))).max() < 0.03
