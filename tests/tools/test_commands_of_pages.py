"""The READMEs' commands are those of the program: a verb or an option that went is not named."""

import io
import re
import shlex
from contextlib import redirect_stderr, suppress
from pathlib import Path

import pytest

from panchroma.tools.cli import VERBS, build_parser
from tests.data import ROOT

PAGES = [
    page
    for page in sorted(ROOT.rglob("*.md"))
    if not {".venv", "notebook"} & set(page.relative_to(ROOT).parts)
]


def commands(page: str) -> list[list[str]]:
    """The words of the commands in a page, without pipes, redirections and comments; those with
    variables of the shell, or that ask a library for cameras, are left out.
    """
    blocks = re.findall(r"```sh\n(.*?)```", page, re.DOTALL)
    inline = [text.replace("\n", " ") for text in re.findall(r"`(panchroma [^`]*)`", page)]
    lines = [line for block in blocks for line in block.replace("\\\n", " ").split("\n")]
    split = (re.split(r"\||&&|;|  #|[<>]", line) for line in lines + inline)
    parts = [part.strip() for parts in split for part in parts]
    ours = [part.removeprefix(".venv/bin/") for part in parts if "$" not in part]
    words = [shlex.split(part, comments=True)[1:] for part in ours if part.startswith("panchroma ")]
    return [
        command
        for command in words
        if not command[0].startswith(("VERB", "help", "-")) and "genicam:" not in command
    ]


def fault(words: list[str]) -> str:
    """What the parser says of a command, "" if it takes it; an argument may be missing in prose."""
    said = io.StringIO()
    with redirect_stderr(said), suppress(SystemExit):
        parser, _ = build_parser(words[0])
        parser.parse_args(words)
    return "" if "are required" in said.getvalue() else said.getvalue()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_commands_of_a_page_are_taken(page: Path) -> None:
    for words in commands(page.read_text("utf-8")):
        assert words[0] in VERBS, words
        assert not fault(words), words
