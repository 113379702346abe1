"""A lens with lateral chromatic aberration, from its simulation to pictures, by the commands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from shared import Mosaic, read_dng, write_dng
from tests.tools.command import run
from tools.camera.lens import lens_aberration

SIZE, SHAPE = "450x300", (300, 450)


def test_a_shot_states_it_and_render_undoes_it(tmp_path: Path) -> None:
    made = run("simulate", f"chart:{SIZE}", "-o", tmp_path, "--aberration=-1,1", "--truth")
    assert made.code == 0, made.err
    path = tmp_path / f"chart-{SIZE}.dng"
    shot = read_dng(path)
    assert shot.calibration.aberration == lens_aberration(-1, 1, 3, SHAPE)
    assert "aberration    R -1.00, G +0.00, B +1.00 pixels in the corners; undone" in run("inspect", path).out
    unknown = Mosaic(shot.codes, shot.pattern, replace(shot.calibration, aberration=None))
    write_dng(tmp_path / "unknown.dng", unknown, np.zeros((20, 30, 3), np.uint8))
    outcome = run("render", path, tmp_path / "unknown.dng", "-o", tmp_path / "out", "--bits", "32", "--space", "camera")
    assert outcome.code == 0, outcome.err
    truth = tifffile.imread(tmp_path / f"chart-{SIZE}.truth.tif")
    undone, left = (
        float(np.square(tifffile.imread(tmp_path / "out" / name) - truth).mean()) for name in (f"chart-{SIZE}.tif", "unknown.tif")
    )
    assert undone < 0.6 * left


@pytest.mark.parametrize(
    ("option", "texts"),
    [("--shading", ("9,0", "1,99", "much", "1,2,3", "-1")), ("--aberration", ("", "1", "much,1", "1,2,3", "21,0", "nan,0"))],
)
def test_impossible_lenses_are_usage(option: str, texts: tuple[str, ...], tmp_path: Path) -> None:
    for text in texts:
        outcome = run("simulate", "flat:60x40", "-o", tmp_path, f"{option}={text}")
        assert (outcome.code, option in outcome.err) == (2, True), text


def test_a_lens_that_is_too_strong_for_a_small_frame_is_refused(tmp_path: Path) -> None:
    outcome = run("simulate", "flat:60x40", "-o", tmp_path, "--aberration", "3,0")
    assert outcome.code == 1
    assert "flat:60x40: --aberration is 3,0: the most in a frame of 60 x 40 pixels is 1.8" in outcome.err
