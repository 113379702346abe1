import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from device import Preview
from shared import Camera, CaptureMetadata, CfaPattern, Mosaic, SensorCalibration, read_dng, write_dng
from shared.arrays import ByteArray
from tests.python import run_python
from tests.tools.command import assert_refused, run

JPEG_LOSS = 2.0
"""Codes of mean difference that JPEG at quality 95 may make on these pictures."""
ORIENTATION = 274


def shot(folder: Path, name: str = "shot.dng", pattern: CfaPattern | None = None, **metadata: object) -> Path:
    """A soft picture, so that JPEG takes little from it; its own preview is black."""
    pattern = pattern or CfaPattern.bayer(6, "GRBG", (1, 4))
    rows, columns = np.ogrid[:61, :95]
    codes = (1400 + 800 * np.sin(rows / 11) + 600 * np.cos(columns / 17)).astype(np.uint16)
    calibration = SensorCalibration(
        channels=pattern.channels, black_level=(256.0,) * (len(pattern.channels) + 1), white_level=3840, neutral=None
    )
    mosaic = Mosaic(codes, pattern, calibration, CaptureMetadata(**metadata))  # type: ignore[arg-type]
    write_dng(folder / name, mosaic, np.zeros((61, 95, 3), np.uint8))
    return folder / name


def picture(path: Path, scale: int = 1) -> ByteArray:
    mosaic = read_dng(path)
    return np.asarray(Preview.for_mosaic(mosaic, scale).run(mosaic), np.uint8)


def decoded(jpeg: Path | bytes) -> ByteArray:
    return np.asarray(Image.open(BytesIO(jpeg) if isinstance(jpeg, bytes) else jpeg).convert("RGB"))


def distance(first: ByteArray, second: ByteArray) -> float:
    assert first.shape == second.shape
    return float(np.abs(first.astype(float) - second).mean())


@pytest.mark.parametrize("scale", [1, 2, 3])
def test_it_is_the_preview_of_the_shot(tmp_path: Path, scale: int) -> None:
    source = shot(tmp_path)
    outcome = run("preview", source, "-o", tmp_path, "--scale", str(scale), code=0)
    assert (
        distance(decoded(tmp_path / "shot.jpg"), picture(source, scale))
        < JPEG_LOSS
        < distance(picture(source)[::-1], picture(source))
    )
    assert outcome.out.startswith(f"{tmp_path / 'shot.jpg'}: {95 // scale} x {61 // scale}, ")


def test_it_lies_as_the_samples_do_and_says_which_way_is_up(tmp_path: Path) -> None:
    source = shot(tmp_path, orientation=6, make="Acme")
    run("preview", source, "-o", tmp_path, code=0)
    with Image.open(tmp_path / "shot.jpg") as image:
        assert image.size == (95, 61)
        exif = image.getexif()
        assert exif[ORIENTATION] == 6
        assert exif[271] == "Acme"
        assert exif.get_ifd(34665)[40961] == 1  # sRGB


def test_many_shots_of_several_patterns_and_one_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "text.dng").write_text("no shot")
    sources = [
        shot(tmp_path, "a.dng"),
        tmp_path / "text.dng",
        shot(tmp_path, "b.dng", CfaPattern.bayer(5)),
        shot(tmp_path, "c.dng"),
    ]
    outcome = run("preview", *sources, "-o", tmp_path, "--json")
    assert_refused(outcome, "not a DNG", name=str(tmp_path / "text.dng"))
    assert [record["ok"] for record in outcome.records] == [True, False, True, True]
    assert outcome.records[0] | {"preview_ms": 0} == {
        "source": str(sources[0]),
        "ok": True,
        "output": str(tmp_path / "a.jpg"),
        "width": 95,
        "height": 61,
        "preview_ms": 0,
    }
    assert (tmp_path / "a.jpg").read_bytes() == (tmp_path / "c.jpg").read_bytes()
    assert distance(decoded(tmp_path / "b.jpg"), picture(sources[2])) < JPEG_LOSS


def test_quality_is_that_of_the_jpeg(tmp_path: Path) -> None:
    source, made = shot(tmp_path), [tmp_path / quality for quality in ("20", "100")]
    assert [run("preview", source, "-o", folder, "--quality", folder.name).code for folder in made] == [0, 0]
    assert len({(folder / "shot.jpg").stat().st_size // 1000 for folder in made}) == 2


def test_a_camera_file_takes_the_place_of_the_shot_s_calibration(tmp_path: Path) -> None:
    source, file = shot(tmp_path), tmp_path / "camera.json"
    own = read_dng(source)
    camera = replace(own.calibration, black_level=(900.0,) * 4)
    file.write_text(json.dumps(Camera(camera).to_json()))
    run("preview", source, "-o", tmp_path, "--camera", file, code=0)
    mosaic = replace(own, calibration=camera)
    expected = np.asarray(Preview.for_mosaic(mosaic).run(mosaic), np.uint8)
    assert distance(decoded(tmp_path / "shot.jpg"), expected) < JPEG_LOSS < distance(expected, picture(source))


def test_help_does_not_wait_for_onnxruntime() -> None:
    script = (
        "import sys\nfrom tools.cli import main\n"
        "try:\n    main(['preview', '--help'])\nexcept SystemExit:\n    print('onnxruntime' in sys.modules)"
    )
    assert run_python(script).splitlines()[-1] == "False"
