"""The rendered picture as a DNG, opened with LibRaw as a raw developer opens it.

The rendered DNG in other people's raw developers: their neutral picture is our own sRGB.

They give a file that names a camera the colours of that camera. So a DNG of ours must name none but
ours.
"""

import shutil
import struct
import subprocess
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import rawpy
import tifffile

from panchroma.shared import FloatArray, InputError, read_dng
from panchroma.shared.dng import verify_dng
from panchroma.shared.dng.tags import TAG
from panchroma.shared.tiff import FieldType
from tests.data import photograph
from tests.tools.command import run
from tests.tools.io.examples import picture_dng

# --- linear dng -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(22, 23), (64, 301), (520, 37), (300, 160)])
def test_libraw_reads_the_very_codes_and_black_and_white_beyond_them(
    shape: tuple[int, int],
) -> None:
    rgb = np.random.default_rng(1).random((*shape, 3), np.float32)
    rgb[0, 0], rgb[0, 1] = (0.0, 1.0, 0.5), (-0.5, 2.0, 1e9)
    codes = np.rint(rgb.clip(0, 1) * 65535).astype(np.uint16)
    with rawpy.imread(BytesIO(picture_dng(rgb))) as raw:
        np.testing.assert_array_equal(raw.raw_image[..., :3], codes)
        assert raw.white_level == 65535
        assert raw.sizes.flip == 6  # LibRaw's word for orientation 6


def test_a_picture_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InputError, match="not finite"):
        picture_dng(np.full((4, 4, 3), np.nan, np.float32))


def test_a_changed_shape_of_a_rendered_picture_is_told() -> None:
    data = picture_dng(np.random.default_rng(4).random((8, 12, 3), np.float32))
    assert verify_dng(BytesIO(data)) == (8, 12)
    turned = data
    for name, old, new in (("ImageWidth", 12, 8), ("ImageLength", 8, 12), ("RowsPerStrip", 8, 12)):
        entry = struct.pack("<HHI", TAG[name], FieldType.LONG, 1)
        turned = turned.replace(entry + struct.pack("<I", old), entry + struct.pack("<I", new))
    assert turned != data
    with pytest.raises(InputError, match="damaged"):
        verify_dng(BytesIO(turned))


# --- raw developers -------------------------------------------------------------------------------

PHOTOGRAPHS = ("raw/rose.dng", "raw/g2_chart_detail.crw")
MEAN_LEVELS = 2.0  # of 255: mean difference of what is neither clipped nor toned
SIDE_LEVELS = 1.0  # mean difference of each channel, sign included


def rawtherapee(source: Path, target: Path, home: Path) -> list[str | Path]:
    """Without a profile RawTherapee applies its neutral one."""
    return ["rawtherapee-cli", "-Y", "-o", target, "-b16", "-t", "-c", source]


def darktable(source: Path, target: Path, home: Path) -> list[str | Path]:
    """Without workflow modules, with the white balance of the shot."""
    settings = "darkroom/workflow=none darkroom/chromatic-adaptation=legacy "
    settings += "imageio/format/tiff/bpp=16"
    core = [word for setting in settings.split() for word in ("--conf", f"plugins/{setting}")]
    start: list[str | Path] = ["darktable-cli", source, target, "--icc-type", "SRGB", "--core"]
    return [*start, "--library", ":memory:", "--configdir", home / "darktable", *core]


@pytest.fixture(scope="module", params=PHOTOGRAPHS)
def rendered(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, FloatArray]:
    """A photograph, rendered as a DNG, and as sRGB of 8 bits."""
    scene, folder = photograph(request.param), tmp_path_factory.mktemp("rendered")
    run("simulate", scene, "-o", folder, code=0)
    shot = folder / f"{scene.stem}.dng"
    # A developer has colours of its own for a camera that it knows by name. CRW files keep the name
    # where nobody reads it.
    assert read_dng(shot).metadata.make or scene.suffix == ".crw"
    for kind in ("png", "dng"):
        run("render", shot, "-o", folder / kind, f"-f {kind} --preset paper", code=0)
    ours = imagecodecs.png_decode((folder / "png" / f"{scene.stem}.png").read_bytes())
    return folder / "dng" / shot.name, ours.astype(np.float32)


@pytest.mark.parametrize(
    "developer", [rawtherapee, darktable], ids=lambda developer: developer.__name__
)
def test_a_raw_developer_shows_our_colours(
    tmp_path: Path,
    rendered: tuple[Path, FloatArray],
    developer: Callable[[Path, Path, Path], list[Any]],
) -> None:
    source, ours = rendered
    command = developer(source, tmp_path / "theirs.tif", tmp_path)
    if shutil.which(command[0]) is None:
        pytest.skip(
            f"raw developers: {command[0]} is not installed: apt-get install rawtherapee darktable"
        )
    environment = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, capture_output=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    theirs = tifffile.imread(tmp_path / "theirs.tif")[..., :3] / 257
    assert theirs.shape == ours.shape
    difference = (theirs - ours)[(ours.max(axis=2) < 254)]
    assert np.abs(difference).mean() < MEAN_LEVELS
    assert np.abs(difference.mean(axis=0)).max() < SIDE_LEVELS
