"""Bones of TIFF files, which tests/shared/dng reads back by other programs.

Directories of TIFF files, before a library believes them. What they would do otherwise: see
tests/fuzz/bombs.
"""

import io
import struct

import numpy as np
import pytest
import tifffile

import panchroma.shared.tiff
from panchroma.shared.errors import InputError
from panchroma.shared.tiff import Directory, FieldType, encode_tiff
from panchroma.shared.tiff_reading import check_directories

# --- tiff -----------------------------------------------------------------------------------------


def test_numbers_that_are_no_fraction_of_32_bits_are_refused() -> None:
    kinds = {-0.5: FieldType.RATIONAL, 2.0**31: FieldType.RATIONAL, 1e12: FieldType.SRATIONAL}
    for number, kind in kinds.items():
        with pytest.raises(InputError, match=rf"{number} does not fit a TIFF {kind.name}"):
            encode_tiff(Directory({50714: (kind, [number])}))


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
