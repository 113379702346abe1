"""The figures for machines: JSON with everything, CSV with a row per figure."""

import csv
import io
import json
from typing import Any

from tools.host.console import one_line

from .figures import CRITERIA, Figure, Figures
from .measures import PLANES
from .methods import methods
from .metrics import BORDER, PATCH, QUANTILES
from .protocol import CROP

_COLUMNS = ("group", "scene", "level", "method", "period")
_POOLED = "all scenes"


def rows(figures: Figures) -> list[dict[str, Any]]:
    """One flat object per figure, pools (scene null) before scenes; PSNR quantiles are PLANE_q10 to PLANE_q75."""
    return [_row(figure) for figure in (*figures.pools.values(), *figures.scenes.values())]


def encode_csv(figures: Figures) -> bytes:
    """CSV file content: UTF-8, a header line, decimal points, figures to 4 decimals."""
    text = io.StringIO()
    found = rows(figures)
    writer = csv.DictWriter(text, list(found[0]) if found else list(_COLUMNS), lineterminator="\n")
    writer.writeheader()
    for row in found:
        writer.writerow({**row, "scene": one_line(row["scene"] or _POOLED)})
    return text.getvalue().encode()


def encode_json(figures: Figures, program: str, failures: list[str]) -> bytes:
    """JSON file content, one object: protocol, scenes, methods, verdict, figures, failures. No value is NaN or infinite."""
    study = figures.study
    document = {
        "program": program,
        "protocol": {
            "kind": study.protocol.kind,
            "seed": study.protocol.seed,
            "level": "sigma, scene units" if study.protocol.kind == "paper" else "exposure",
            "levels": study.levels,
            "period": study.period,
            "periods": study.periods,
            "patch": PATCH,
            "border": BORDER,
            "quantiles": QUANTILES,
            "scenes_cut_to_multiples_of": CROP,
        },
        "scenes": [
            {"source": s.source, "name": s.name, "group": s.group, "rows": s.rows, "columns": s.columns, "notes": s.notes}
            for s in study.scenes
        ],
        "methods": {name: {"title": methods()[name].title, "ours": methods()[name].ours} for name in study.methods},
        "verdict": {group: _verdict(figures, group) for group in figures.groups},
        "figures": rows(figures),
        "failed": failures,
    }
    return (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(errors="backslashreplace")


def _verdict(figures: Figures, group: str) -> dict[str, Any]:
    levels = []
    for level in figures.study.levels:
        margin = figures.margin(group, level)
        won, of = figures.wins(group, level)
        best = figures.best_period(group, level)
        levels.append(
            {
                "level": level,
                "winner": {each.name: figures.winner(group, level, index) for index, each in enumerate(CRITERIA)},
                "best_rival": margin and margin[0],
                "margin_rgb": margin and round(margin[1], 4),
                "scenes_won": won,
                "scenes": of,
                "best_period": best and best[0],
            }
        )
    return {
        "ours": figures.ours,
        "levels": levels,
        "claims": [{"claim": c.text, "finding": c.finding, "why": c.why} for c in figures.claims(group)],
        "losses": [
            {"scene": loss.scene, "level": loss.level, "rival": loss.rival, "margin_rgb": round(loss.margin, 4)}
            for loss in figures.losses(group)
        ],
    }


def _row(figure: Figure) -> dict[str, Any]:
    row: dict[str, Any] = {name: getattr(figure, name) for name in _COLUMNS}
    row["period"] = figure.period or None
    for plane, quantiles in zip(PLANES, figure.quality, strict=True):
        for quantile, value in zip(QUANTILES, quantiles, strict=True):
            row[f"{plane}_q{round(100 * quantile)}"] = round(value, 4)
    whole = {"psnr": round(figure.psnr, 4), "ssim": round(figure.ssim, 6), "wrong_hue": round(figure.wrong_hue, 6)}
    return {**row, **whole, "scenes": figure.scenes}
