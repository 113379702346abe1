"""What options mean that several commands have."""

import json
from argparse import ArgumentParser
from pathlib import Path

import pytest

from panchroma.shared import Camera, CfaPattern, SensorCalibration
from panchroma.tools.cli import build_parser
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


@pytest.mark.parametrize(
    ("line", "value"),
    [
        ("render x -o y --exposure=-1/3", -1 / 3),
        ("burst x -o y --exposure 2/3", 2 / 3),
        ("simulate x -o y --light 1/4", 0.25),
        ("simulate x -o y --sigma 1/100", 0.01),
        ("simulate x -o y --motion 3/2", 1.5),
        ("simulate x -o y --bracket=-2/3,0,1/2", (-2 / 3, 0.0, 0.5)),
        ("simulate x -o y --shading 5/2,15", (2.5, 15.0)),
        ("evaluate x -o y --light 1/4,1", (0.25, 1.0)),
        ("burst x y -o z --shifts 0,0", ((0.0, 0.0),)),
        ("burst x y -o z --shifts 1/2,3/2", ((0.5, 1.5),)),
        ("capture - -o x --gain 3/2", 1.5),
        ("capture - -o x --fps 25/2", 12.5),
        ("view - --exposure-time 1/100", 0.01),
    ],
)
def test_fractions_are_taken_everywhere(line: str, value: object) -> None:
    words = line.split()
    name = next(word for word in words if word.startswith("--")).partition("=")[0][2:]
    parsed = build_parser(words[0])[0].parse_args(words)
    assert getattr(parsed, name.replace("-", "_")) == value


def test_fractions_are_taken_in_a_white_balance() -> None:
    stated = build_parser("render")[0].parse_args(["render", "x", "-o", "y", "--wb", "3/2,1,2"])
    assert stated.wb == (1.5, 1.0, 2.0)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("localhost:8000", ("127.0.0.1", 8000)),
        ("localhost", ("127.0.0.1", 8000)),
        ("0.0.0.0:80", ("0.0.0.0", 80)),
        ("[::1]:9", ("::1", 9)),
    ],
)
def test_the_place_of_the_page(text: str, place: tuple[str, int]) -> None:
    assert build_parser("view")[0].parse_args(["view", "-", "--bind", text]).bind == place
