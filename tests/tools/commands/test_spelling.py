"""Every option that a message of the command line names exists; no message names an argument of
Python there, nor an option in Python.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from panchroma.tools.cli import VERBS
from panchroma.tools.commands.spelling import option_of, spelled
from tests.data import ROOT
from tests.tools.command import run

ARGUMENT = re.compile(r"`([a-z_]+)(?:=[^`]*)?`")
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
PYTHON = {"threads", "depth", "preset", "centre"}  # in no command; the last is of a formula
WORDS = {"calibrate", "capture", "simulate", "max_pixels"}  # verbs; not set by an option
OTHERS = {"--nthreads", "--mode", "--force-reinstall", "--version"}  # of dask, rpicam, pip, all
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
    skipped |= {
        id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values
    }
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
