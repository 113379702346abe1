"""The rendered DNG in other people's raw developers: their neutral picture is our own sRGB.

They give a file that names a camera the colours of that camera. So a DNG of ours must name none but ours.
"""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile

from shared import read_dng
from tests.data import photograph
from tests.tools.command import run

PHOTOGRAPHS = ("raw/rose.dng", "raw/outdoor4.dng", "raw/g2_chart_detail.crw")
MEAN_LEVELS = 2.0  # of 255: mean difference of what is neither clipped nor toned
SIDE_LEVELS = 1.0  # mean difference of each channel, sign included


def rawtherapee(source: Path, target: Path, home: Path) -> list[str | Path]:
    """Without a profile RawTherapee applies its neutral one."""
    return ["rawtherapee-cli", "-Y", "-o", target, "-b16", "-t", "-c", source]


def darktable(source: Path, target: Path, home: Path) -> list[str | Path]:
    """Without workflow modules, with the white balance of the shot."""
    settings = (
        "plugins/darkroom/workflow=none",
        "plugins/darkroom/chromatic-adaptation=legacy",
        "plugins/imageio/format/tiff/bpp=16",
    )
    configuration = [word for setting in settings for word in ("--conf", setting)]
    core: list[str | Path] = ["--core", "--library", ":memory:", "--configdir", home / "darktable", *configuration]
    return ["darktable-cli", source, target, "--icc-type", "SRGB", *core]


@pytest.mark.parametrize("developer", [rawtherapee, darktable], ids=lambda developer: developer.__name__)
@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_a_raw_developer_shows_our_colours(tmp_path: Path, name: str, developer: Callable[[Path, Path, Path], list[Any]]) -> None:
    scene = photograph(name)
    program = developer(scene, tmp_path, tmp_path)[0]
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    (tmp_path / "out").mkdir()
    assert run("simulate", scene, "-o", tmp_path / "out").code == 0
    shot = tmp_path / "out" / f"{scene.stem}.dng"
    # A developer has colours of its own for a camera that it knows by name. CRW files keep the name where nobody reads it.
    assert read_dng(shot).metadata.make or scene.suffix == ".crw"
    for kind in ("png", "dng"):
        assert run("render", shot, "-o", tmp_path / kind, "-f", kind, "--preset", "paper").code == 0
    command = developer(tmp_path / "dng" / shot.name, tmp_path / "theirs.tif", tmp_path)
    done = subprocess.run(command, capture_output=True, check=False, env={"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"})
    assert done.returncode == 0, done.stderr
    theirs = tifffile.imread(tmp_path / "theirs.tif")[..., :3] / 257
    ours = imagecodecs.png_decode((tmp_path / "png" / f"{scene.stem}.png").read_bytes()).astype(float)
    assert theirs.shape == ours.shape
    difference = (theirs - ours)[(ours.max(axis=2) < 254)]
    assert np.abs(difference).mean() < MEAN_LEVELS
    assert np.abs(difference.mean(axis=0)).max() < SIDE_LEVELS
