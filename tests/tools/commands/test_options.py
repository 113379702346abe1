"""What options mean that several commands have.

Every option that a message of the command line names exists; no message names an argument of
Python there, nor an option in Python.
"""

import ast
import inspect
import json
import re
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import panchroma
from panchroma.shared import Camera, CfaPattern, SensorCalibration
from panchroma.tools.cli import VERBS, build_parser, option_of, spelled
from panchroma.tools.commands.options import add, camera_of
from tests.data import ROOT
from tests.tools.command import run

# --- options --------------------------------------------------------------------------------------

KODAK = "WBWG/BWGW/WGWR/GWRW"

# The function of a verb, and those that read and write its files in Python.
IN_PYTHON: dict[str, tuple[Callable[..., Any], ...]] = {
    "simulate": (panchroma.simulate, panchroma.Shot.save),
    "render": (panchroma.render, panchroma.open, panchroma.Picture.save),
    "burst": (panchroma.burst, panchroma.Picture.save),
    "calibrate": (panchroma.calibrate, panchroma.Calibration.save),
    "preview": (panchroma.preview, panchroma.open, panchroma.Image.save),
}
# Of a run over many files; Python has what `truth`, `export` and format raw write as `shot.truth`,
# `device.build_preview` and `shot.mosaic.codes`.
OF_A_RUN = {"output", "resume", "dry_run", "jobs", "json", "help"}
OF_A_RUN |= {"quiet", "verbose", "truth", "export"}
# Of arrays and objects, which a command line has not; a variable of the environment.
OF_PYTHON = {"bands", "stages", "max_pixels"}
# What a command takes as --dark F --dark F, --chart-light A=F, and, of -o FILE, --update.
DEFAULTS = {"dark": (), "flat": (), "chart_light": None, "update": None}
RENAMED = {"seed": "rng"}  # which may be a generator, too
BY_THE_NAME = {"format"}  # a picture is saved in the format that the end of its name says
STATED = r"\(?(-?\d[\d.]*(?:, ?-?\d[\d.]*)*)\)?"


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
        ("render x -o y --exposure -1/3", -1 / 3),
        ("simulate x -o y --sigma 1/100", 0.01),
        ("simulate x -o y --motion 3/2", 1.5),
        ("simulate x -o y --bracket -2/3,0,1/2", (-2 / 3, 0.0, 0.5)),
        ("simulate x -o y --shading 5/2,15", (2.5, 15.0)),
        ("evaluate x -o y --light 1/4,1", (0.25, 1.0)),
        ("burst x y -o z --shifts 1/2,3/2", ((0.5, 1.5),)),
        ("capture - -o x --gain 3/2", 1.5),
        ("capture - -o x --fps 25/2", 12.5),
        ("view - --exposure-time 1/100", 0.01),
        ("render x -o y --wb 3/2,1,2", (1.5, 1.0, 2.0)),
        ("view - --bind localhost:8000", ("127.0.0.1", 8000)),
        ("view - --bind localhost", ("127.0.0.1", 8000)),
        ("view - --bind 0.0.0.0:80", ("0.0.0.0", 80)),
        ("view - --bind [::1]:9", ("::1", 9)),
    ],
)
def test_a_value_is_taken_in_every_form(line: str, value: object) -> None:
    words = line.split()
    name = next(word for word in words if word.startswith("--")).partition("=")[0][2:]
    parsed = build_parser(words[0])[0].parse_args(words)
    assert getattr(parsed, name.replace("-", "_")) == value


def described(function: Callable[..., Any]) -> Iterator[tuple[str, Any, str]]:
    """Name, default and text of each parameter that has to be named."""
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.KEYWORD_ONLY:
            text = re.search(rf"^{name}\b.*\n((?:    .*\n?)+)", inspect.getdoc(function), re.M)
            yield name, parameter.default, " ".join(text[1].split()) if text else ""


def stated(text: str) -> set[str]:
    """The numbers of which a text says that they are the default: "0", "0,0"."""
    found = re.findall(rf"default: {STATED}|{STATED} by default|by default {STATED}", text)
    return {number.replace(" ", "") for numbers in found for number in numbers if number}


@pytest.mark.parametrize("verb", IN_PYTHON)
def test_a_function_has_the_options_and_defaults_of_its_verb(verb: str) -> None:
    actions = build_parser(verb)[1]._actions
    taken = [one for one in actions if one.option_strings and one.dest not in OF_A_RUN]
    options = {RENAMED.get(action.dest, action.dest): action for action in taken}
    functions = IN_PYTHON[verb]
    parameters = [one for function in functions for one in described(function)]
    known = {name for name, _, _ in parameters} - OF_PYTHON
    assert known - BY_THE_NAME == options.keys() - BY_THE_NAME
    for name, default, text in parameters:
        assert text, f"{name} is not described"
        if name not in options or name in BY_THE_NAME:
            continue
        action = options[name]
        assert default == DEFAULTS.get(name, action.default), name
        numbers = stated(text) | stated(action.help)
        assert stated(text) == stated(action.help) or default is not None, name
        assert default is None or {float(number) for number in numbers} <= {default}, name
        for choice in action.choices or ():
            assert re.search(rf"\b{choice}\b", text), f"{name}: {choice}"


# --- spelling -------------------------------------------------------------------------------------

ARGUMENT = re.compile(r"`([a-z_]+)(?:=[^`]*)?`")
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
PYTHON = {"threads", "depth", "preset", "centre"}  # in no command; the last is of a formula
WORDS = {"calibrate", "capture", "simulate", "max_pixels"}  # verbs; not set by an option
OTHERS = {"--mode", "--force-reinstall", "--version"}  # of rpicam, pip, all
VERBLESS = ("shared", "device", "offline")
MODULES = [
    path.relative_to(ROOT)
    for room in (*VERBLESS, "tools")
    for path in sorted((ROOT / room).rglob("*.py"))
    if "training" not in path.parts  # a program of its own
]


@cache
def options(verb: str) -> frozenset[str]:
    return frozenset(OPTION.findall(run(verb, "--help", code=0).out))


def texts(path: Path) -> Iterator[str]:
    """The texts of a module but for its docstrings; a value in one of them is a ‹›."""
    nodes = list(ast.walk(ast.parse((ROOT / path).read_text("utf-8"))))
    skipped = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    joined = (node for node in nodes if isinstance(node, ast.JoinedStr))
    skipped |= {id(part) for node in joined for part in node.values}
    for node in nodes:
        match node:
            case ast.JoinedStr(values=parts):
                values = (part.value if isinstance(part, ast.Constant) else "‹›" for part in parts)
                yield "".join(map(str, values))
            case ast.Constant(value=str(text)) if id(node) not in skipped:
                yield text


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_what_a_message_names_exists(path: Path) -> None:
    """An argument is an option of some verb; an option is one of the verb of the module, or of a
    verb that the message names.
    """
    everywhere = frozenset[str]().union(*map(options, VERBS))
    verbs = {path.stem} & VERBS.keys() if path.match("tools/commands/*.py") else VERBS.keys()
    for text in texts(path):
        named = set(re.findall(r"[a-z]+", text)) & VERBS.keys()
        named |= {"capture"} if path.stem == "identify" else set()  # which it advises
        there = OTHERS.union(*map(options, verbs | named or VERBS.keys()))
        assert set(OPTION.findall(text)) <= there, text
        plain = re.sub("`[^`]* [^`]*`|rpicam-raw.*", "", text)  # without commands
        assert not (path.parts[0] in VERBLESS and OPTION.search(plain)), text
        if "notebook" not in path.parts:
            known = {option_of(name) for name in set(ARGUMENT.findall(text)) - PYTHON - WORDS}
            assert known <= everywhere, text


@pytest.mark.parametrize("verb", VERBS)
def test_no_verb_names_an_option_that_it_lacks(verb: str) -> None:
    for text in (text for path in MODULES for text in texts(path) if ARGUMENT.search(text)):
        message = spelled(text, options(verb))
        assert not ARGUMENT.search(message)
        assert set(OPTION.findall(message)) - set(OPTION.findall(text)) <= options(verb)


@pytest.mark.parametrize(
    ("library", "line"),
    [
        ("use `overwrite=True` to replace it", "use --overwrite to replace it"),
        ("give `width`, `height` and `stride`", "give --size and --stride"),
        ("begins late (`width=4056`?)", "begins late (--size 4056xHEIGHT?)"),
        ("`sensor_bits` does not go with `camera`", "--sensor-bits does not go with --camera"),
        ('`wb="auto"` estimates it', "wb auto estimates it"),  # no option of this verb
        ("`black=N` states another", "--black N states another"),
        ("`max_pixels` raises it", "the environment variable PANCHROMA_MAX_PIXELS raises it"),
        ("`panchroma simulate` makes one", "`panchroma simulate` makes one"),
    ],
)
def test_arguments_become_options(library: str, line: str) -> None:
    assert spelled(library, options("capture") | {"--overwrite"}) == line
