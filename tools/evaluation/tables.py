"""The figures as tables: for people a row per method, JSON with everything, CSV with a row per
figure.
"""

import csv
import io
import json
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from ...offline.version import ALGORITHM
from ..batch.console import one_line
from .figures import CRITERIA, Figure, Figures, Place, judge
from .metrics import BORDER, PSNR_PATCH, QUANTILES
from .scene_sets import CROP
from .study import SEED, source_digest

_POOLED = "all scenes"
_SCENE = ("source", "name", "group", "rows", "columns", "notes")
_FORMULA = tuple("=+-@＝＋－＠")  # in full width, too, which some programs take for the same


class Table(NamedTuple):
    """A table of texts.

    Parameters
    ----------
    head
        Titles of the columns.
    rows
        Texts of each row, its title first; a row of a single text is the heading of those below.
    best
        For each row the places of the texts that are the best of their column at their noise.
    """

    head: list[str]
    rows: list[list[str]]
    best: list[list[int]]


def method_table(figures: Figures, group: str) -> Table:
    """Return the table of a set: at each noise level a row for each method and pattern, a column
    for each of CRITERIA.
    """
    study, table = figures.study, Table(["", *(column.title for column in CRITERIA)], [], [])
    for level in study.levels:
        rows = [row for row in figures.rows if row.place == Place(group, level)]
        scores = np.array([[criterion.score(figure) for criterion in CRITERIA] for figure in rows])
        table.rows.append([level.text])
        table.best.append([])
        highest = scores == np.fmax.reduce(scores, initial=np.nan)
        for figure, best in zip(rows, highest, strict=True):
            pattern = f", {figure.tile.name}" if figure.tile and len(study.tiles) > 1 else ""
            title = study.method(figure.method).title + pattern
            table.rows.append([title, *(criterion.text(figure) for criterion in CRITERIA)])
            table.best.append((np.flatnonzero(best) + 1).tolist())
    return table


def plain_text(figures: Figures) -> str:
    """Return the report for a terminal: for each set the table and the verdict."""
    lines = [describe(figures)]
    for group in figures.groups:
        table = method_table(figures, group)
        columns = zip_longest(table.head, *table.rows, fillvalue="")
        first, *others = (max(map(len, column)) for column in columns)
        lines += ["", f"{group} ({len(figures.scenes(group))})"]
        for title, *texts in (table.head, *table.rows):
            entries = (f"  {text:>{width}}" for text, width in zip(texts, others, strict=False))
            lines.append(f"{title:{first}}{''.join(entries)}".rstrip())
        lines += judge(figures, group).sentences
    return "\n".join(map(one_line, lines))


def describe(figures: Figures) -> str:
    """Return the scenes, cameras and light of a study, and which pattern the verdict is on."""
    study, count = figures.study, len(figures.study.scenes)
    tiles = ", ".join(tile.name for tile in study.tiles)
    rivals = " and a Bayer camera under the same light" if study.rivals else ""
    judged = f" Verdict, crops and plots: {study.tile.name}." if len(study.tiles) > 1 else ""
    return f"{count} scene{'s' * (count != 1)} before this camera ({tiles}){rivals}.{judged}"


def _row(figure: Figure) -> dict[str, Any]:
    """Return the flat object of a figure; the scene of a set is None."""
    (group, level, scene), tile = figure.place, figure.tile
    row: dict[str, Any] = {"group": group, "scene": scene, "level": level.level}
    row |= {"method": figure.method, "period": tile and tile.period}
    for name, value in figure.values.items():
        row[name] = None if np.isnan(value) else round(value, 6)
    return row | {"scenes": figure.scenes, "pattern": tile and tile.name, "noise": level.option}


def encode_csv(figures: Figures) -> bytes:
    """Return the content of the CSV file: UTF-8, a header line, decimal points, figures to 6
    decimals.
    """
    text, rows = io.StringIO(), [_row(figure) for figure in figures.rows]
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        row["scene"] = row["scene"] or _POOLED
        writer.writerow({name: _entry(value) for name, value in row.items()})
    return text.getvalue().encode()


def _entry(value: Any) -> Any:
    """Return the content of an entry of a CSV file: an apostrophe precedes a text that a
    spreadsheet would take for a formula.

    Source: OWASP, CSV injection.
    """
    if not isinstance(value, str):
        return value
    text = one_line(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text


def encode_json(figures: Figures, program: str, failures: list[str], command: object) -> bytes:
    """Return the content of the JSON file, one object: program, with versions and command,
    protocol, scenes, methods, verdict, figures, failures; no NaN.

    Parameters
    ----------
    figures
        All results.
    program
        Name and version.
    failures
        A line for each scene or result that is missing.
    command
        The arguments of the command.
    """
    study, methods, patterns = figures.study, {}, {}
    for name in study.methods:
        method = study.method(name)
        methods[name] = {"title": method.title, "ours": method.ours, "bayer": not method.ours}
        methods[name] |= {"source": method.source, **method.identity}
    for tile in study.tiles:
        letters = "/".join(tile.pattern.tile)
        light = round(tile.light, 6)
        patterns[tile.name] = {"tile": letters, "period": tile.period, "light": light}
    protocol = {
        "kind": study.levels[0].name,
        "seed": SEED,
        "level": study.levels[0].unit,
        "levels": [level.level for level in study.levels],
        "channels": study.reading.channels,
        "pattern": study.tile.name,
        "patterns": patterns,
        "patch": PSNR_PATCH,
        "border": BORDER,
        "quantiles": QUANTILES,
        "scenes_cut_to_multiples_of": CROP,
    }
    document = {
        "program": program,
        "algorithm": ALGORITHM,
        "source": source_digest(),
        "command": command,
        "protocol": protocol,
        "scenes": [{name: getattr(scene, name) for name in _SCENE} for scene in study.scenes],
        "methods": methods,
        "verdict": {group: judge(figures, group)._asdict() for group in figures.groups},
        "figures": [_row(figure) for figure in figures.rows],
        "failed": failures,
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode(errors="backslashreplace")
