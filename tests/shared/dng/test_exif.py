from dataclasses import fields, replace
from datetime import datetime
from io import BytesIO
from typing import Any

import pytest
from PIL import Image

from shared import CaptureMetadata
from shared.dng import decode_dng, encode_dng, exif_block
from shared.dng.exif import read_metadata
from shared.dng.tags import Tag
from tests.shared.dng.examples import METADATA, mosaic, preview


def survivor(metadata: CaptureMetadata) -> CaptureMetadata:
    return decode_dng(encode_dng(mosaic(metadata=metadata), preview())).metadata


def test_everything_survives() -> None:
    assert all(getattr(METADATA, field.name) != field.default for field in fields(METADATA))
    assert survivor(METADATA) == METADATA


@pytest.mark.parametrize("field", [field.name for field in fields(CaptureMetadata)])
def test_each_field_is_there_alone_or_not_at_all(field: str) -> None:
    alone = replace(CaptureMetadata(), **{field: getattr(METADATA, field)})
    assert survivor(alone) == alone


@pytest.mark.parametrize(
    "metadata",
    [
        *(CaptureMetadata(orientation=turn) for turn in range(1, 9)),
        *(CaptureMetadata(exposure_time=seconds) for seconds in (1 / 8000, 1 / 3, 0.3, 30.0, 1234.5, 1 / 123456789)),
        *(CaptureMetadata(iso=iso) for iso in (1, 65534, 65535, 65536, 409600)),
        CaptureMetadata(f_number=0.95),
        CaptureMetadata(focal_length=8.8000001),
        CaptureMetadata(make="X"),
        CaptureMetadata(artist="山" * 500),
        CaptureMetadata(taken=datetime(987, 1, 2, 3, 4, 5)),  # noqa: DTZ001
        CaptureMetadata(taken=datetime(2024, 12, 31, 23, 59, 59, 999999)),  # noqa: DTZ001
    ],
    ids=str,
)
def test_odd_values_survive(metadata: CaptureMetadata) -> None:
    assert survivor(metadata) == metadata


def test_an_exposure_is_the_fraction_that_people_know() -> None:
    exif = Image.Exif()
    exif.load(b"Exif\0\0" + exif_block(METADATA))
    exposure: Any = exif.get_ifd(Tag.EXIF_IFD)[Tag.EXPOSURE_TIME]
    assert (exposure.numerator, exposure.denominator) == (1, 250)


def test_the_block_is_what_picture_files_hold() -> None:
    file = BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", exif=b"Exif\0\0" + exif_block(METADATA))
    exif = Image.open(file).getexif()
    detail = exif.get_ifd(Tag.EXIF_IFD)
    assert exif[Tag.MAKE] == METADATA.make
    assert exif[Tag.ORIENTATION] == 6
    assert exif[Tag.DATE_TIME] == "2014:03:09 07:05:01"
    assert detail[Tag.SUB_SEC_TIME_ORIGINAL] == "020300"
    assert detail[Tag.ISO_SPEED_RATINGS] == 640


@pytest.mark.parametrize(
    "exif",
    [
        {"ExposureTime": (1, 0)},
        {"ExposureTime": "soon", "FNumber": (), "ISOSpeedRatings": (0,)},
        {"FNumber": -2.8, "FocalLength": float("inf"), "ISOSpeedRatings": 0.5},
        {"LensModel": 35, "DateTimeOriginal": "yesterday", "SubsecTimeOriginal": 7},
        {"DateTimeOriginal": "0000:00:00 00:00:00", "FocalLength": (2**40, 1)},
    ],
)
def test_odd_fields_count_as_not_there(exif: dict[str, Any]) -> None:
    main: dict[int, Any] = {Tag.MAKE: b"\xff", Tag.ORIENTATION: 9}
    assert read_metadata(main.get, exif) == CaptureMetadata()


def test_the_odd_field_costs_no_other() -> None:
    exif = {"FNumber": (0, 0), "ISOSpeedRatings": (640, 200), "FocalLength": (35, 1), "DateTimeOriginal": "", "LensModel": "f/2"}
    main: dict[int, Any] = {Tag.ORIENTATION: 0, Tag.DATE_TIME: "2014:03:09 07:05:01", Tag.ARTIST: "J"}
    assert read_metadata(main.get, exif) == CaptureMetadata(
        lens="f/2",
        artist="J",
        focal_length=35.0,
        iso=3,
        taken=datetime(2014, 3, 9, 7, 5, 1),  # noqa: DTZ001
    )
