"""Headers of JPEGs are read as libjpeg reads them."""

import io
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from panchroma.shared.errors import ConvergenceError, InputError, MissingFileError, OutputError
from panchroma.shared.jpeg_check import read_header
from panchroma.shared.reading import opened_file, read_text, read_whole
from panchroma.shared.series import frame_number

# --- reading --------------------------------------------------------------------------------------


def test_a_file_within_its_bound_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_whole(path, 5, "a text") == b"12345"
    with pytest.raises(InputError, match="is larger than the 4 bytes of a text"):
        read_whole(path, 4, "a text")
    with opened_file(path, 5, "a text") as file:
        path.write_bytes(b"1234567890")  # it grows meanwhile
        assert file.read(5) == b"12345"


def test_what_is_no_file_is_told(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "empty").touch()
    said = {"pipe": "is a pipe", "empty": "is empty", ".": "is a folder", "absent": "no such file"}
    for name, words in said.items():
        with pytest.raises(InputError, match=words):
            read_whole(tmp_path / name, 5, "a text")
    with pytest.raises(InputError, match="cannot be read"):
        read_whole("nul\0", 5, "a text")


def test_faults_of_the_reader_are_not_taken_for_those_of_the_disk(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    with pytest.raises(ValueError, match="ours"), opened_file(tmp_path / "a", 5, "a text"):
        raise ValueError("ours")
    unreadable = pytest.raises(InputError, match="cannot be read")
    with unreadable, opened_file(tmp_path / "a", 5, "a text"):
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_other_encodings_are_refused_with_the_remedy(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes("some text".encode(encoding))
    with pytest.raises(InputError, match=r"\(it may be UTF-16\); save a list as UTF-8$"):
        read_text(path, 99, "a list", otherwise="latin-1")
    path.write_bytes("\xe4".encode("latin-1"))
    assert read_text(path, 99, "a list", otherwise="latin-1") == "\xe4"
    with pytest.raises(InputError, match="is not a text in UTF-8; save a list as UTF-8"):
        read_text(path, 99, "a list")


def test_errors_are_those_of_python_too(tmp_path: Path) -> None:
    """Programs that know nothing of Panchroma catch them, and they pass between processes."""
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_whole(tmp_path / "missing", 9, "a text")
    of_input = dict.fromkeys((InputError, MissingFileError), ValueError)
    for kind, base in (
        of_input | {OutputError: OSError, ConvergenceError: ArithmeticError}
    ).items():
        passed = pickle.loads(pickle.dumps(kind("x: is odd")))
        assert isinstance(passed, base)
        assert (type(passed), str(passed)) == (kind, "x: is odd")


# --- series ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rose", "rose-", "-1", "rose-1a", "rose_1", ""])
def test_what_is_no_frame(name: str) -> None:
    assert frame_number(name) is None


# --- jpeg check -----------------------------------------------------------------------------------


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
