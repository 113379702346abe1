"""The figures for machines: JSON with everything, CSV with a row per figure."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

from tools.batch.console import one_line
from tools.simulation.noise import Protocol

from .figures import CRITERIA, EVEN, Figures, SetFigures
from .methods import methods
from .metrics import BORDER, PSNR_PATCH, QUANTILES
from .scene_sets import CROP
from .study import Study
from .tiles import Tile
from .verdict import best_period, caveats, claims

_COLUMNS = ("group", "scene", "level", "method", "period")
_POOLED = "all scenes"
_SCENE = ("source", "name", "group", "rows", "columns", "channels", "notes")
_FORMULA = ("=", "+", "-", "@", "＝", "＋", "－", "＠")  # and, in full width, what some programs take for them
_DIGITS = {"wrong_hue": 6}  # of figures; of all others 4


def rows(figures: Figures) -> list[dict[str, Any]]:
    """One flat object per figure, pools (scene null) before scenes; PSNR quantiles are PLANE_q10 to PLANE_q75."""
    found = []
    for each in figures.rows:
        row = _row(each.group, each.scene, each.level, each.method, each.tile)
        values = {name: value if value is None else round(value, _DIGITS.get(name, 4)) for name, value in each.values.items()}
        facts = _facts(figures.study, each.tile)
        found.append(row | values | {"scenes": each.scenes, "pattern": each.tile and each.tile.name} | facts)
    return found


def encode_csv(figures: Figures) -> bytes:
    """CSV file content: UTF-8, a header line, decimal points, figures to 4 decimals."""
    text = io.StringIO()
    found = rows(figures)
    columns = found[0] if found else _COLUMNS
    writer = csv.DictWriter(text, list(columns), lineterminator="\n")
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
            "periods": study.periods,
            "pattern": study.tile.name,
            "patterns": {tile.name: {"tile": tile.letters, "period": tile.period, **_facts(study, tile)} for tile in study.tiles},
            "patch": PSNR_PATCH,
            "border": BORDER,
            "quantiles": QUANTILES,
            "scenes_cut_to_multiples_of": CROP,
        },
        "scenes": [{name: getattr(scene, name) for name in _SCENE} for scene in study.scenes],
        "methods": {
            name: {"title": methods()[name].title, "ours": methods()[name].ours, "bayer": not methods()[name].sparse}
            for name in study.methods
        },
        "verdict": {group.name: _verdict(group) for group in figures.sets},
        "figures": rows(figures),
        "failed": failures,
        "left_out": left_out,
    }
    return (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(errors="backslashreplace")


def _verdict(group: SetFigures) -> dict[str, Any]:
    levels = []
    for level in group.study.levels:
        margin, by_scene = group.margin(level), group.margins(level)
        patterns = {each.name: group.best_pattern(level, each) for each in CRITERIA}
        levels.append(
            {
                "level": level.level,
                "winner": {each.name: group.best(level, each) for each in CRITERIA},
                "best_rival": margin and margin.rival,
                "margin_rgb": margin and round(margin.lead, 4),
                "scenes_won": sum(each.lead >= EVEN for each in by_scene),
                "scenes": len(by_scene),
                "best_period": best_period(group, level),
                "best_pattern": {name: tile and tile.name for name, tile in patterns.items()},
            }
        )
    return {
        "ours": group.study.ours,
        "levels": levels,
        "caveats": caveats(group),
        "claims": [vars(each) for each in claims(group)],
        "comparisons": len(group.comparisons),
        "losses": [
            {
                "scene": each.scene,
                "level": each.level.level,
                "rival": each.rival,
                "figure": each.criterion.name,
                "margin": round(-each.lead, 4),
            }
            for each in group.comparisons
            if each.lost
        ],
    }


def _row(group: str, scene: str | None, level: Protocol, method: str, tile: Tile | None) -> dict[str, Any]:
    """The columns with which every row begins."""
    return dict(zip(_COLUMNS, (group, scene, level.level, method, tile and tile.period), strict=True))


def _facts(study: Study, tile: Tile | None) -> dict[str, Any]:
    """What is known of a pattern; None in every place for a Bayer camera's method."""
    light = tile and study.light(tile)
    return {"panchromatic_share": tile and round(tile.panchromatic_share, 6), "light": light and round(light, 6)}
