"""The figures for machines: JSON with everything, CSV with a row per figure."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

from tools.host.console import one_line

from .claims import claims
from .criteria import CRITERIA, EVEN
from .figures import Figure, Figures, SetFigures
from .measures import PLANES
from .methods import methods
from .metrics import BORDER, PSNR_PATCH, QUANTILES
from .scene_sets import CROP
from .strokes import COLOURS, MARGIN, WHITE, WIDTHS
from .study import Study
from .tiles import Tile
from .verdict import caveats

_COLUMNS = ("group", "scene", "level", "method", "period")
_POOLED = "all scenes"
_DRAWN = "drawn strokes"


def rows(figures: Figures) -> list[dict[str, Any]]:
    """One flat object per figure, pools (scene null) before scenes; PSNR quantiles are PLANE_q10 to PLANE_q75."""
    return [_row(figures.study, figure) for figure in (*figures.pools.values(), *figures.scenes.values())]


def stroke_rows(figures: Figures) -> list[dict[str, Any]]:
    """One flat object per method, level, pattern and colour of the drawn strokes; kept_8 is the part kept in those of 8 pixels."""
    return [
        {
            "group": _DRAWN,
            "scene": colour,
            "level": each.level.level,
            "method": each.method,
            "period": each.tile and each.tile.period,
            "pattern": each.tile and each.tile.name,
            **{f"kept_{width}": round(part, 4) for width, part in zip(WIDTHS, parts, strict=True)},
        }
        for each in figures.strokes
        for colour, parts in zip(COLOURS, each.kept, strict=True)
    ]


def encode_csv(figures: Figures) -> bytes:
    """CSV file content: UTF-8, a header line, decimal points, figures to 4 decimals; rows of the drawn strokes at the end."""
    text = io.StringIO()
    found, drawn = rows(figures), stroke_rows(figures)
    columns = dict.fromkeys(name for row in (*found[:1], *drawn[:1]) for name in row)
    writer = csv.DictWriter(text, list(columns or _COLUMNS), lineterminator="\n")
    writer.writeheader()
    for row in (*found, *drawn):
        writer.writerow({**row, "scene": one_line(row["scene"] or _POOLED)})
    return text.getvalue().encode()


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
            "patterns": {tile.name: {"tile": tile.letters, **_facts(study, tile)} for tile in study.tiles},
            "patch": PSNR_PATCH,
            "border": BORDER,
            "quantiles": QUANTILES,
            "scenes_cut_to_multiples_of": CROP,
        },
        "scenes": [
            {name: getattr(scene, name) for name in ("source", "name", "group", "rows", "columns", "channels", "notes")}
            for scene in study.scenes
        ],
        "methods": {
            name: {"title": methods()[name].title, "ours": methods()[name].ours, "bayer": not methods()[name].sparse}
            for name in study.methods
        },
        "verdict": {group.name: _verdict(group) for group in figures.sets},
        "figures": rows(figures),
        "strokes": {"colours": COLOURS, "white": WHITE, "widths": WIDTHS, "margin": MARGIN, "kept": stroke_rows(figures)},
        "failed": failures,
        "left_out": left_out,
    }
    return (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(errors="backslashreplace")


def _verdict(group: SetFigures) -> dict[str, Any]:
    levels, compared = [], group.comparisons
    for level in group.study.levels:
        margin = group.at(level).margin()
        by_scene = group.scene_leads(level)
        best = group.best_period(level)
        levels.append(
            {
                "level": level.level,
                "winner": {each.name: group.at(level).best(criterion=index) for index, each in enumerate(CRITERIA)},
                "best_rival": margin and margin[0],
                "margin_rgb": margin and round(margin[1], 4),
                "scenes_won": sum(lead >= EVEN for lead in by_scene),
                "scenes": len(by_scene),
                "best_period": best and best[0],
                "best_pattern": {
                    each.name: tile and tile.name
                    for index, each in enumerate(CRITERIA)
                    for tile in [group.best_pattern(level, index)]
                },
            }
        )
    return {
        "ours": group.study.ours,
        "levels": levels,
        "caveats": caveats(group),
        "claims": [{"claim": c.text, "finding": c.finding, "scenes": c.scenes, "why": c.why} for c in claims(group)],
        "comparisons": len(compared),
        "losses": [
            {
                "scene": each.scene,
                "level": each.level.level,
                "rival": each.rival,
                "figure": CRITERIA[each.criterion].name,
                "margin": round(-each.lead, 4),
            }
            for each in compared
            if each.lost
        ],
    }


def _facts(study: Study, tile: Tile | None) -> dict[str, Any]:
    """What is known of a pattern; None in every place for a Bayer camera's method."""
    light = tile and study.light(tile)
    return {
        "period": tile and tile.period,
        "panchromatic_share": tile and round(tile.panchromatic_share, 6),
        "light": light and round(light, 6),
    }


def _row(study: Study, figure: Figure) -> dict[str, Any]:
    facts = _facts(study, figure.tile)
    row: dict[str, Any] = {name: getattr(figure, name) for name in _COLUMNS if name != "period"}
    row |= {"level": figure.level.level, "period": facts.pop("period")}
    for plane, quantiles in zip(PLANES, figure.quality, strict=True):
        for quantile, value in zip(QUANTILES, quantiles, strict=True):
            row[f"{plane}_q{round(100 * quantile)}"] = round(value, 4)
    for plane, value in zip(("psnr", *(f"psnr_{plane}" for plane in PLANES[1:])), figure.psnr, strict=True):
        row[plane] = round(value, 4)
    hue = None if figure.wrong_hue is None else round(figure.wrong_hue, 6)
    row |= {"ssim": round(figure.ssim, 6), "wrong_hue": hue, "scenes": figure.scenes}
    return {**row, "pattern": figure.tile and figure.tile.name, **facts}
