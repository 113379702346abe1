"""What exiftool shows of a source's author, place, time, lens and exposure, the shot and every
result show too.
"""

import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from panchroma.tools.simulation.load import load_scene
from tests.exiftool import exiftool, fields
from tests.tools.command import run
from tests.tools.io.files import noise, png, write_dng

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
WRITTEN = {**KEPT, "Make": "Canon", "Model": "Canon EOS 5D", "Flash": "16", "Orientation": "6"}
ALLOWED = (
    # Files by Google's own library have no packet wrapper: its early versions do not read one.
    "[minor] XMP is missing xpacket wrapper",
    "Missing required TIFF GPS tag 0x001b GPSProcessingMethod",  # nobody knows it
)


def shown(path: Path) -> dict[str, Any]:
    tags = fields(path, "-n", *(f"-EXIF:{name}" for name in KEPT))
    kept = {name: tags[name] for name in KEPT if name in tags}
    return {
        name: round(kept[name], 7) if isinstance(kept[name], float) else kept[name] for name in kept
    }


@pytest.mark.parametrize(
    ("suffix", "kinds"), [(".jpg", "tif png jpg uhdr jxl dng"), (".png", ""), (".tif", "tif")]
)
def test_capture_data_arrive_everywhere(tmp_path: Path, suffix: str, kinds: str) -> None:
    colours = np.random.default_rng(0).integers(20, 200, (6, 8, 3), np.uint8)
    source = tmp_path / f"source{suffix}"
    Image.fromarray(np.kron(colours, np.ones((8, 8, 1), np.uint8))).save(source)
    written = (f"-EXIF:{name}={value}" for name, value in WRITTEN.items())
    exiftool("-q", "-n", "-overwrite_original", *written, source)
    expected = shown(source)
    assert len(expected) == len(KEPT)
    if suffix == ".png":  # as darktable (exiv2), and what has its block from a JPEG, write it
        with Image.open(source) as image:
            exif = image.info["exif"]  # as in a JPEG
        text = f"\nexif\n{len(exif):8}\n{exif.hex()}\n".encode()
        profile = b"Raw profile type exif\0\0" + zlib.compress(text)
        for number, chunk in enumerate(({"zTXt": profile}, {"eXIf": exif})):
            other = png(tmp_path / f"other{number}.png", np.ones((8, 8, 3), np.uint8), **chunk)
            metadata = load_scene(other).metadata
            assert (metadata.iso, metadata.artist, metadata.orientation) == (400, KEPT["Artist"], 6)
    run("simulate", source, "-o", tmp_path, code=0)
    shot = tmp_path / "source.dng"
    assert shown(shot) == expected
    for kind in kinds.split():
        run("render", shot, "-o", tmp_path / kind, f"-f {kind} --preset paper", code=0)
        (result,) = (tmp_path / kind).glob("source.*")
        assert shown(result) == expected, kind
        assert b"EOS 5D" in exiftool("-a", "-Model", result)
        tags = fields(result, "-n", "-G0", "-validate", "-warning", "-EXIF:all")
        assert tags["EXIF:Orientation"] == (6 if kind == "dng" else 1)
        assert tags["EXIF:Software"].startswith("Panchroma")
        # A raw developer would give a DNG the colours of the camera that it names.
        assert tags["EXIF:Make"] == ("Panchroma" if kind == "dng" else "Canon")
        assert tags.get("ExifTool:Warning") in (None, *ALLOWED), kind


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".dng"])
@pytest.mark.parametrize(
    ("written", "lost"),
    [
        (["-XMP:Rating=4", "-XMP:Subject=sea", "-XMP:Subject=stone"], "the rating and keywords"),
        (["-XMP:Rating=2"], "the rating"),
        (["-IPTC:Keywords=sea", "-IPTC:Keywords=stone", "-IPTC:City=Oban"], "the keywords"),
        (["-XMP:Rating=0", "-XMP:Label=Red", "-IPTC:City=Oban"], ""),
    ],
)
def test_what_a_photographer_has_noted_and_is_not_kept_is_told(
    tmp_path: Path, suffix: str, written: list[str], lost: str
) -> None:
    if suffix == ".png" and "IPTC" in str(written):
        pytest.skip("PNG has no place for IPTC's fields")
    path = tmp_path / f"a{suffix}"
    if suffix == ".dng":
        write_dng(path, noise(60, 80))
    else:
        Image.fromarray(noise(60, 80, 3, dtype=np.uint8)).save(path)
    exiftool("-q", "-overwrite_original", *written, path)
    notes = [note for note in load_scene(str(path)).notes if "not kept" in note]
    assert notes == ([f"not kept: {lost} in the file (XMP, IPTC)"] if lost else [])


CAPTION = 'The sea. {"shape": of a wave}'


@pytest.mark.parametrize(
    ("options", "caption"),
    [
        *(({kind: True}, "") for kind in ("shaped", "imagej", "ome")),
        ({"description": CAPTION, "metadata": None}, CAPTION),
    ],
)
def test_what_programs_say_of_arrays_is_no_caption(
    tmp_path: Path, options: Any, caption: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, noise(60, 80, 3, dtype=np.uint8), photometric="rgb", **options)
    with tifffile.TiffFile(path) as file:
        assert file.pages.first.description
    assert load_scene(str(path)).metadata.description == caption
    run("simulate", path, "-o", tmp_path, "--truth", "--burst 2", code=0)
    for truth in tmp_path.glob("*.truth.tif"):
        assert tifffile.imread(truth).ndim == 3
    assert not [record for record in caplog.records if record.name == "tifffile"]
