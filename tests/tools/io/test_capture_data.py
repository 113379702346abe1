"""What exiftool shows of a source's author, place, time, lens and exposure, the shot and every
result show too.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.exiftool import exiftool, fields
from tests.tools.command import run

KEPT = {
    "Artist": "Jürgen Müller",
    "Copyright": "© 2024 Jürgen",
    "GPSLatitude": "33.856944",
    "GPSLatitudeRef": "S",
    "GPSLongitude": "151.2111",
    "GPSLongitudeRef": "E",
    "GPSAltitude": "25.5",
    "GPSAltitudeRef": "1",
    "LensModel": "Käthe 35",
    "FocalLength": "35",
    "DateTimeOriginal": "2024:05:06 07:08:09",
    "OffsetTimeOriginal": "+02:00",
    "SubSecTimeOriginal": "125",
    "ImageDescription": "a description",
    "ExposureTime": "1/250",
    "FNumber": "2.8",
    "ISO": "400",
}
"""Fields of Exif. exiftool also computes values from these, and shows what depends on the
pixels.
"""
WRITTEN = {**KEPT, "Make": "Canon", "Model": "Canon EOS 5D", "Flash": "16"}


def shown(path: Path) -> dict[str, Any]:
    tags = fields(path, "-n", *(f"-EXIF:{name}" for name in KEPT))
    kept = {name: tags[name] for name in KEPT if name in tags}
    return {
        name: round(kept[name], 7) if isinstance(kept[name], float) else kept[name] for name in kept
    }


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_capture_data_arrive_everywhere(tmp_path: Path, suffix: str) -> None:
    colours = np.random.default_rng(0).integers(20, 200, (6, 8, 3), np.uint8)
    (tmp_path / "in").mkdir()
    source = tmp_path / "in" / f"source{suffix}"
    Image.fromarray(np.kron(colours, np.ones((8, 8, 1), np.uint8))).save(source)
    written = (f"-EXIF:{name}={value}" for name, value in WRITTEN.items())
    exiftool("-q", "-n", "-overwrite_original", *written, source)
    expected = shown(source)
    assert len(expected) == len(KEPT)
    run("simulate", source, "-o", tmp_path / "out", code=0)
    shot = tmp_path / "out" / "source.dng"
    assert shown(shot) == expected
    # from the same shot
    for kind in ("tif", "jpg", "png", "dng") if suffix == ".jpg" else ("tif",):
        run("render", shot, "-o", tmp_path, f"-f {kind} --preset paper --overwrite", code=0)
        result = tmp_path / f"source.{kind}"
        assert shown(result) == expected, kind
        assert b"EOS 5D" in exiftool("-a", "-Model", result)
