"""The page: verdict, plots, gallery and all tables in one HTML file that needs no network."""

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from string import Template

from tools.pictures.html import bullets, cell, row, row_title, table
from tools.pictures.page import page

from ..claims import claims
from ..criteria import CRITERIA
from ..figures import Figures, SetFigures
from ..methods import methods
from ..metrics import BORDER, PSNR_PATCH
from ..scene_sets import CROP
from ..strokes import MARGIN, WIDTHS
from ..study import Study
from ..verdict import STROKES, capital, caveats, comparisons, defeat_parts, defeats, heading, headline, losses, worst_places
from .exhibits import exhibit_html, is_ours
from .gallery import WHY_PATTERNS, Exhibit
from .noise_section import noise_section
from .pattern_section import pattern_section

_HERE = files("tools.evaluation.page")


def build_page(figures: Figures, exhibits: Sequence[Exhibit], program: str, failures: Sequence[str]) -> bytes:
    """The content of its file.

    figures: all results.
    exhibits: the gallery; empty = no gallery.
    program: name and version.
    failures: a line for each scene or result that is missing, and for each folder of which a part is left out.
    """
    sections = [("verdict", "Verdict", _verdict_section(figures)), ("noise", "Noise", noise_section(figures))]
    if figures.strokes:
        sections.append(("strokes", "Strokes", strokes_section(figures)))
    of_patterns = [each for each in exhibits if each.crop.why == WHY_PATTERNS]
    if len(figures.study.tiles) > 1 and figures.study.ours:
        sections.append(("patterns", "Patterns", pattern_section(figures, of_patterns)))
    if len(exhibits) > len(of_patterns):
        others = [each for each in exhibits if each.crop.why != WHY_PATTERNS]
        sections.append(("gallery", "Gallery", _gallery_section(others, figures)))
    sections.append(("scenes", "Scenes", _scenes_section(figures, failures)))
    sections.append(("method", "How it was measured", _method_section(figures)))
    slider = "vendor/img-comparison-slider"
    parts = {
        "lede": _lede(figures),
        "navigation": " ".join(f'<a href="#{name}">{escape(label)}</a>' for name, label, _ in sections),
        "sections": "\n".join(f'<section id="{name}">{text}</section>' for name, _, text in sections),
        "program": escape(program),
        "slider_licence": _read(f"{slider}/LICENSE"),
        "slider": _read(f"{slider}/index.js"),
        "script": _read("page.js"),
    }
    css, body = _read("page.css") + _read(f"{slider}/styles.css"), Template(_read("page.html")).substitute(parts)
    return page("Panchroma: is this camera better?", css, body)


def _read(name: str) -> str:
    return (_HERE / name).read_text("utf-8")


def _lede(figures: Figures) -> str:
    study = figures.study
    count, levels = len(study.scenes), ", ".join(_levels(study))
    return (
        f"{count} scene{'s' * (count != 1)}, photographed with {_sensors(study)}, and with a Bayer sensor under the same light; "
        f"{escape(study.protocol.summary)}; {escape(levels)}. "
        f"Quality is the PSNR of every {PSNR_PATCH} × {PSNR_PATCH} patch."
    )


def _sensors(study: Study) -> str:
    if study.tile.period:
        text = f"a panchromatic sensor that has one Bayer block per {study.tile.period} × {study.tile.period} pixels"
    else:
        text = f"a panchromatic sensor with the colour filters of {escape(study.tile.name)}"
    others = len(study.tiles) - 1
    return text + f", with {others} other pattern{'s' * (others != 1)} of it" * bool(others)


def _levels(study: Study) -> list[str]:
    return [level.text for level in study.levels]


def _verdict_section(figures: Figures) -> str:
    parts = []
    for index, group in enumerate(figures.sets):
        parts.append(f"<h2>{escape(heading(group))}</h2>")
        parts.append(f'<p class="headline">{escape(headline(group))}</p>')
        parts.append(bullets(caveats(group), "caveats"))
        parts.append("".join(f"<p>{escape(sentence)}</p>" for sentence in (*comparisons(group), *worst_places(group))))
        items = [
            f'<li>“{escape(claim.text)}”: <span class="finding">{escape(claim.finding)}</span>, {escape(claim.scenes)}'
            f'<span class="soft why">{escape(claim.why)}</span></li>'
            for claim in claims(group)
        ]
        if lost := losses(group):
            items.append(f"<li>Where we lose: {escape(lost)}</li>")
        parts.append(f'<ul class="verdict">{"".join(items)}</ul>{_losses_table(group)}')
        tabs = "".join(
            f'<button role="tab" id="tab-{index}-{plane}" aria-controls="table-{index}-{plane}">{capital(criterion.title)}</button>'
            for plane, criterion in enumerate(CRITERIA)
        )
        parts.append(f'<div class="tabs" role="tablist" aria-label="Which error" hidden>{tabs}</div>')
        for plane, criterion in enumerate(CRITERIA):
            parts.append(
                f'<div id="table-{index}-{plane}" role="tabpanel" aria-labelledby="tab-{index}-{plane}"><p class="soft">'
                f"{escape(criterion.explanation)} The winner of each column is marked ★.</p>"
                f"{_pool_table(group, plane)}</div>"
            )
    return "\n".join(parts)


def _losses_table(group: SetFigures) -> str:
    """Where we lose: a row for each criterion, a column for each level; "" if it is nowhere."""
    found = {(each.level, each.criterion): each for each in defeats(group)}
    rows = []
    for criterion in sorted({criterion for _, criterion in found}):
        here = [found.get((level, criterion)) for level in group.study.levels]
        texts = ["; ".join(defeat_parts(group, each)) if each else "–" for each in here]
        rows.append(row([row_title(capital(CRITERIA[criterion].title)), *map(cell, texts)], "lost"))
    return table(["Where we lose", *_levels(group.study)], rows) if rows else ""


def _pool_table(group: SetFigures, index: int) -> str:
    study = group.study
    winners = [group.at(level).best(criterion=index) for level in study.levels]
    rows = []
    for name in study.methods:
        found = [group.pooled(level, name) for level in study.levels]
        texts = [CRITERIA[index].text(figure.values[index]) if figure else "–" for figure in found]
        cells = [cell(text, best=name == winner, mark="★ ") for text, winner in zip(texts, winners, strict=True)]
        rows.append(_method_row(name, cells))
    margins = [group.at(level).margin(index) for level in study.levels]
    if any(margins):
        cells = [
            f'<td>{CRITERIA[index].difference(lead[1])}<span class="by">{escape(lead[0])}</span></td>' if lead else cell("–")
            for lead in margins
        ]
        rows.append(row([row_title(f"{group.study.ours} minus best rival"), *cells], "margin"))
    return table(["Method", *_levels(group.study)], rows)


def _method_row(name: str, cells: Sequence[str]) -> str:
    return row([row_title(methods()[name].title), *cells], "ours" * methods()[name].ours)


def _gallery_section(exhibits: Sequence[Exhibit], figures: Figures) -> str:
    parts = [
        "<h2>Gallery</h2><p>Squares chosen by the figures, not by eye: where our best render gains most on the best "
        "rival of the scene, where it loses most, and where its error is largest. Choose two pictures, move the slider by finger, "
        "mouse or arrow keys, and zoom in to single pixels. Colours as a screen shows them; dark scenes are brightened.</p>"
    ]
    for level in dict.fromkeys(exhibit.crop.level for exhibit in exhibits):
        parts.append(f"<h3>{escape(capital(level.text))}</h3>")
        shown = [_exhibit(each, figures) for each in exhibits if each.crop.level == level]
        parts.append(f'<div class="exhibits">{"".join(shown)}</div>')
    return "\n".join(parts)


def _exhibit(exhibit: Exhibit, figures: Figures) -> str:
    """An exhibit that shows the best rival of the scene beside our best render at first."""
    rival = next((i for i, p in enumerate(exhibit.pictures) if p.method and not is_ours(p)), 0)
    own = next((i for i, p in enumerate(exhibit.pictures) if p.method == figures.study.ours), 0)
    return exhibit_html(exhibit, rival, own)


def strokes_section(figures: Figures) -> str:
    """What each method keeps of the colour of narrow strokes: a table for each level, a row for each method and pattern."""
    study = figures.study
    parts = [
        f"<h2>Colour of narrow strokes</h2><p>{escape(STROKES)}, in a drawn scene: the channels minus their mean, render over "
        f"truth, inside the strokes, {MARGIN} pixels from their edges. 1 is all of the colour, 0 is grey. Each colour alone is in "
        "evaluation.csv and evaluation.json.</p>"
    ]
    for level in study.levels:
        shown = [each for each in figures.strokes if each.level == level]
        best = [max(column) for column in zip(*(each.least for each in shown), strict=True)]
        rows = []
        for each in shown:
            title = methods()[each.method].title + (f", {each.tile.title}" if each.tile and len(study.tiles) > 1 else "")
            cells = [cell(f"{part:.2f}", best=part == most, mark="★ ") for part, most in zip(each.least, best, strict=True)]
            rows.append(row([row_title(title), *cells], "ours" * methods()[each.method].ours))
        head = [capital(level.text), *(f"{width} pixels" for width in WIDTHS)]
        parts.append(table(head, rows) if rows else "")
    return "\n".join(parts)


def _scenes_section(figures: Figures, failures: Sequence[str]) -> str:
    study = figures.study
    parts = [
        "<h2>Every scene</h2><p>Median PSNR of the scene's patches, dB: RGB / luminance / chrominance. Quantiles, whole-image "
        "PSNR, SSIM and wrong hues are in evaluation.csv and evaluation.json.</p>"
    ]
    for scene in study.scenes:
        winners = [figures.at_scene(scene.name, level).best() for level in study.levels]
        rows = []
        for name in study.methods:
            found = [figures.of_scene(scene.name, level, name) for level in study.levels]
            texts = [" / ".join(f"{value:.1f}" for value in figure.quality.median) if figure else "–" for figure in found]
            rows.append(_method_row(name, [cell(text, best=name == best) for text, best in zip(texts, winners, strict=True)]))
        summary = f"{scene.name} ({scene.columns} × {scene.rows}, {scene.group})"
        parts.append(
            f"<details><summary>{escape(summary)}</summary>{bullets(scene.notes, 'soft')}"
            f"{table(['Method', *_levels(study)], rows)}</details>"
        )
    if failures:
        parts.append(f"<h3>Left out</h3>{bullets(failures)}")
    return "\n".join(parts)


def _method_section(figures: Figures) -> str:
    study = figures.study
    entries = {
        "Patches": f"all overlapping {PSNR_PATCH} × {PSNR_PATCH} squares at least {BORDER} pixels inside the frame; "
        "10 log10(1 / MSE), intensities in scene units (1 = the white level of the scene's source); "
        "luminance is the mean of the channels, chrominance the rest; pooled over all patches of a set, as in Fig. 3 of the paper",
        "Frames": f"cut to whole multiples of {CROP} pixels before sampling",
        "Noise": f"seed {study.seed}, the same scene light for every camera; {study.protocol.conditions}",
        "Sets": "what sensors measured is pooled; developed 8-bit pictures (Kodak, McMaster, others) are linearised and reported "
        "separately, because they were interpolated and sharpened before",
        "Rivals": "LibRaw and OpenCV, which take integers, get samples with a pedestal, so that no noise is clipped; LibRaw's "
        "methods and those called balanced get white-balanced samples, as raw developers do; BM3D (package bm3d, for "
        "non-commercial use only) denoises each of the four planes and knows the true noise",
        "Whole image": f"PSNR and SSIM (Wang 2004, mean of the channels) leave out the same {BORDER} pixels; of a set, the mean of "
        "its scenes",
    }
    listed = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}.</dd>" for name, text in entries.items())
    names = "".join(f"<dt>{escape(name)}</dt><dd>{escape(methods()[name].title)}</dd>" for name in study.methods)
    return f"<h2>How it was measured</h2><dl>{listed}</dl><h3>Names in the tables</h3><dl>{names}</dl>"
