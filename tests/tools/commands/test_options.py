"""What options mean that several commands have."""

import json
from argparse import ArgumentParser
from pathlib import Path

import pytest

from panchroma.shared import Camera, CfaPattern, SensorCalibration
from panchroma.tools.commands.options import add, camera_of

KODAK = "WBWG/BWGW/WGWR/GWRW"


@pytest.mark.parametrize(
    ("options", "known", "expected"),
    [
        ("", None, CfaPattern.bayer()),
        ("", CfaPattern.of_letters(KODAK), CfaPattern.of_letters(KODAK)),
        ("--origin 1,2", CfaPattern.of_letters(KODAK), CfaPattern.of_letters(KODAK, (1, 2))),
        (f"--pattern {KODAK} --origin 1,-1", None, CfaPattern.of_letters(KODAK, (1, 3))),
        ("--pattern RW/WB --channels BR", None, CfaPattern.of_letters("RW/WB", channels="BR")),
        ("--pattern K=4", CfaPattern.of_letters(KODAK), CfaPattern.bayer(4)),
    ],
)
def test_the_pattern_that_options_describe(
    options: str, known: CfaPattern | None, expected: CfaPattern
) -> None:
    parser = ArgumentParser()
    add(parser, "camera", "pattern", "channels", "origin")
    assert camera_of(parser.parse_args(options.split()), known) == (None, expected)


def test_a_pattern_has_the_channels_of_the_camera(tmp_path: Path) -> None:
    known = Camera(SensorCalibration(channels="RB"), CfaPattern.of_letters("RW/WB", channels="RB"))
    (tmp_path / "camera.json").write_text(json.dumps(known.to_json()))
    parser = ArgumentParser()
    add(parser, "camera", "pattern", "channels", "origin")
    options = ["--camera", str(tmp_path / "camera.json"), "--pattern", "RW/WB"]
    assert camera_of(parser.parse_args(options)) == (known, known.pattern)
