"""Copies of files that are replaced."""

import errno
import os
import shutil
from pathlib import Path
from typing import NoReturn

import pytest

from shared.errors import OutputError
from shared.writing import write_durably
from tools.io.backup import keep_old


def test_an_old_file_that_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "shot.tif"
    path.write_bytes(b"old")

    def broken(*_: object) -> NoReturn:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "link", broken)  # so that it is copied
    monkeypatch.setattr(shutil, "copyfileobj", broken)
    with pytest.raises(OutputError, match=r"shot\.tif: cannot be read, to keep it as shot\.tif\.bak"):
        keep_old(path)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("links")
def test_no_copy_of_an_old_file_is_ever_replaced(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    (tmp_path / "camera.json.bak").write_text("mine")
    (tmp_path / "camera.json.bak2").symlink_to("nowhere")
    for number in range(3):
        if number:
            assert keep_old(path).name == f"camera.json.bak{number + 2}"
        write_durably(path, str(number).encode(), overwrite=True)
    assert (tmp_path / "camera.json.bak").read_text() == "mine"
    assert (tmp_path / "camera.json.bak2").is_symlink()
    assert [(tmp_path / f"camera.json.bak{number}").read_text() for number in (3, 4)] == ["0", "1"]
