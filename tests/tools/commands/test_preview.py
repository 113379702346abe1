"""`panchroma preview`: the command gives what the camera gives, and the graph that gives it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from panchroma.device import Preview
from panchroma.device.preview.graph import build_preview
from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import ByteArray
from panchroma.shared.dng import read_dng
from panchroma.tools.batch.journal import NAME as JOURNAL
from tests.tools.batch.examples import save_mosaic
from tests.tools.command import assert_refused, contents, run

JPEG_LOSS = 2.0
"""Codes of mean difference that JPEG at quality 95 may make on these pictures."""
ORIENTATION = 274
SHIFTED = CfaPattern.bayer(6, "GRBG", (1, 4))


def shot(path: Path, pattern: CfaPattern = SHIFTED, **metadata: Any) -> Path:
    """A soft picture, so that JPEG takes little from it; its own preview is black."""
    rows, columns = np.ogrid[:61, :95]
    codes = (1400 + 800 * np.sin(rows / 11) + 600 * np.cos(columns / 17)).astype(np.uint16)
    calibration = SensorCalibration(black_level=(256.0,) * 4, white_level=3840, neutral=None)
    return save_mosaic(path, Mosaic(codes, pattern, calibration, CaptureMetadata(**metadata)))


def picture(path: Path, scale: int = 1, **changes: Any) -> ByteArray:
    mosaic = replace(read_dng(path), **changes)
    return np.asarray(Preview.for_mosaic(mosaic, scale).run(mosaic), np.uint8)


def distance(jpeg: Path, expected: ByteArray) -> float:
    """Mean difference of the picture in a file."""
    with Image.open(jpeg) as image:
        pixels = np.asarray(image.convert("RGB"), float)
    assert pixels.shape == expected.shape
    return float(np.abs(pixels - expected).mean())


@pytest.mark.parametrize("scale", [1, 2, 3])
def test_it_is_the_preview_of_the_shot(tmp_path: Path, scale: int) -> None:
    source, made = shot(tmp_path / "shot.dng"), tmp_path / "shot.jpg"
    outcome = run("preview", source, "-o", tmp_path, f"--scale {scale}", code=0)
    expected = picture(source, scale)
    assert distance(made, expected) < JPEG_LOSS < distance(made, expected[::-1])
    assert outcome.out == f"{made}: {95 // scale} x {61 // scale}\n"


def test_it_lies_as_the_samples_do_and_says_which_way_is_up(tmp_path: Path) -> None:
    source = shot(tmp_path / "shot.dng", orientation=6, make="Acme")
    run("preview", source, "-o", tmp_path, "--quality 20", code=0)
    small = (tmp_path / "shot.jpg").stat().st_size
    run("preview", source, "-o", tmp_path, "--quality 100 --overwrite", code=0)
    assert (tmp_path / "shot.jpg").stat().st_size > 2 * small
    with Image.open(tmp_path / "shot.jpg") as image:
        exif = image.getexif()
        assert (image.size, exif[ORIENTATION], exif[271]) == ((95, 61), 6, "Acme")
        assert exif.get_ifd(34665)[40961] == 1  # sRGB


def test_many_shots_of_several_patterns_and_one_that_is_none(tmp_path: Path) -> None:
    sources = [tmp_path / f"{name}.dng" for name in ("a", "text", "b", "c")]
    for source, pattern in zip(
        sources, (SHIFTED, SHIFTED, CfaPattern.bayer(5), SHIFTED), strict=True
    ):
        shot(source, pattern)
    sources[1].write_text("no shot")
    outcome = run("preview", *sources, "-o", tmp_path, "--json")
    assert_refused(outcome, "not a DNG", name=str(tmp_path / "text.dng"))
    assert [record["ok"] for record in outcome.records] == [True, False, True, True]
    files = {"source": str(sources[0]), "ok": True, "output": str(tmp_path / "a.jpg")}
    assert outcome.records[0] == files | {"width": 95, "height": 61}
    assert (tmp_path / "a.jpg").read_bytes() == (tmp_path / "c.jpg").read_bytes()
    assert distance(tmp_path / "b.jpg", picture(sources[2])) < JPEG_LOSS


@pytest.mark.parametrize("scale", [1, 3])
def test_the_graph_is_that_of_the_shot_s_pattern(tmp_path: Path, scale: int) -> None:
    source = shot(tmp_path / "shot.dng", CfaPattern.bayer(6, "GBRG", (2, 3)))
    path = tmp_path / "g.onnx"
    run("preview", source, "--export", path, "-n", code=0)
    assert not path.exists()
    outcome = run("preview", source, "--export", path, f"--scale {scale}", code=0)
    assert path.read_bytes() == build_preview(CfaPattern.bayer(6, "GBRG"), scale)
    assert outcome.out == f"{path}: {path.stat().st_size} bytes\n"
    assert not (tmp_path / "shot.jpg").exists()


def test_previews_are_resumed_unless_shot_or_options_have_changed(
    tmp_path: Path, out: Path
) -> None:
    shots = [shot(tmp_path / f"{number}.dng", iso=number) for number in (1, 2, 3)]
    run("preview", *shots, "-j 2 -o", out, code=0)
    made = contents(out)
    shot(shots[0], iso=4)
    assert run("preview", *shots, "--resume -o", out, code=0).out.count("is up to date") == 2
    changed = {name for name, data in contents(out).items() if data != made[name]}
    assert changed == {"1.jpg", JOURNAL}
    for options in ("--quality 50", "--scale 2"):
        assert "is up to date" not in run("preview", *shots, options, "--resume -o", out).out
