import math
import struct
from dataclasses import fields, replace
from datetime import datetime
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from shared import CaptureMetadata
from shared.dng import decode_dng, encode_dng, metadata_directory, read_metadata
from shared.dng.exif import TEXTS
from shared.dng.exif_reading import place, shown_fields, text
from shared.dng.exif_table import KEPT
from shared.dng.tags import Tag
from shared.tiff import Directory, Fields, FieldType, encode_tiff
from shared.tiff_reading import read_directories
from tests.shared.dng.examples import METADATA, mosaic, preview

ASCII, SHORT, RATIONAL = FieldType.ASCII, FieldType.SHORT, FieldType.RATIONAL


def exif_block(metadata: CaptureMetadata) -> bytes:
    return encode_tiff(metadata_directory(metadata))


def survivor(metadata: CaptureMetadata) -> CaptureMetadata:
    return decode_dng(encode_dng(mosaic(metadata=metadata), preview())).metadata


def test_everything_survives() -> None:
    assert all(getattr(METADATA, field.name) != field.default for field in fields(METADATA))
    assert survivor(METADATA) == METADATA


@pytest.mark.parametrize("field", [field.name for field in fields(CaptureMetadata)])
def test_each_field_is_there_alone_or_not_at_all(field: str) -> None:
    value = getattr(METADATA, field)
    if field == "more":  # a time of change, alone, is the best there is for the time when the picture was taken
        value = value[1:]
    alone = replace(CaptureMetadata(), **{field: value})
    assert survivor(alone) == alone


@pytest.mark.parametrize(
    "metadata",
    [
        *(CaptureMetadata(orientation=turn) for turn in range(1, 9)),
        *(CaptureMetadata(exposure_time=seconds) for seconds in (1 / 8000, 1 / 3, 0.3, 30.0, 1234.5, 1 / 123456789)),
        *(CaptureMetadata(iso=iso) for iso in (1, 65534, 65535, 65536, 409600)),
        CaptureMetadata(f_number=0.95),
        CaptureMetadata(artist="山" * 500),
        CaptureMetadata(taken=datetime(987, 1, 2, 3, 4, 5)),  # noqa: DTZ001
        CaptureMetadata(taken=datetime(2024, 12, 31, 23, 59, 59, 999999)),  # noqa: DTZ001
    ],
    ids=str,
)
def test_odd_values_survive(metadata: CaptureMetadata) -> None:
    assert survivor(metadata) == metadata


def test_the_block_is_what_picture_files_hold() -> None:
    file = BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", exif=b"Exif\0\0" + exif_block(METADATA))
    exif = Image.open(file).getexif()
    detail = exif.get_ifd(Tag.EXIF_IFD)
    assert detail[Tag.DATE_TIME_ORIGINAL] == "2014:03:09 07:05:01"
    assert exif[Tag.MAKE] == METADATA.make
    assert exif[Tag.ORIENTATION] == 6
    assert exif[Tag.DATE_TIME] == "2015:01:01 00:00:00"
    assert detail[Tag.SUB_SEC_TIME_ORIGINAL] == "0203"
    assert detail[Tag.ISO_SPEED_RATINGS] == 640
    exposure: Any = detail[Tag.EXPOSURE_TIME]
    assert (exposure.numerator, exposure.denominator) == (1, 250)  # the fraction that people know


def stored(main: Fields, exif: Fields | None = None, gps: Fields | None = None) -> bytes:
    """A TIFF structure with these fields."""
    below: dict[int, Directory] = {Tag.EXIF_IFD: Directory(exif or {}), Tag.GPS_IFD: Directory(gps or {})}
    return encode_tiff(Directory(main, (), below))


def read(main: Fields, exif: Fields | None = None, gps: Fields | None = None) -> CaptureMetadata:
    return read_metadata(BytesIO(stored(main, exif, gps)))


@pytest.mark.parametrize(
    "exif",
    [
        {Tag.EXPOSURE_TIME: (RATIONAL, struct.pack("<2I", 1, 0))},
        {Tag.EXPOSURE_TIME: (ASCII, "soon"), Tag.F_NUMBER: (RATIONAL, b""), Tag.ISO_SPEED_RATINGS: (SHORT, [0])},
        {Tag.F_NUMBER: (FieldType.SRATIONAL, [-2.8]), Tag.FOCAL_LENGTH: (FieldType.DOUBLE, [math.inf])},
        {Tag.LENS_MODEL: (SHORT, [35]), Tag.DATE_TIME_ORIGINAL: (ASCII, "yesterday"), Tag.SUB_SEC_TIME_ORIGINAL: (SHORT, [7])},
        {Tag.DATE_TIME_ORIGINAL: (ASCII, "0000:00:00 00:00:00"), Tag.FOCAL_LENGTH: (FieldType.DOUBLE, [2.0**40])},
        {Tag.LENS_SPECIFICATION: (RATIONAL, [35, 35, 2]), 37385: (ASCII, "no"), 37380: (RATIONAL, b"\xff" * 8)},
    ],
)
def test_odd_fields_count_as_not_there(exif: Fields) -> None:
    assert read({Tag.MAKE: (SHORT, [1]), Tag.ORIENTATION: (SHORT, [9])}, exif) == CaptureMetadata()


def test_the_odd_field_costs_no_other() -> None:
    exif: Fields = {
        Tag.F_NUMBER: (RATIONAL, struct.pack("<2I", 0, 0)),
        Tag.ISO_SPEED_RATINGS: (SHORT, [640, 200]),
        Tag.FOCAL_LENGTH: (RATIONAL, [35]),
        Tag.DATE_TIME_ORIGINAL: (ASCII, ""),
        Tag.LENS_MODEL: (ASCII, "f/2"),
    }
    main: Fields = {Tag.ORIENTATION: (SHORT, [0]), Tag.DATE_TIME: (ASCII, "2014:03:09 07:05:01"), Tag.ARTIST: (ASCII, "J")}
    assert read(main, exif) == CaptureMetadata(
        lens="f/2",
        artist="J",
        focal_length=35.0,
        iso=640,
        taken=datetime(2014, 3, 9, 7, 5, 1),  # noqa: DTZ001
    )


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("Jürgen Müller".encode(), "Jürgen Müller"),
        ("Jürgen Müller".encode("cp1252"), "Jürgen Müller"),
        ("山田\u3000太郎".encode(), "山田\u3000太郎"),
        (b"Photographer\0Editor\0", "Photographer; Editor"),
        (b"one\r\ntwo\tthree\x1b[31m\x07", "one  two three [31m"),
        ("\u202eevil\u2066\ufeff".encode(), "evil"),
        (b"\xed\xa0\x80half a pair", "\u00ed\xa0\u20achalf a pair"),
        (b"x" + "ä".encode() * 10**6, "x" + "ä" * 2047),
        (b"\0" * 10**6, ""),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_texts_are_read_as_they_were_meant(data: bytes, expected: str) -> None:
    assert read({Tag.COPYRIGHT: (ASCII, data)}) == CaptureMetadata(copyright=expected)


def test_a_place_is_whole_or_not_there() -> None:
    latitude, longitude = struct.pack("<6I", 33, 1, 51, 1, 25, 1), struct.pack("<6I", 151, 1, 12, 1, 40, 1)
    whole: Fields = {1: (ASCII, "S"), 2: (RATIONAL, latitude), 3: (ASCII, "E"), 4: (RATIONAL, longitude)}
    assert place(read({}, None, whole)) == pytest.approx((-33.856944, 151.211111), abs=1e-6)
    for odd in (
        {1: (SHORT, [83])},
        {1: (ASCII, "?")},
        {2: (ASCII, "33")},
        {2: (RATIONAL, latitude[:16])},
        {2: (FieldType.SRATIONAL, [-33.0, 51, 25])},
        {2: (FieldType.DOUBLE, [33.5, 51, 25])},
        {2: (RATIONAL, struct.pack("<6I", 33, 0, 51, 1, 25, 1))},
        {2: (RATIONAL, struct.pack("<6I", 95, 1, 51, 1, 25, 1))},
    ):
        found = read({}, None, {**whole, **odd})
        assert place(found) is None, odd
        assert [field.tag for field in found.more if field.directory == "gps"] == [3, 4]
    without_north: Fields = {tag: value for tag, value in whole.items() if tag != 1}
    assert [field.tag for field in read({}, None, without_north).more] == [3, 4]
    assert read({}, None, {5: (ASCII, "below"), 6: (RATIONAL, [40])}).more == ()  # 40 m above the sea, or below?
    assert read({}, None, {0: (FieldType.BYTE, b"\2\2\0\0")}).more == ()


def test_numbers_of_other_types_are_taken_over_in_exifs_own() -> None:
    exif: Fields = {37385: (FieldType.LONG, [16]), 37383: (FieldType.BYTE, b"\5"), Tag.LENS_SPECIFICATION: (SHORT, [24, 70, 2, 4])}
    assert shown_fields(read({}, exif)) == {"Flash": [16], "MeteringMode": [5], "LensSpecification": [24, 70, 2, 4]}


def test_exif_in_the_first_directory_is_found_as_tiff_ep_has_it() -> None:
    time, lens = (RATIONAL, [0.5]), (RATIONAL, [24, 70, 2, 4])
    expected = read({}, {Tag.EXPOSURE_TIME: time, Tag.LENS_SPECIFICATION: lens})
    assert read({Tag.EXPOSURE_TIME: time, Tag.LENS_INFO: lens}) == expected


@pytest.mark.parametrize("cut", range(0, 300, 7))
def test_a_torn_structure_is_no_error(cut: int) -> None:
    data = exif_block(METADATA)
    torn = data[: len(data) * cut // 300]
    read_metadata(BytesIO(torn))
    random = np.random.default_rng(cut)
    flipped = bytearray(data)
    for place_of in random.integers(0, len(data), 20).tolist():
        flipped[place_of] ^= 1 << int(random.integers(8))
    found = read_metadata(BytesIO(bytes(flipped)))
    assert exif_block(found)
    assert survivor(found) == replace(found, more=survivor(found).more)


def test_what_hostile_files_hold_fits_a_jpeg() -> None:
    long = b"\xf0\x9f\x8c\x8d" * 10**5
    texts: Fields = dict.fromkeys(TEXTS.values(), (ASCII, long))
    exif: Fields = {tag: (ASCII, long) for directory, tag in KEPT if directory == "exif"}
    exif[Tag.LENS_MODEL] = ASCII, long
    gps: Fields = {tag: (ASCII, long) for directory, tag in KEPT if directory == "gps"}
    found = read(texts, exif, gps)
    assert found.artist
    assert 10_000 < len(exif_block(found)) < 60_000


def test_the_source_of_a_dng_of_ours_is_known_and_its_camera_ours() -> None:
    data = encode_dng(mosaic(), preview())
    fields = read_directories(BytesIO(data), {Tag.MAKE, Tag.MODEL, Tag.UNIQUE_CAMERA_MODEL}).main
    named = [text(fields[tag]) for tag in (Tag.MAKE, Tag.MODEL, Tag.UNIQUE_CAMERA_MODEL)]
    assert named == ["Panchroma", *["Panchroma Pr?fling 7"] * 2]
    odd = replace(METADATA, make="<&\"'>", model="a]]>b</tiff:Model>")
    assert survivor(odd) == odd
