from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma import shared
from panchroma.shared.dng import encode_dng, read_dng, read_preview, verify_dng, write_dng
from panchroma.shared.errors import InputError, OutputError
from panchroma.shared.pattern import CfaPattern
from tests.shared.dng.examples import METADATA, mosaic, preview, same


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    shared.write_dng(path, mosaic(), preview())
    read = shared.read_dng(str(path))
    assert same(read, mosaic())
    assert read.metadata == METADATA
    with pytest.raises(ValueError, match="read-only"):
        read.samples[0, 0] = np.uint16(1)
    assert path.read_bytes() == encode_dng(mosaic(), preview())
    assert read_preview(path) == read_preview(BytesIO(path.read_bytes()))
    assert verify_dng(path) == read.shape
    with pytest.raises(OutputError, match=r"shot\.dng: exists already"):
        write_dng(path, read, preview())
    write_dng(path, mosaic(CfaPattern.bayer(4)), preview(), overwrite=True)
    assert read_dng(path).pattern == CfaPattern.bayer(4)


def test_a_refused_mosaic_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^[^:]*shot\.dng: the preview is float64") as caught:
        write_dng(tmp_path / "shot.dng", mosaic(), preview() / 2)  # type: ignore[arg-type]
    assert str(caught.value).count("shot.dng") == 1
    assert list(tmp_path.iterdir()) == []


WHOLE = encode_dng(mosaic(), preview())


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "there is no such file"),
        (b"", "the file is empty"),
        (b"\x89PNG", "not a DNG"),
        (b"II*\0", "damaged"),
        (b"II*\0\x08\0\0\0\0\0\0\0\0\0", ""),
        (read_preview(BytesIO(WHOLE)), "a JPEG picture, not a DNG"),
        (WHOLE[: len(WHOLE) // 2], "damaged: the file ends after"),
    ],
)
@pytest.mark.parametrize("read", [read_dng, read_preview, verify_dng])
def test_what_cannot_be_read_is_named_once(
    tmp_path: Path, content: bytes | None, reason: str, read: Callable[[Path], Any]
) -> None:
    path = tmp_path / "shot.dng"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: {reason}")
    assert str(caught.value).count("shot.dng") == 1


def test_a_file_larger_than_a_tiff_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    with path.open("r+b") as file:
        file.truncate((1 << 32) + 1)
    with pytest.raises(InputError, match="larger than the 4294967296 bytes of a DNG of Panchroma"):
        read_dng(path)
