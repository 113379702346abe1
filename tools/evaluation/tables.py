"""The figures as tables: for people a row per method, JSON with everything, CSV with a row per figure."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tools.batch.console import one_line
from tools.simulation.protocols import Protocol

from .figures import CRITERIA, EVEN, Figures
from .metrics import BORDER, PSNR_PATCH, QUANTILES
from .scene_sets import CROP
from .study import Study
from .tiles import Tile
from .verdict import judge

_COLUMNS = ("group", "scene", "level", "method", "period")
_POOLED = "all scenes"
_SCENE = ("source", "name", "group", "rows", "columns", "channels", "notes")
_FORMULA = ("=", "+", "-", "@", "＝", "＋", "－", "＠")  # and, in full width, what some programs take for them
_DIGITS = {"wrong_hue": 6}  # of figures; of all others 4


@dataclass(frozen=True)
class Table:
    """A table. head: titles of the columns; rows: texts, the title of the row first, of a noise level alone; best: of each row, the
    places of those texts that are the best of their column at their noise.
    """

    head: list[str]
    rows: list[list[str]]
    best: list[list[int]]


def method_table(figures: Figures, group: str) -> Table:
    """Return the table of a set: at each noise level a row for each method and pattern, a column for each of CRITERIA."""
    study, table = figures.study, Table(["", *(each.title for each in CRITERIA)], [], [])
    for level in study.levels:
        table.rows.append([level.text])
        table.best.append([])
        found = {
            study.method(name).title + (f", {tile.name}" if tile and len(study.tiles) > 1 else ""): figures.of(
                group, level, name, tile=tile
            )
            for name in study.methods
            for tile in study.cameras(name)
        }
        scores = [[each.score(figure) for each in CRITERIA] for figure in found.values()]
        best = [max((score for score in column if score is not None), default=None) for column in zip(*scores, strict=True)]
        for (title, figure), row in zip(found.items(), scores, strict=True):
            table.rows.append([title, *(each.text(figure) for each in CRITERIA)])
            places = enumerate(zip(row, best, strict=True), 1)
            table.best.append([place for place, (score, most) in places if score is not None and score == most])
    return table


def plain_text(figures: Figures) -> str:
    """The report for a terminal: for each set the table and the verdict."""
    lines = [describe(figures)]
    for group in figures.groups:
        rows = method_table(figures, group)
        table = [rows.head, *rows.rows]
        widths = [max(len(row[place]) for row in table if len(row) > 1) for place in range(len(rows.head))]
        lines += ["", f"{group} ({len(figures.scenes(group))})"]
        for first, *others in table:
            cells = [f"{text:>{width}}" for text, width in zip(others, widths[1:], strict=False)]
            lines.append("  ".join([f"{first:{widths[0]}}", *cells]).rstrip())
        lines += judge(figures, group).sentences
    return "\n".join(map(one_line, lines))


def describe(figures: Figures) -> str:
    """The scenes, cameras and light of a study in a sentence."""
    study, count = figures.study, len(figures.study.scenes)
    tiles = ", ".join(tile.title for tile in study.tiles)
    return (
        f"{count} scene{'s' * (count != 1)} before this camera ({tiles}) and a Bayer camera under the same light; "
        f"{study.protocol.summary}; {', '.join(level.text for level in study.levels)}."
    )


def rows(figures: Figures) -> list[dict[str, Any]]:
    """One flat object per figure, pools (scene null) before scenes; PSNR quantiles are PLANE_q10 to PLANE_q75."""
    found = []
    for each in figures.rows:
        period = each.tile and each.tile.period
        row = dict(zip(_COLUMNS, (each.group, each.scene, each.level.level, each.method, period), strict=True))
        values = {name: value if value is None else round(value, _DIGITS.get(name, 4)) for name, value in each.values.items()}
        facts = _facts(figures.study, each.tile)
        found.append(row | values | {"scenes": each.scenes, "pattern": each.tile and each.tile.name} | facts)
    return found


def encode_csv(figures: Figures) -> bytes:
    """CSV file content: UTF-8, a header line, decimal points, figures to 4 decimals."""
    text = io.StringIO()
    found = rows(figures)
    writer = csv.DictWriter(text, list(found[0] if found else _COLUMNS), lineterminator="\n")
    writer.writeheader()
    for row in found:
        writer.writerow({name: _cell(value) for name, value in (row | {"scene": row["scene"] or _POOLED}).items()})
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    """What a cell of a CSV file holds. A text from which a spreadsheet would make a formula gets an apostrophe in front.

    Source: OWASP, CSV injection.
    """
    if not isinstance(value, str):
        return value
    text = one_line(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text


def encode_json(figures: Figures, program: str, failures: list[str], left_out: Sequence[str] = ()) -> bytes:
    """JSON file content, one object: protocol, scenes, methods, verdict, figures, failures. No value is NaN or infinite.

    left_out: remarks on files that were not measured, or once for several.
    """
    study = figures.study
    document = {
        "program": program,
        "protocol": {
            "kind": study.protocol.name,
            "seed": study.seed,
            "level": study.protocol.unit,
            "levels": [level.level for level in study.levels],
            "period": study.tile.period,
            "periods": [tile.period for tile in study.tiles if tile.period],
            "pattern": study.tile.name,
            "patterns": {tile.name: {"tile": tile.letters, "period": tile.period, **_facts(study, tile)} for tile in study.tiles},
            "patch": PSNR_PATCH,
            "border": BORDER,
            "quantiles": QUANTILES,
            "scenes_cut_to_multiples_of": CROP,
        },
        "scenes": [{name: getattr(scene, name) for name in _SCENE} for scene in study.scenes],
        "methods": {
            name: {"title": study.method(name).title, "ours": study.method(name).ours, "bayer": not study.method(name).ours}
            for name in study.methods
        },
        "verdict": {group: _verdict(figures, group) for group in figures.groups},
        "figures": rows(figures),
        "failed": failures,
        "left_out": left_out,
    }
    return (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(errors="backslashreplace")


def _verdict(figures: Figures, group: str) -> dict[str, Any]:
    tone, sentences = judge(figures, group)
    return {
        "ours": figures.study.ours,
        "tone": tone,
        "sentences": sentences,
        "levels": [_level(figures, group, level) for level in figures.study.levels],
    }


def _level(figures: Figures, group: str, level: Protocol) -> dict[str, Any]:
    lead, scenes = figures.lead(group, level), figures.leads(group, level)
    tiles = {each.name: figures.best_tile(group, level, each) for each in CRITERIA}
    return {
        "level": level.level,
        "winner": {each.name: figures.best(group, level, each, figures.study.methods) for each in CRITERIA},
        "best_rival": lead and lead.rival,
        "margin_rgb": lead and round(lead.value, 4),
        "scenes_won": sum(each.value >= EVEN for each in scenes),
        "scenes": len(scenes),
        "best_pattern": {name: tile and tile.name for name, tile in tiles.items()},
    }


def _facts(study: Study, tile: Tile | None) -> dict[str, Any]:
    """What is known of a pattern; None in every place for a Bayer camera's method."""
    light = tile and study.light(tile)
    return {"panchromatic_share": tile and round(tile.panchromatic_share, 6), "light": light and round(light, 6)}
