"""Copies of files that are replaced."""

from pathlib import Path

import pytest

from panchroma.shared.writing import write_durably
from panchroma.tools.io.backup import keep_old


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
