"""What options mean that several commands have."""

from argparse import ArgumentParser

import pytest

from shared import CfaPattern
from shared.errors import InputError
from tools.commands.options import add, amount, count, factor, numbers, pattern_of

KODAK = "WBWG/BWGW/WGWR/GWRW"


@pytest.mark.parametrize(
    ("options", "known", "expected"),
    [
        ("", None, CfaPattern.bayer()),
        ("", CfaPattern.of_letters(KODAK), CfaPattern.of_letters(KODAK)),
        ("--origin 1 2", CfaPattern.of_letters(KODAK), CfaPattern.of_letters(KODAK, (1, 2))),
        (f"--pattern {KODAK} --origin 1 -1", None, CfaPattern.of_letters(KODAK, (1, 3))),
        ("--period 4", CfaPattern.of_letters(KODAK), CfaPattern.bayer(4)),
    ],
)
def test_the_pattern_that_options_describe(options: str, known: CfaPattern | None, expected: CfaPattern) -> None:
    parser = ArgumentParser()
    add(parser, "pattern", "period", "origin")
    assert pattern_of(parser.parse_args(options.split()), known) == expected
    with pytest.raises(InputError, match="--pattern says where every filter is; leave --period out"):
        pattern_of(parser.parse_args(f"--pattern {KODAK} --period 4".split()))


@pytest.mark.parametrize(("text", "expected"), [("0.25", 0.25), ("1/4", 0.25), ("2", 2.0), ("3/2", 1.5)])
def test_light_may_be_a_fraction(text: str, expected: float) -> None:
    parser = ArgumentParser()
    parser.add_argument("--light", type=factor)
    assert parser.parse_args(["--light", text]).light == expected


@pytest.mark.parametrize(
    ("option", "text", "expected"),
    [
        *[("light", text, "a number, or a fraction such as 1/4") for text in ("1/0", "1/", "/4", "bright", "")],
        *[("sigma", text, "a number from 0 on") for text in ("-1", "nan", "inf", "x", "")],
        *[("threads", text, "a whole number from 1 on") for text in ("0", "-1", "1.5", "")],
        *[("pair", text, "2 numbers with commas between them, such as 1,-0.5") for text in ("1", "1,2,3", "1,x", "")],
    ],
)
def test_other_values_are_usage_errors(option: str, text: str, expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = ArgumentParser()
    for name, kind in (("light", factor), ("sigma", amount), ("threads", count), ("pair", numbers(2))):
        parser.add_argument(f"--{name}", type=kind)
    with pytest.raises(SystemExit):
        parser.parse_args([f"--{option}={text}"])
    assert f"{text!r} is not {expected}" in capsys.readouterr().err
