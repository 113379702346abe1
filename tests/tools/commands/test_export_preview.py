from pathlib import Path

import pytest

from device.preview.graph import build_preview
from shared import CfaPattern
from tests.tools.command import names, run


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", build_preview(CfaPattern.bayer(6))),
        ("--pattern GBWW/RGWW/WWWW/WWWW", build_preview(CfaPattern.bayer(4, "GBRG"))),
        ("--scale 3", build_preview(CfaPattern.bayer(6), 3)),
        ("--space camera --period 4", build_preview(CfaPattern.bayer(4), linear=True)),
    ],
)
def test_it_writes_the_graph_asked_for(tmp_path: Path, options: str, expected: bytes) -> None:
    path = tmp_path / "g.onnx"
    outcome = run("export-preview", "-o", path, *options.split(), code=0)
    assert path.read_bytes() == expected
    assert outcome.out == f"{path}: {len(expected)} bytes\n"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("-o g.txt", "g.txt: a graph has a name that ends in .onnx; write g.onnx"),
        ("-o g.onnx --scale 4", "has 1, 2, 3, 6"),
        ("-o g.onnx --period 2", "the period is 2, expected 3 to 16"),
        ("-o g.onnx --like shot.dng --period 6", "leave --pattern and --period out"),
        ("-o g.onnx --like gone.dng", "gone.dng: there is no such file"),
        ("-o missing/g.onnx", "the folder missing does not exist"),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: str, words: str) -> None:
    monkeypatch.chdir(tmp_path)
    (line,) = run("export-preview", *options.split(), code=2).errors
    assert words in line
    assert names(tmp_path) == set()


def test_a_graph_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "g.onnx"
    path.write_text("mine")
    outcome = run("export-preview", "-o", path)
    assert (outcome.code, path.read_text()) == (2, "mine")
    assert "--overwrite" in outcome.err
    run("export-preview", "-o", path, "--overwrite", code=0)
    assert path.read_bytes() == build_preview(CfaPattern.bayer(6))
