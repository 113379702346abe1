"""Every table of figures in the pages says which algorithm made it: those of another are wrong."""

import re
from collections.abc import Iterator
from itertools import pairwise

import pytest

from panchroma.offline.version import ALGORITHM
from tests.data import ROOT

PAGES = [
    path.relative_to(ROOT).as_posix()
    for room in (".", "device", "offline", "shared", "tests", "tools")
    for path in sorted((ROOT / room).glob("*.md" if room == "." else "**/*.md"))
]
_NUMBERS = re.compile(r"[-–±,; ]*(\d*\.?\d+([-–±,; ]+|$))+")
_COMMIT = "commit [0-9a-f]{8}"
CAPTION = re.compile(
    rf"\*(ALGORITHM (?P<now>\d+), {_COMMIT}(; [^;:]+: {_COMMIT})*"
    rf"|ALGORITHM \d+, {_COMMIT}, whose command is gone"
    rf"|Without ALGORITHM, {_COMMIT})\.\*"
)
"""The line below a table: of today's algorithm, some rows perhaps of an older commit, as rivals'; of
one that nobody can measure again; or of no render, as a speed.
"""
TODAY = f"*ALGORITHM {ALGORITHM}, commit 0123abcd.*"
ROWS = "| | dB |\n|---|---|\n| `best` | **45.1**, 40; 39.2 ± 0.1 |"


def tables(page: str) -> Iterator[tuple[str, str]]:
    """Yield each table that has figures, and the paragraph below it."""
    for table, below in pairwise([*re.split(r"\n\s*\n", page), ""]):
        rows = [line for line in table.splitlines() if line.startswith("|")]
        cells = (cell for row in rows[2:] for cell in row.strip("|").split("|")[1:])
        if any(_NUMBERS.fullmatch(cell.replace("*", "").strip()) for cell in cells):
            yield table, below.strip()


def faults(page: str) -> list[str]:
    """Return a line for each table without a caption, or with one of another algorithm."""
    found = []
    for table, below in tables(page):
        caption = CAPTION.fullmatch(below)
        if caption is None or caption["now"] not in (None, str(ALGORITHM)):
            found.append(f"{table.splitlines()[-1]}: {below.splitlines()[:1]}")
    return found


@pytest.mark.parametrize("page", PAGES)
def test_figures_are_those_of_todays_algorithm(page: str) -> None:
    """If not: measure the table again with the command above it, and write the commit below it."""
    assert not faults((ROOT / page).read_text())


@pytest.mark.parametrize(
    ("below", "count"),
    [
        (TODAY, 0),
        ("*ALGORITHM 7, commit 0123abcd, whose command is gone.*", 0),
        (f"*ALGORITHM {ALGORITHM - 1}, commit 0123abcd.*", 1),
        (f"*ALGORITHM {ALGORITHM}.*", 1),
        (f"*ALGORITHM {ALGORITHM}, commit 0123abcd; rivals.*", 1),
        ("Next paragraph.", 1),
        ("", 1),
    ],
)
def test_a_caption_is_missed(below: str, count: int) -> None:
    without_figures = "| a | b |\n|---|---|\n| 1 | text of 2 words |\n| K = 6 | text |"
    assert len(faults(f"Text:\n\n{ROWS}\n\n{below}\n\n{without_figures}")) == count


def test_the_tables_of_results_are_found() -> None:
    found = [table for page in PAGES for table, _ in tables((ROOT / page).read_text())]
    assert len(found) > 12
    assert sum("no noise" in table.splitlines()[0] for table in found) > 7
