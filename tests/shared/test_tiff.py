"""Bones of TIFF files, read back by another program: tifffile.

Directories of TIFF files, before a library believes them. What they would do otherwise: see
tests/fuzz/bombs.
"""

import io
import struct
from typing import Any

import numpy as np
import pytest
import tifffile
from tifffile import TiffFile

import panchroma.shared.tiff
from panchroma.shared.errors import InputError
from panchroma.shared.tiff import Directory, FieldType, encode_tiff
from panchroma.shared.tiff_check import check_directories

# --- tiff -----------------------------------------------------------------------------------------

_ASCII_TAG, _NUMBERS_TAG, _SUB, _EXIF = 270, 50714, 330, 34665


def read(directory: Directory) -> TiffFile:
    return TiffFile(io.BytesIO(encode_tiff(directory)))


def value(kind: FieldType, values: Any) -> Any:
    """What tifffile makes of one field."""
    with read(Directory({_NUMBERS_TAG: (kind, values)})) as file:
        tag = file.pages.first.tags[_NUMBERS_TAG]
        assert tag.dtype == kind
        return tag.value


@pytest.mark.parametrize("text", ["", "abc", "abcd", "Käthe 山田", "one\0two"])
def test_texts_are_utf_8_and_end_with_their_only_nul(text: str) -> None:
    data = encode_tiff(Directory({_ASCII_TAG: (FieldType.ASCII, text)}))
    shown = text.replace("\0", "")
    assert shown.encode() + b"\0" in data
    with TiffFile(io.BytesIO(data)) as file:
        tag = file.pages.first.tags[_ASCII_TAG]
        assert tag.count == len(shown.encode()) + 1
        assert tag.value == shown


def test_fractions_are_the_simplest_that_read_back() -> None:
    """1/250 is written as photographers write it, not as 0.004's neighbours."""
    fractions = {1 / 250: (1, 250), 34.56: (864, 25), 5: (5, 1), 2**31 - 1: (2**31 - 1, 1)}
    for number, fraction in fractions.items():
        assert value(FieldType.RATIONAL, [number]) == fraction
        assert value(FieldType.SRATIONAL, [-number]) == (-fraction[0], fraction[1])


def test_fractions_are_as_near_as_31_bits_allow() -> None:
    for number in np.random.default_rng(1).lognormal(0, 6, 50).tolist():
        numerator, denominator = value(FieldType.RATIONAL, [number])
        assert 0 <= numerator < 2**31 > denominator > 0
        # Rounding to a multiple of 1 / 2**31 of the number's size, or to the smallest fraction
        # there is.
        assert abs(numerator / denominator - number) <= max(number, 1.0) * 2**-30
    kinds = {-0.5: FieldType.RATIONAL, 2.0**31: FieldType.RATIONAL, 1e12: FieldType.SRATIONAL}
    for number, kind in kinds.items():
        with pytest.raises(InputError, match=rf"{number} does not fit a TIFF {kind.name}"):
            encode_tiff(Directory({_NUMBERS_TAG: (kind, [number])}))


def test_entries_are_sorted_and_all_offsets_even() -> None:
    """TIFF 6.0, section 2: ascending tags; section 7: word boundaries."""
    fields: Any = {300: (FieldType.BYTE, b"12345"), 270: (FieldType.ASCII, "four")}
    fields[280] = FieldType.BYTE, b"1234567"
    with read(Directory(fields, strips=[b"odd", b"strip"])) as file:
        page = file.pages.first
        tags = sorted(page.tags, key=lambda tag: tag.offset)
        assert [tag.code for tag in tags] == [270, 273, 279, 280, 300]
        elsewhere = [tag.valueoffset for tag in tags if tag.valuebytecount > 4]
        assert len(elsewhere) == 5
        assert not any(offset % 2 for offset in (page.offset, *page.dataoffsets, *elsewhere))


def test_strips_and_children_are_where_the_tags_say() -> None:
    picture = np.arange(48, dtype=np.uint8).reshape(6, 8)
    image: Any = {tag: (FieldType.LONG, [number]) for tag, number in ((256, 8), (257, 6), (278, 4))}
    image |= dict.fromkeys((259, 262, 277), (FieldType.SHORT, [1])) | {258: (FieldType.SHORT, [8])}
    strips = [picture[:4].tobytes(), picture[4:].tobytes()]
    inner = Directory(image, strips=strips)
    exif = Directory({36864: (FieldType.UNDEFINED, b"0230")})
    with read(Directory(dict(image), strips=strips, children={_SUB: inner, _EXIF: exif})) as file:
        page = file.pages.first
        assert np.array_equal(page.asarray(), picture)
        assert np.array_equal(page.pages[0].asarray(), picture)
        assert page.tags[_SUB].dtype == FieldType.LONG  # not IFD: older readers know no type 13
        assert page.tags[_EXIF].value["ExifVersion"] == "0230"
        assert len(file.pages) == 1


def test_more_than_4_gib_is_refused_before_it_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(panchroma.shared.tiff, "LARGEST_TIFF", 1000)
    encode_tiff(Directory(strips=[bytes(900)]))
    with pytest.raises(InputError, match="4 GiB"):
        encode_tiff(Directory(strips=[bytes(500), bytes(600)]))


# --- tiff check -----------------------------------------------------------------------------------


def tiff(pages: int = 1, **options: object) -> io.BytesIO:
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer, **options) as writer:  # type: ignore[arg-type]
        for _ in range(pages):
            writer.write(np.zeros((20, 30, 3), np.uint8), photometric="rgb")
    return buffer


def directory(*fields: tuple[int, int, int, int]) -> bytes:
    """A little-endian TIFF of one directory at byte 8: fields (code, type, count, value)."""
    table = b"".join(struct.pack("<HHII", *field) for field in fields)
    return b"II*\0" + struct.pack("<IH", 8, len(fields)) + table + bytes(4)


@pytest.mark.parametrize(
    "options", [{}, {"bigtiff": True}, {"byteorder": ">"}, {"bigtiff": True, "byteorder": ">"}]
)
@pytest.mark.parametrize("pages", [1, 2])
def test_pictures_pass_and_a_second_one_is_seen(options: dict[str, object], pages: int) -> None:
    assert check_directories(tiff(pages, **options)) == (pages > 1)


def test_what_no_picture_has_is_refused_where_it_would_be_read() -> None:
    for field, words in (
        ((330, 4, 65, 8), "65 directories in field 330"),
        ((273, 4, 1 << 19, 8), "524288 numbers in field 273"),
        ((270, 2, 1 << 25, 8), "33554432 bytes in field 270"),
    ):
        with pytest.raises(InputError, match=words):
            check_directories(io.BytesIO(directory(field)))
    assert not check_directories(io.BytesIO(directory(field)), {256})


def test_directories_that_name_each_other_have_an_end() -> None:
    itself = directory((330, 4, 1, 8))
    assert not check_directories(io.BytesIO(itself))
    table = struct.pack("<H", 1) + struct.pack("<HHII", 330, 4, 1, 0) + bytes(4)
    chain = bytearray(b"II*\0" + struct.pack("<I", 8) + table * 100)
    for number in range(100):
        struct.pack_into("<I", chain, 8 + number * len(table) + 10, 8 + (number + 1) * len(table))
    with pytest.raises(InputError, match="65 directories, more than any picture has"):
        check_directories(io.BytesIO(chain))


@pytest.mark.parametrize("size", [0, 3, 8, 9, 100])
def test_a_torn_directory_is_told(size: int) -> None:
    file = tiff()
    with pytest.raises(InputError, match=f"the file ends after {size} bytes, before its directory"):
        check_directories(io.BytesIO(file.getvalue()[:size]))
