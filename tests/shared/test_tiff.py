"""Bones of TIFF files, read back by another program: tifffile."""

import io
import struct
from typing import Any

import numpy as np
import pytest
from tifffile import TiffFile

import panchroma.shared.tiff
from panchroma.shared.errors import InputError
from panchroma.shared.tiff import Directory, FieldType, encode_tiff

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
    data = encode_tiff(Directory(fields, strips=[b"odd", b"strip"]))
    (start,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, start)
    entries = [struct.unpack_from("<HHII", data, start + 2 + 12 * index) for index in range(count)]
    tags = [tag for tag, *_ in entries]
    assert tags == sorted(tags) == [270, 273, 279, 280, 300]
    elsewhere = [offset for _, kind, number, offset in entries if kind in (1, 2) and number > 4]
    assert all(offset % 2 == 0 for offset in elsewhere)
    (where,) = (offset for tag, _, _, offset in entries if tag == 273)
    assert all(strip % 2 == 0 for strip in struct.unpack_from("<2I", data, where))
    assert start % 2 == 0


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
