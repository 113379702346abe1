"""What is only looked at is not written to: a finished archive can be checked where nothing can be
written.
"""

import os
import re
from pathlib import Path

import pytest

from tests.tools.batch.examples import save_shot
from tests.tools.command import run

LINES = {
    "render shots -o pictures --preset paper --resume --dry-run": "3 up to date",
    "render shots -o new --dry-run": "3 to be made",
    "preview shots -o new --dry-run": "shots/1.dng -> ",
    "burst shots/1.dng shots/2.dng -o pictures -f png --dry-run": "shots/1.dng -> ",
    "inspect --verify shots": "3 whole, 0 damaged",
    "evaluate builtin:60x60 -o results --methods bilinear --sigma 0 --resume -n": "0 results to make",
    "evaluate builtin:60x60 -o new --methods bilinear --sigma 0 --dry-run": "1 results to make",
}


def test_dry_runs_and_checks_write_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, name in enumerate(("1.dng", "2.dng", "below/3.dng")):
        save_shot(tmp_path / "shots" / name, number)
    run("render", tmp_path / "shots", "--preset paper -o", tmp_path / "pictures", code=0)
    left = tmp_path / "pictures" / "below" / ".3.tif.12345678.panchroma.part"
    left.write_bytes(b"half of a picture, which the next run removes")
    run("evaluate builtin:60x60 --methods bilinear --sigma 0 -o", tmp_path / "results", code=0)
    # as on a disk that can only be read: a file that comes and goes changes the time of its folder
    monkeypatch.setattr(os, "access", lambda path, mode, **_: not mode & os.W_OK)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path, *tmp_path.rglob("*"))}
    for line, expected in LINES.items():
        outcome = run(re.sub(r"\b(?=(shots|pictures|results|new)\b)", f"{tmp_path}/", line), code=0)
        assert expected in outcome.out + outcome.err
    after = {path: path.stat().st_mtime_ns for path in (tmp_path, *tmp_path.rglob("*"))}
    assert after == before
