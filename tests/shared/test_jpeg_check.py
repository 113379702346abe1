"""Headers of JPEGs are read as libjpeg reads them."""

import io

import numpy as np
import pytest
from PIL import Image

from panchroma.shared.errors import InputError
from panchroma.shared.jpeg_check import read_header


def encoded(**options: object) -> bytes:
    buffer = io.BytesIO()
    pixels = np.random.default_rng(0).integers(0, 255, (30, 50, 3), np.uint8)
    Image.fromarray(pixels).save(buffer, "JPEG", **options)
    return buffer.getvalue()


def test_size_and_scans() -> None:
    plain, progressive = read_header(encoded()), read_header(encoded(progressive=True))
    assert (plain.rows, plain.columns, plain.components, plain.scans) == (30, 50, 3, 1)
    assert 1 < progressive.scans <= 12
    for header in (plain, progressive):
        header.check(1500)
        with pytest.raises(InputError, match="50 x 30"):
            header.check(1499)


def test_a_frame_in_a_thumbnail_does_not_count() -> None:
    jpeg = encoded()
    inside = b"Exif\0\0" + encoded(quality=5)[:2000].replace(b"\0\x1e\0\x32", b"\xff\xdc\xff\xdc")
    segment = b"\xff\xe1" + (len(inside) + 2).to_bytes(2, "big") + inside
    header = read_header(jpeg[:2] + segment + jpeg[2:])
    assert (header.rows, header.scans, header.exif) == (30, 1, inside[6:])


def test_repeated_scans_and_segments_without_end_are_refused() -> None:
    jpeg = encoded(progressive=True)
    last = jpeg.rindex(b"\xff\xda")
    with pytest.raises(InputError, match="scans"):
        read_header(jpeg[:-2] + jpeg[last:-2] * 40 + jpeg[-2:]).check(1500)
    with pytest.raises(InputError, match="4097 segments, more than any picture has"):
        read_header(jpeg[:2] + b"\xff\xe2\0\2" * 5000 + jpeg[2:])


@pytest.mark.parametrize(
    "jpeg", [b"", b"\xff\xd8", encoded()[:100], b"\xff\xd8" + b"\xff" * 100_000 + b"\0"]
)
def test_a_jpeg_without_a_frame_is_refused(jpeg: bytes) -> None:
    with pytest.raises(InputError, match="without a frame"):
        read_header(jpeg)
