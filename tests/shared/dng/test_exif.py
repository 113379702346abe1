import dataclasses
import math
import struct
from dataclasses import replace
from datetime import datetime
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from panchroma.shared import CaptureMetadata
from panchroma.shared.dng import encode_dng, read_dng
from panchroma.shared.dng.exif import NUMBERS, TEXTS, metadata_directory, read_metadata, text
from panchroma.shared.dng.tags import GPS, TAG
from panchroma.shared.tiff import Directory, Fields, FieldType, encode_tiff
from panchroma.shared.tiff_reading import read_directories
from tests.shared.dng.examples import METADATA, mosaic, preview

ASCII, SHORT, RATIONAL = FieldType.ASCII, FieldType.SHORT, FieldType.RATIONAL


def exif_block(metadata: CaptureMetadata) -> bytes:
    return encode_tiff(metadata_directory(metadata))


def survivor(metadata: CaptureMetadata) -> CaptureMetadata:
    return read_dng(BytesIO(encode_dng(mosaic(metadata=metadata), preview()))).metadata


def test_everything_survives() -> None:
    for field in dataclasses.fields(METADATA):
        assert getattr(METADATA, field.name) != field.default
    assert survivor(METADATA) == METADATA
    assert survivor(replace(METADATA, artist="one\0two")).artist == "onetwo"


@pytest.mark.parametrize(
    "metadata",
    [
        *(replace(CaptureMetadata(), **{name: value}) for name, value in vars(METADATA).items()),
        *(CaptureMetadata(orientation=turn) for turn in range(1, 9)),
        *(CaptureMetadata(exposure_time=time) for time in (1 / 8000, 1 / 3, 0.3, 30.0, 1234.5)),
        CaptureMetadata(exposure_time=1 / 123456789),
        *(CaptureMetadata(iso=iso) for iso in (1, 65534, 65535, 65536, 409600)),
        CaptureMetadata(f_number=0.95),
        CaptureMetadata(place=(0.0, -180.0)),
        CaptureMetadata(place=(90.0, 1e-8)),
        CaptureMetadata(place=(-12.5, 59.99999999)),
        *(CaptureMetadata(altitude=metres) for metres in (0.0, 8848.86, -430.5)),
        CaptureMetadata(artist="山" * 500),
        CaptureMetadata(taken=datetime(987, 1, 2, 3, 4, 5)),  # noqa: DTZ001
        CaptureMetadata(taken=datetime(2024, 12, 31, 23, 59, 59, 999999)),  # noqa: DTZ001
    ],
    ids=str,
)
def test_single_fields_and_odd_values_survive(metadata: CaptureMetadata) -> None:
    assert survivor(metadata) == metadata


def test_the_block_is_what_picture_files_hold() -> None:
    file = BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", exif=b"Exif\0\0" + exif_block(METADATA))
    exif = Image.open(file).getexif()
    detail, place = exif.get_ifd(TAG["ExifTag"]), exif.get_ifd(TAG["GPSTag"])
    assert (exif[TAG["Make"]], exif[TAG["DateTime"]]) == ("Contax", "2014:03:09 07:05:01")
    assert exif[TAG["Orientation"]] == 6
    names = "DateTimeOriginal", "OffsetTimeOriginal", "SubsecTimeOriginal", "ISOSpeedRatings"
    assert [detail[TAG[name]] for name in names] == ["2014:03:09 07:05:01", "+05:30", "0203", 640]
    assert place[GPS["GPSLatitude"]] == (33, 51, pytest.approx(25.34, abs=1e-4))
    exposure: Any = detail[TAG["ExposureTime"]]
    assert (exposure.numerator, exposure.denominator) == (1, 250)  # the fraction that people know


def fields(**values: Any) -> Fields:
    """Fields by the names of their tags."""
    return {TAG[name]: value for name, value in values.items()}


def read(main: Fields, exif: Fields | None = None, gps: Fields | None = None) -> CaptureMetadata:
    """Read a TIFF structure with these fields."""
    below = {TAG["ExifTag"]: Directory(exif or {}), TAG["GPSTag"]: Directory(gps or {})}
    return read_metadata(BytesIO(encode_tiff(Directory(main, (), below))))


@pytest.mark.parametrize(
    "odd",
    [
        fields(ExposureTime=(RATIONAL, struct.pack("<2I", 1, 0)), FNumber=(RATIONAL, b"")),
        fields(ExposureTime=(ASCII, "soon"), FNumber=(FieldType.SRATIONAL, [-2.8])),
        fields(FocalLength=(FieldType.DOUBLE, [math.inf]), DateTimeOriginal=(ASCII, "yesterday")),
        fields(FocalLength=(FieldType.DOUBLE, [2.0**40]), DateTimeOriginal=(ASCII, "0000:00:00")),
        fields(OffsetTimeOriginal=(ASCII, "local"), OffsetTime=(SHORT, [1])),
        fields(ISOSpeedRatings=(SHORT, [0]), SubsecTimeOriginal=(SHORT, [7])),
        fields(LensModel=(SHORT, [3])),
    ],
)
def test_odd_fields_count_as_not_there_and_cost_no_other(odd: Fields) -> None:
    nonsense = fields(Make=(SHORT, [1]), Orientation=(SHORT, [9]))
    assert read(nonsense, odd) == CaptureMetadata()
    fine = fields(Artist=(ASCII, "J"), DateTime=(ASCII, "2014:03:09 07:05:01"))
    taken = datetime(2014, 3, 9, 7, 5, 1)  # noqa: DTZ001
    assert read(nonsense | fine, odd) == CaptureMetadata(artist="J", taken=taken)


def test_texts_are_read_as_they_were_meant() -> None:
    for data, expected in (
        ("Jürgen Müller".encode(), "Jürgen Müller"),
        ("Jürgen Müller".encode("cp1252"), "Jürgen Müller"),
        ("山田\u3000太郎".encode(), "山田\u3000太郎"),
        (b"Photographer\0Editor\0", "Photographer; Editor"),
        (b"one\r\ntwo\tthree\x1b[31m\x07", "one  two three [31m"),
        ("\u202eevil\u2066\ufeff".encode(), "evil"),
        (b"\xed\xa0\x80half a pair", "\u00ed\xa0\u20achalf a pair"),
        (b"x" + "ä".encode() * 10**6, "x" + "ä" * 2047),
        (b"\0" * 10**6, ""),
    ):
        assert read(fields(Copyright=(ASCII, data))) == CaptureMetadata(copyright=expected)


def test_a_place_is_whole_or_not_there() -> None:
    latitude, longitude = [33, 1, 51, 1, 25, 1], struct.pack("<6I", 151, 1, 12, 1, 40, 1)
    whole: Fields = {1: (ASCII, "S"), 2: (RATIONAL, struct.pack("<6I", *latitude))}
    whole |= {3: (ASCII, "E"), 4: (RATIONAL, longitude)}
    assert read({}, None, whole).place == pytest.approx((-33.856944, 151.211111), abs=1e-6)
    assert read({}, None, {tag: value for tag, value in whole.items() if tag != 1}).place is None
    halves = latitude[:4], [33, 0, *latitude[2:]], [95, *latitude[1:]]
    wrong: list[Any] = [(ASCII, "33"), (FieldType.SRATIONAL, [-33.0, 51, 25])]
    wrong.append((FieldType.DOUBLE, [33.5, 51, 25]))
    wrong += [(RATIONAL, struct.pack(f"<{len(values)}I", *values)) for values in halves]
    for tag, odd in [(1, (SHORT, [83])), (1, (ASCII, "?")), *((2, value) for value in wrong)]:
        assert read({}, None, whole | {tag: odd}) == CaptureMetadata(), odd
    # 40 m above the sea, or below?
    assert read({}, None, {5: (ASCII, "below"), 6: (RATIONAL, [40])}).altitude is None


def test_exif_in_the_first_directory_is_found_and_what_has_no_name_of_ours_is_left_out() -> None:
    assert read(fields(ExposureTime=(RATIONAL, [0.5]))) == CaptureMetadata(exposure_time=0.5)
    exif = fields(LightSource=(SHORT, [16]), OffsetTime=(ASCII, "-03:00"))
    assert read({}, exif, {29: (ASCII, "2024:05:01")}) == CaptureMetadata(zone="-03:00")


def test_time_zone_and_sensitivity_are_those_of_the_exposure() -> None:
    """Whatever the last edit says."""
    edit = fields(DateTime=(ASCII, "2024:01:05 09:00:00"), OffsetTime=(ASCII, "+09:00"))
    digital = (ASCII, "1998:06:01 12:00:00")
    for kind, zone in (("Original", ""), ("Digitized", "+02:00")):
        exif = {
            **fields(**{f"DateTime{kind}": digital, f"OffsetTime{kind}": (ASCII, zone)}),
            **edit,
        }
        taken = datetime(1998, 6, 1, 12)  # noqa: DTZ001
        assert read({}, exif) == CaptureMetadata(taken=taken, zone=zone)
    for name in ("ISOSpeed", "RecommendedExposureIndex", "StandardOutputSensitivity"):
        beyond = {name: (FieldType.LONG, [102400])}
        assert read({}, fields(ISOSpeedRatings=(SHORT, [65535]), **beyond)).iso == 102400


@pytest.mark.parametrize("cut", range(0, 300, 7))
def test_a_torn_structure_is_no_error(cut: int) -> None:
    data = exif_block(METADATA)
    torn = data[: len(data) * cut // 300]
    read_metadata(BytesIO(torn))
    random = np.random.default_rng(cut)
    flipped = bytearray(data)
    for place_of in random.integers(0, len(data), 20).tolist():
        flipped[place_of] ^= 1 << int(random.integers(8))
    found = read_metadata(BytesIO(flipped))
    again = survivor(found)
    fractions = {name: getattr(again, name) for name in (*NUMBERS, "altitude")}
    assert again == replace(found, **fractions)  # of 32 bits, which are written in 31


def test_what_hostile_files_hold_fits_a_jpeg() -> None:
    long = b"\xf0\x9f\x8c\x8d" * 10**5
    texts: Fields = dict.fromkeys(TEXTS.values(), (ASCII, long))
    exif: Fields = dict.fromkeys((TAG["LensModel"], TAG["OffsetTimeOriginal"]), (ASCII, long))
    gps: Fields = dict.fromkeys(range(7), (ASCII, long))
    found = read(texts, exif, gps)
    assert found.artist
    assert 10_000 < len(exif_block(found)) < 60_000


def test_the_source_of_a_dng_of_ours_is_known_and_its_camera_ours() -> None:
    tags = [TAG[name] for name in ("Make", "Model", "UniqueCameraModel")]
    main = read_directories(BytesIO(encode_dng(mosaic(), preview())), set(tags)).main
    assert [text(main, tag) for tag in tags] == ["Panchroma", *["Panchroma Pr?fling 7"] * 2]
    odd = replace(METADATA, make="<&\"'>", model="a]]>b</tiff:Model>")
    assert survivor(odd) == odd
