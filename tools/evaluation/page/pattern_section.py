"""The section of the page that compares filter patterns under the same light: which is best, and when."""

from collections.abc import Sequence
from html import escape

from tools.camera.protocols import Protocol
from tools.pictures.html import cell, row, row_title, table

from ..criteria import CRITERIA, HUE, RGB, TENTH_CHROMINANCE, WHOLE
from ..figures import Figures, SetFigures
from ..methods import BASELINES, methods
from ..pattern_verdict import COMPARED, best_patterns, gains
from ..study import Study
from ..tiles import Tile
from ..verdict import capital, heading
from .exhibits import exhibit_html
from .gallery import Exhibit
from .plots import Series, legend, line_plot
from .tile_picture import tile_picture

_COLOURS = 9  # of the style sheet
_HEADS = {RGB: "median RGB", TENTH_CHROMINANCE: "worst colour", WHOLE: "whole image", HUE: "hue, %"}


def pattern_section(figures: Figures, exhibits: Sequence[Exhibit]) -> str:
    """Pictures of the patterns; for each set the best ones, their leads over noise, all figures, and where they differ most."""
    study = figures.study
    parts = [
        f"<h2>Which pattern is best, and when?</h2><p>{escape(_conditions(study))} Figures are those of "
        f"{escape(methods()[study.ours or ''].title)}. Worst colour is the chrominance that nine tenths of the patches reach, "
        "hue the share of pixels of wrong hue.</p>",
        f'<div class="tiles">{"".join(_card(study, tile) for tile in study.tiles)}</div>',
    ]
    for group in figures.sets:
        sentences = "".join(f"<p>{escape(sentence)}</p>" for sentence in best_patterns(group))
        plots, lines = _plots(group)
        tables = "".join(_table(group, level) for level in study.levels)
        parts.append(
            f'<h3>{escape(heading(group))}</h3>{sentences}<p class="soft">How much better each pattern is than '
            f"{escape(study.tile.title)}: above 0 it is ahead.</p>"
            f'<div><div class="plots">{plots}</div>{legend(lines)}</div>{tables}'
        )
    if exhibits:
        parts.append("<h3>Where the patterns differ most</h3>")
        for level in dict.fromkeys(exhibit.crop.level for exhibit in exhibits):
            shown = "".join(_exhibit(each) for each in exhibits if each.crop.level == level)
            parts.append(f'<h4>{escape(capital(level.text))}</h4><div class="exhibits">{shown}</div>')
    return "\n".join(parts)


def _conditions(study: Study) -> str:
    text = f"Every pattern photographs the same scenes under the same light, {study.protocol.equal_noise}."
    if any(tile.pattern.channels != "RGB" for tile in study.tiles):
        text += (
            " Pictures in other colours than the scene's are unmixed (by the inverse of the filters' matrix) and measured there."
        )
    return text


def _card(study: Study, tile: Tile) -> str:
    light = study.light(tile)
    collected = f"{light:.2f}× the light of a Bayer sensor" if light else "no scene has its colours"
    return (
        f'<figure class="tile">{tile_picture(tile.pattern)}<figcaption><b>{escape(tile.name)}</b><br>'
        f"{100 * tile.panchromatic_share:.0f} % W<br>{collected}</figcaption></figure>"
    )


def _plots(group: SetFigures) -> tuple[str, list[Series]]:
    """A plot for each criterion over noise, and its lines."""
    study = group.study
    drawn, lines = [], []
    for index in COMPARED:
        columns = [group.by_pattern(level, index) for level in study.levels]
        if not any(columns):
            continue
        sign, own = CRITERIA[index].sign, study.tile
        lines = [
            Series(
                f"pattern-{place}",
                tile.name,
                f"var(--r{place % _COLOURS})",
                [sign * (each[tile] - each[own]) if tile in each and own in each else None for each in columns],
                dashed=place >= _COLOURS,
            )
            for place, tile in enumerate(study.tiles)
        ]
        unit = "%" if index == HUE else "dB"
        title = f"{capital(CRITERIA[index].title)}, {unit}"
        drawn.append(line_plot(title, study.levels, lines, "lead"))
    return "".join(drawn), lines


def _table(group: SetFigures, level: Protocol) -> str:
    """All figures of a set at a level: a row for each pattern."""
    study = group.study
    values = {index: group.by_pattern(level, index) for index in COMPARED}
    best = {index: group.best_pattern(level, index) for index in COMPARED}
    leads = {f"over {name}": found for name in BASELINES if (found := gains(group, level, name))}
    rows = []
    for tile in study.tiles:
        light = study.light(tile)
        cells = [cell(f"{100 * tile.panchromatic_share:.0f} %"), cell(f"{light:.2f}×" if light else "–")]
        for index in COMPARED:
            text = CRITERIA[index].text(values[index][tile]) if tile in values[index] else "–"
            cells.append(cell(text, best=best[index] == tile, mark="★ "))
        cells += [cell(f"{found[tile]:+.1f}" if tile in found else "–") for found in leads.values()]
        rows.append(row([row_title(tile.name), *cells]))
    head = [capital(level.text), "W", "light", *(_HEADS[index] for index in COMPARED), *leads]
    return table(head, rows)


def _exhibit(exhibit: Exhibit) -> str:
    """An exhibit that shows the worst picture of the place on the left at first, and the best on the right."""
    by_psnr = sorted((picture.psnr, place) for place, picture in enumerate(exhibit.pictures) if picture.psnr is not None)
    return exhibit_html(exhibit, by_psnr[0][1], by_psnr[-1][1])
