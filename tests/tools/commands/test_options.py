"""What options mean that several commands have."""

import json
from argparse import ArgumentParser
from pathlib import Path

import pytest

from panchroma.shared import Camera, CfaPattern, SensorCalibration
from panchroma.tools.commands.options import add, camera_of

KODAK = "WBWG/BWGW/WGWR/GWRW"


TWO = CfaPattern.of_letters("RW/WB", channels="RB")


@pytest.mark.parametrize(
    ("options", "known", "expected"),
    [
        ("", None, CfaPattern.bayer()),
        ("", CfaPattern.of_letters(KODAK), CfaPattern.of_letters(KODAK)),
        ("--origin 1,2", CfaPattern.of_letters(KODAK), CfaPattern.of_letters(KODAK, (1, 2))),
        (f"--pattern {KODAK} --origin 1,-1", None, CfaPattern.of_letters(KODAK, (1, 3))),
        ("--pattern RW/WB --channels BR", None, CfaPattern.of_letters("RW/WB", channels="BR")),
        ("--pattern K=4", CfaPattern.of_letters(KODAK), CfaPattern.bayer(4)),
        # it has the channels of the camera
        ("--camera camera.json --pattern RW/WB", None, TWO),
    ],
)
def test_the_pattern_that_options_describe(
    options: str,
    known: CfaPattern | None,
    expected: CfaPattern,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("camera.json").write_text(json.dumps(Camera(SensorCalibration(channels="RB")).to_json()))
    parser = ArgumentParser()
    add(parser, "camera", "pattern", "channels", "origin")
    camera, pattern = camera_of(parser.parse_args(options.split()), known)
    assert (camera is not None, pattern) == ("--camera" in options, expected)
