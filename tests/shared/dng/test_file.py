from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import shared
from shared.dng import decode_preview, encode_dng, read_dng, read_preview, write_dng
from shared.errors import InputError, OutputError
from shared.pattern import CfaPattern
from tests.shared.dng.examples import METADATA, mosaic, preview, same


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    shared.write_dng(path, mosaic(), preview())
    read = shared.read_dng(str(path))
    assert same(read, mosaic())
    assert read.metadata == METADATA
    assert path.read_bytes() == encode_dng(mosaic(), preview())
    assert read_preview(path) == decode_preview(path.read_bytes())


def test_nothing_is_overwritten_unless_told(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    other = mosaic(CfaPattern.bayer(4))
    with pytest.raises(OutputError, match=r"shot\.dng: exists already"):
        write_dng(path, other, preview())
    assert same(read_dng(path), mosaic())
    write_dng(path, other, preview(), overwrite=True)
    assert same(read_dng(path), other)


def test_a_refused_mosaic_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'^[^:]*shot\.dng: the layout "cfa" cannot hold') as caught:
        write_dng(tmp_path / "shot.dng", mosaic(CfaPattern.bayer(12)), preview(), layout="cfa")
    assert str(caught.value).count("shot.dng") == 1
    assert list(tmp_path.iterdir()) == []


def make_folder(path: Path) -> None:
    path.mkdir()


def make_empty(path: Path) -> None:
    path.touch()


def make_jpeg(path: Path) -> None:
    path.write_bytes(decode_preview(encode_dng(mosaic(), preview())))


def make_torn(path: Path) -> None:
    data = encode_dng(mosaic(), preview())
    path.write_bytes(data[: len(data) // 2])


def make_unreadable(path: Path) -> None:
    path.symlink_to(path)  # a loop


def make_nothing(path: Path) -> None:
    assert not path.exists()


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (make_nothing, "there is no such file"),
        (make_folder, "is a folder; give a DNG of Panchroma"),
        (make_empty, "the file is empty"),
        (make_jpeg, "a JPEG picture, not a DNG"),
        (make_torn, "damaged: the file ends after"),
        (make_unreadable, "cannot be read"),
    ],
)
@pytest.mark.parametrize("read", [read_dng, read_preview])
def test_what_cannot_be_read_is_named_once(
    tmp_path: Path, make: Callable[[Path], None], reason: str, read: Callable[[Path], Any]
) -> None:
    path = tmp_path / "shot.dng"
    make(path)
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: {reason}")
    assert str(caught.value).count("shot.dng") == 1


def test_a_device_is_not_read() -> None:
    with pytest.raises(InputError, match="is a pipe or a device, not a file"):
        read_dng("/dev/zero")


def test_a_file_larger_than_a_tiff_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    with path.open("r+b") as file:
        file.truncate((1 << 32) + 1)
    with pytest.raises(InputError, match="larger than the 4294967296 bytes of a DNG of Panchroma"):
        read_dng(path)


def test_samples_are_read_only(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    with pytest.raises(ValueError, match="read-only"):
        read_dng(path).samples[0, 0] = np.uint16(1)
