"""Our files in other people's hands: what they read is what we wrote, and what they edit we can
still read.
"""

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import rawpy
from PIL import Image
from tifffile import DATATYPE, TiffFile

from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.dng import encode_dng, read_dng, read_preview, write_dng
from panchroma.shared.lights import CalibratedLight
from tests.exiftool import exiftool
from tests.shared.dng.examples import METADATA, calibration, mosaic, preview, same

LIGHTS = (
    CalibratedLight("A", ((0.7, 0.2, 0.1), (0.2, 0.9, -0.1), (0.0, -0.3, 2.1)), (1.0, 0.9, 0.5)),
    CalibratedLight("D65", ((1.2, 0.2, 0.1), (0.4, 0.9, -0.2), (0.0, -0.2, 1.1)), (0.6, 0.9, 1.0)),
)
YELLOW = CfaPattern.of_letters("WYWC/YWCW/WCWM/CWMW", (1, 0))
CASES = [
    mosaic(CfaPattern.bayer(3, "BGGR", (1, 2))),
    mosaic(CfaPattern.bayer(6), (41, 67), calibration(bits=10)),
    mosaic(CfaPattern.bayer(8, "GBRG"), (33, 31), calibration(bits=16)),
    mosaic(CfaPattern.bayer(16), (33, 50), calibration(black_level=(256.0,) * 4)),
    mosaic(CfaPattern.with_block(("ABC", "DEA"), 7, (3, 2))),
    mosaic(CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (3, 2)), (45, 33)),
    mosaic(CfaPattern.bayer(6), (40, 52), calibration(camera_to_xyz=None, lights=LIGHTS)),
    mosaic(YELLOW, (33, 40), calibration("YCM", camera_to_xyz=None)),
    mosaic(CfaPattern.with_block(("RW", "WB"), 5)),
    mosaic(CfaPattern.with_block(("ABCD", "EFGH"), 5, (2, 2)), (50, 61)),
]


@pytest.mark.parametrize("original", CASES)
def test_tifffile_and_libraw_read_the_very_samples(original: Mosaic) -> None:
    data = encode_dng(original, preview())
    with TiffFile(BytesIO(data)) as file:
        assert file.pages.first.tags["SubIFDs"].dtype == DATATYPE.LONG  # older ones know no IFD
        np.testing.assert_array_equal(file.pages.first.pages[0].asarray(), original.codes)
    with rawpy.imread(BytesIO(data)) as raw:
        np.testing.assert_array_equal(raw.raw_image, original.codes)


def test_every_viewer_shows_the_preview(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(metadata=replace(METADATA, orientation=1)), preview())
    shown = imagecodecs.jpeg8_decode(read_preview(path))
    assert np.abs(shown.astype(int) - preview()).mean() < 3  # JPEG, and half the colour resolution
    with Image.open(path) as picture:
        assert picture.size == (80, 60)
        assert np.abs(np.asarray(picture.convert("RGB")).astype(int) - preview()).mean() < 3
    with rawpy.imread(str(path)) as raw:
        thumb = raw.extract_thumb()
    assert thumb.format == rawpy.ThumbFormat.JPEG
    np.testing.assert_array_equal(imagecodecs.jpeg8_decode(bytes(thumb.data)), shown)


def test_exiftool_finds_nothing_to_complain_of(tmp_path: Path) -> None:
    for number, original in enumerate(CASES):
        write_dng(tmp_path / f"{number}.dng", original, preview())
    verdicts = exiftool("-validate", "-warning", "-error", "-a", "-q", "-s3", tmp_path).decode()
    assert verdicts.split() == ["OK"] * len(CASES)


def test_exiftool_shows_metadata_and_preview(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    tags = ["-Artist", "-LensModel", "-ExposureTime", "-ISO", "-SubSecDateTimeOriginal"]
    shown = exiftool("-s3", *tags, path).decode().splitlines()
    taken = "2014:03:09 07:05:01.0203+05:30"
    assert shown == [METADATA.artist, METADATA.lens, "1/250", "640", taken]
    assert exiftool("-b", "-PreviewImage", path) == read_preview(path)


def test_an_edit_is_read_back_and_costs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    edits = ["-Artist=Zoë", "-ISO=100", "-Orientation#=1", "-XMP:Rating=3"]
    exiftool("-q", "-overwrite_original", *edits, "-DateTimeOriginal=2020:01:02 03:04:05", path)
    read = read_dng(path)
    assert same(read, mosaic())
    taken = METADATA.taken.replace(2020, 1, 2, 3, 4, 5)
    assert read.metadata == replace(METADATA, artist="Zoë", iso=100, orientation=1, taken=taken)


@pytest.mark.parametrize("case", [1, 3])
def test_a_rebuild_from_nothing_costs_nothing(tmp_path: Path, case: int) -> None:
    path = tmp_path / "shot.dng"
    original = CASES[case]
    write_dng(path, original, preview())
    again = ["-all=", "-tagsfromfile", "@", "-all:all", "-unsafe"]
    exiftool("-q", "-q", "-overwrite_original", *again, path)
    read = read_dng(path)
    assert same(read, original)
    # It copies the length as it prints it.
    assert replace(read.metadata, focal_length=METADATA.focal_length) == METADATA


@pytest.mark.parametrize("original", CASES)
def test_adobe_reads_the_very_samples(
    tmp_path: Path, original: Mosaic, capfd: pytest.CaptureFixture[str]
) -> None:
    dngpy = pytest.importorskip(
        "dngpy", reason="Adobe's DNG SDK: its bindings dngpy are not installed: build them"
    )
    write_dng(tmp_path / "shot.dng", original, preview())
    samples = np.squeeze(dngpy.Dng(str(tmp_path / "shot.dng")).raw_pixels)
    np.testing.assert_array_equal(samples, original.codes)
    assert "Error" not in capfd.readouterr().err  # it says there when the digest is wrong
