"""What exiftool shows of a source's author, place, time, lens and exposure, the shot and every result show too."""

import json
import shutil
import struct
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from shared import CaptureMetadata
from tests.data import photograph
from tests.exiftool import exiftool
from tests.tools.command import run
from tools.scenes.ciff import crw_metadata
from tools.scenes.load import load_scene

WRITTEN = (
    *("-Artist=Jürgen Müller", "-Copyright=© 2024 Jürgen", "-EXIF:Make=Canon", "-EXIF:Model=Canon EOS 5D", "-OwnerName=Jü"),
    *("-EXIF:GPSLatitude=33.856944", "-EXIF:GPSLatitudeRef=S", "-EXIF:GPSLongitude=151.2111", "-EXIF:GPSLongitudeRef=E"),
    *("-EXIF:GPSAltitude=25.5", "-EXIF:GPSAltitudeRef#=1", "-EXIF:GPSDateStamp=2024:05:06", "-EXIF:GPSTimeStamp=05:06:07.5"),
    *("-EXIF:GPSImgDirection=123.4", "-EXIF:GPSImgDirectionRef=T", "-EXIF:GPSProcessingMethod=GPS", "-EXIF:GPSMapDatum=WGS-84"),
    *("-EXIF:LensModel=Käthe 35", "-EXIF:LensMake=Acme", "-LensSerialNumber=123", "-LensInfo=24 70 2.8 4", "-FocalLength=35"),
    *("-DateTimeOriginal=2024:05:06 07:08:09", "-CreateDate=2024:05:06 07:08:10", "-ModifyDate=2024:06:06 07:08:10"),
    *("-OffsetTime=+02:00", "-OffsetTimeOriginal=+02:00", "-SubSecTimeOriginal=120", "-SubSecTime=5", "-ExposureTime=1/250"),
    *("-FNumber=2.8", "-ISO=400", "-ExposureProgram#=2", "-ExposureCompensation=-1/3", "-MeteringMode#=5", "-Flash#=16"),
)
# EXIF alone: exiftool also computes values from these, and shows what depends on the pixels.
SHOWN = (
    *("-EXIF:Artist", "-EXIF:Copyright", "-EXIF:OwnerName", "-GPS:all", "-EXIF:Lens*", "-EXIF:*Date*", "-EXIF:OffsetTime*"),
    *("-EXIF:SubSec*", "-EXIF:Exposure*", "-EXIF:FNumber", "-EXIF:ISO", "-EXIF:FocalLength", "-EXIF:MeteringMode", "-EXIF:Flash"),
)


def shown(path: Path) -> dict[str, Any]:
    (found,) = json.loads(exiftool("-j", "-n", *SHOWN, path))
    return {name: value for name, value in found.items() if name != "SourceFile"}


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp"])
def test_capture_data_arrive_everywhere(tmp_path: Path, suffix: str) -> None:
    colours = np.random.default_rng(0).integers(20, 200, (6, 8, 3), np.uint8)
    source = tmp_path / f"source{suffix}"
    Image.fromarray(np.kron(colours, np.ones((8, 8, 1), np.uint8))).save(source)
    exiftool("-q", "-overwrite_original", *WRITTEN, source)
    expected = shown(source)
    assert len(expected) > 30
    (tmp_path / "out").mkdir()
    assert run("simulate", source, "-o", tmp_path / "out").code == 0
    shot = tmp_path / "out" / "source.dng"
    assert shown(shot) == expected
    (facts,) = run("inspect", "--json", shot).records
    assert (facts["metadata"]["make"], facts["metadata"]["model"]) == ("Canon", "Canon EOS 5D")
    for kind in ("tif", "jpg", "png", "dng"):
        assert run("render", shot, "-o", tmp_path / kind, "-f", kind, "--preset", "paper").code == 0
        result = tmp_path / kind / f"source.{kind}"
        assert shown(result) == expected, kind
        assert exiftool("-s3", "-validate", "-warning", "-a", result).decode().strip() == "OK"
        assert b"EOS 5D" in exiftool("-a", "-Model", result)


@pytest.mark.parametrize("name", ["s40_pantone.crw", "g2_chart_detail.crw"])
def test_a_crw_says_what_exiftool_reads_in_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "America/New_York")
    source = photograph(f"raw/{name}")
    tags = ("-Make", "-Model", "-DateTimeOriginal", "-FNumber", "-ExposureTime", "-ISO", "-FocalLength", "-MinFocalLength")
    (found,) = json.loads(exiftool("-j", "-n", *tags, source))
    metadata = load_scene(str(source)).metadata
    assert (metadata.make, metadata.model) == (found["Make"], found["Model"])
    assert metadata.taken == datetime.strptime(found["DateTimeOriginal"], "%Y:%m:%d %H:%M:%S")  # noqa: DTZ007
    assert metadata.f_number == pytest.approx(found["FNumber"])
    assert metadata.exposure_time == pytest.approx(found["ExposureTime"])
    assert metadata.iso == found["ISO"]
    assert metadata.focal_length == pytest.approx(found["FocalLength"])
    assert metadata.lens.startswith(f"{found['MinFocalLength']:.1f} - ")


def heap(entries: list[tuple[int, bytes]]) -> bytes:
    """A CIFF directory of records."""
    data, table = b"", struct.pack("<H", len(entries))
    for tag, record in entries:
        table += struct.pack("<HII", tag, len(record), len(data))
        data += record
    return data + table + struct.pack("<I", len(data))


def crw(entries: list[tuple[int, bytes]]) -> bytes:
    return struct.pack("<2sI8s", b"II", 14, b"HEAPCCDR") + heap(entries)


def test_a_made_up_crw(tmp_path: Path) -> None:
    shot = [0] * 30
    shot[21], shot[22] = 96, 5 * 32 + 20  # 3 stops; 5 2/3 stops
    records = [(0x080A, b"Canon\0Canon EOS D30\0\0"), (0x0810, b"J\xfcrgen\0"), (0x102A, struct.pack("<30h", *shot))]
    path = tmp_path / "a.crw"
    data = crw([(0x300A, heap([(0x2807, heap(records))])), (0x180E, struct.pack("<3I", 86400 * 365, 0, 0))])
    path.write_bytes(data)
    found = crw_metadata(path)
    assert (found.make, found.model, found.artist) == ("Canon", "Canon EOS D30", "Jürgen")
    assert found.f_number == pytest.approx(2**1.5)
    assert found.exposure_time == pytest.approx(2 ** -(5 + 2 / 3))
    assert found.taken == datetime(1971, 1, 1)  # noqa: DTZ001
    random = np.random.default_rng(1)
    for _ in range(300):
        broken = bytearray(data[: random.integers(1, len(data) + 1)])
        broken[random.integers(len(broken))] ^= 1 << int(random.integers(8))
        path.write_bytes(broken)
        crw_metadata(path)
    itself = struct.pack("<HHII", 1, 0x300A, 12, 0) + struct.pack("<I", 0)  # a directory that contains itself
    path.write_bytes(struct.pack("<2sI8s", b"II", 14, b"HEAPCCDR") + itself)
    assert crw_metadata(path) == CaptureMetadata()
    shutil.copy(__file__, path)
    assert crw_metadata(path) == CaptureMetadata()
