from pathlib import Path

import pytest

from device.preview.graph import build_preview
from shared import CfaPattern
from tests.tools.command import run


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
