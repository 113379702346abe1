"""The page: two pictures, verdict, plots, gallery and all tables in one HTML file that needs no network."""

from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import TypeVar

import numpy as np

from tools.batch.html import bullets, cell, css_class, data_address, page, row, row_title, table
from tools.io.illustrations import tile_map
from tools.simulation.noise import Protocol

from ..figures import CRITERIA, Figures, SetFigures
from ..methods import methods
from ..metrics import BORDER, PSNR_PATCH
from ..report import (
    KEPT,
    Table,
    by_level,
    kept_table,
    method_table,
    pattern_conditions,
    pattern_table,
    scene_table,
    sensors,
    standing_table,
)
from ..scene_sets import CROP
from ..study import Study
from ..tiles import Tile
from ..verdict import capital, caveats, claims, heading, headline, losses
from .gallery import WHY_AHEAD, WHY_BEHIND, WHY_PATTERNS, Exhibit, Rendered
from .plots import noise_plots

T = TypeVar("T")

_HERE = files("tools.evaluation.page")
_CHOSEN = "The squares shown are those where our lead on the best rival, and its lead on ours, are largest."


def build_page(figures: Figures, exhibits: Sequence[Exhibit], program: str, failures: Sequence[str]) -> bytes:
    """The content of its file.

    figures: all results.
    exhibits: the gallery; empty = no gallery.
    program: name and version.
    failures: a line for each scene or result that is missing, and for each folder of which a part is left out.
    """
    study = figures.study
    of_patterns = [each for each in exhibits if each.crop.why == WHY_PATTERNS]
    others = [each for each in exhibits if each.crop.why != WHY_PATTERNS]
    sections = {
        "Verdict": "".join(_verdict(group, index) for index, group in enumerate(figures.sets)),
        "Noise": _noise_section(figures),
        "Patterns": _pattern_section(figures, of_patterns) if len(study.tiles) > 1 and study.ours else "",
        "Gallery": _gallery_section(others) if others else "",
        "Scenes": _scenes_section(figures, failures),
    }
    shown = {name: text for name, text in sections.items() if text}
    opened = [found for why in (WHY_AHEAD, WHY_BEHIND) if (found := _clearest(others, why))]
    slider = "vendor/img-comparison-slider"
    names = (f"<dt>{escape(name)}</dt><dd>{escape(methods()[name].title)}</dd>" for name in study.methods)
    parts = {
        "opening": "".join(_opened(each) for each in opened),
        "first": escape(" ".join([*map(headline, figures.sets[:1]), *(_CHOSEN for _ in opened[:1])])),
        "lede": escape(sensors(figures)),
        "navigation": " ".join(f'<a href="#{name.lower()}">{name}</a>' for name in shown),
        "sections": "\n".join(f'<section id="{name.lower()}">{text}</section>' for name, text in shown.items()),
        "patch": PSNR_PATCH,
        "border": BORDER,
        "crop": CROP,
        "seed": study.seed,
        "conditions": escape(study.protocol.conditions),
        "names": "".join(names),
        "program": escape(program),
        "slider_licence": _read(f"{slider}/LICENSE"),
        "slider": _read(f"{slider}/index.js"),
        "script": _read("page.js"),
    }
    css, body = _read("page.css") + _read(f"{slider}/styles.css"), Template(_read("page.html")).substitute(parts)
    return page("Panchroma: is this camera better?", css, body)


def _read(name: str) -> str:
    return (_HERE / name).read_text("utf-8")


def _clearest(exhibits: Sequence[Exhibit], why: str) -> Exhibit | None:
    """The exhibit there for a reason in which ours and the best rival differ most."""
    return max((each for each in exhibits if each.crop.why == why), key=lambda each: abs(_lead(each)), default=None)


def _beside(exhibit: Exhibit) -> tuple[Rendered, Rendered]:
    """Our best, and the rival that is best in this square."""
    rivals = (each for each in exhibit.pictures[1:] if not each.ours)
    return exhibit.pictures[exhibit.shown[1]], max(rivals, key=lambda each: each.psnr or 0.0)


def _lead(exhibit: Exhibit) -> float:
    """How much closer to the truth our best is than that rival, dB."""
    ours, rival = _beside(exhibit)
    return (ours.psnr or 0.0) - (rival.psnr or 0.0)


def _opened(exhibit: Exhibit) -> str:
    """Truth, our best and the best rival side by side."""
    pictures = "".join(
        f'<figure><img src="{_data(each)}" alt="{escape(each.name)}"><figcaption{css_class("ours" * each.ours)}>'
        f"{escape(each.title)}</figcaption></figure>"
        for each in (exhibit.pictures[0], *_beside(exhibit))
    )
    title = f"{capital(exhibit.crop.why)}: {exhibit.crop.scene.name}, {exhibit.crop.level.text}"
    return f"<div><h2>{escape(title)}</h2>{pictures}</div>"


def _table(content: Table) -> str:
    """A table with the best of each column marked, unless another reads the same; "" without rows."""
    rows, columns = [], [Counter(texts) for texts in zip(*(each.texts for each in content.rows), strict=True)]
    for each in content.rows:
        best = each.best or [False] * len(each.texts)
        alone = [mark and column[text] == 1 for mark, column, text in zip(best, columns, each.texts, strict=True)]
        cells = [cell(text, best=mark, mark="★ ") for text, mark in zip(each.texts, alone, strict=True)]
        rows.append(row([row_title(each.title), *cells], each.kind))
    return table(content.head, rows) if rows else ""


def _folded(title: str, content: str) -> str:
    """Content that is shown when its title is clicked; "" without content."""
    return f"<details><summary>{escape(title)}</summary>{content}</details>" if content else ""


def _by_level(title: str, of: Callable[[T, Protocol], Table], figures: T, study: Study) -> str:
    """Tables for each level, folded; "" where none has rows."""
    return _folded(title, "".join(map(_table, by_level(of, figures, study.levels))))


def _verdict(group: SetFigures, number: int) -> str:
    """The verdict on a set, and a table for each criterion."""
    items = [
        f'<li>“{escape(claim.claim)}”: <span class="finding">{escape(claim.finding)}</span>, {escape(claim.scenes)}'
        f'<span class="soft why">{escape(claim.why)}</span></li>'
        for claim in claims(group)
    ]
    if lost := losses(group):
        items.append(f"<li>Where we lose: {escape(lost)}</li>")
    tabs, panels = "", ""
    for place, criterion in enumerate(CRITERIA):
        tab, panel, found = f"tab-{number}-{place}", f"table-{number}-{place}", _table(method_table(group, criterion))
        tabs += f'<button role="tab" id="{tab}" aria-controls="{panel}">{capital(criterion.title)}</button>'
        panels += (
            f'<div id="{panel}" role="tabpanel" aria-labelledby="{tab}"><p class="soft">'
            f"{escape(capital(criterion.explanation))} The winner of each column is marked ★.</p>{found}</div>"
        )
    return (
        f'<h2>{escape(heading(group))}</h2><p class="headline">{escape(headline(group))}</p>{bullets(caveats(group), "caveats")}'
        f'<ul class="verdict">{"".join(items)}</ul>'
        + _folded("Beside the best rivals, by every figure", _table(standing_table(group)))
        + _folded(
            "Every method, by every figure",
            f'<div class="tabs" role="tablist" aria-label="Which error" hidden>{tabs}</div>{panels}',
        )
    )


def _noise_section(figures: Figures) -> str:
    plots = "".join(
        f"<h3>{escape(heading(group))}</h3>{noise_plots(group)}" + _by_level(KEPT, kept_table, group, figures.study)
        for group in figures.sets
    )
    said = "Lines are medians, bands reach from the 25 % to the 75 % quantile of all patches."
    return f"<h2>Quality and noise</h2><p>{said}</p>{plots}"


def _pattern_section(figures: Figures, exhibits: Sequence[Exhibit]) -> str:
    """Pictures of the patterns; for each set all figures, and where they differ most."""
    study = figures.study
    said = (
        f"{pattern_conditions(figures)} Figures are those of {methods()[study.ours or ''].title}. Worst colour is the chrominance "
        "that nine tenths of the patches reach, hue the share of pixels of wrong hue."
    )
    tables = "".join(_by_level(heading(group), pattern_table, group, study) for group in figures.sets)
    shown = f"<h3>{capital(WHY_PATTERNS)}</h3>{_exhibits(exhibits)}" if exhibits else ""
    cards = f'<div class="tiles">{"".join(_card(study, tile) for tile in study.tiles)}</div>'
    return f"<h2>Which pattern is best, and when?</h2><p>{escape(said)}</p>{cards}{tables}{shown}"


def _card(study: Study, tile: Tile) -> str:
    light = study.light(tile)
    collected = f"{light:.2f}× the light of a Bayer sensor" if light else "no scene has its colours"
    return (
        f'<figure class="tile">{_drawn(tile.pattern.tile)}<figcaption><b>{escape(tile.name)}</b><br>'
        f"{100 * tile.panchromatic_share:.0f} % W<br>{collected}</figcaption></figure>"
    )


def _gallery_section(exhibits: Sequence[Exhibit]) -> str:
    return (
        "<h2>Gallery</h2><p>Squares chosen by the figures, not by eye: where our best render gains most on the best "
        "rival of the scene, where it loses most, and where its error is largest. Choose two pictures, move the slider by finger, "
        "mouse or arrow keys, and zoom in to single pixels. Colours as a screen shows them; dark scenes are brightened, bright "
        "squares darkened.</p>" + _exhibits(exhibits)
    )


def _exhibits(exhibits: Sequence[Exhibit]) -> str:
    parts = []
    for level in dict.fromkeys(exhibit.crop.level for exhibit in exhibits):
        shown = "".join(_exhibit(each) for each in exhibits if each.crop.level == level)
        parts.append(f'<h3>{escape(capital(level.text))}</h3><div class="exhibits">{shown}</div>')
    return "".join(parts)


def _exhibit(exhibit: Exhibit) -> str:
    """Two pictures of one place under a slider, chosen from a strip of all."""
    crop, (left, right) = exhibit.crop, exhibit.shown
    changed = "brightened" if exhibit.stops > 0 else "darkened"
    where = f"{crop.why}; {crop.place}" + (f", {changed} by {abs(exhibit.stops):.1f} stops" if exhibit.stops else "")
    strip = "".join(
        f'<li{css_class("ours" * each.ours)}><button type="button" title="show on the right side"><img src="{_data(each)}" '
        f'alt="{escape(each.name)}" width="{crop.width}" height="{crop.height}">{escape(each.title)}</button></li>'
        for each in exhibit.pictures
    )
    return Template(_read("exhibit.html")).substitute(
        scene=escape(crop.scene.name),
        where=escape(where),
        width=crop.width,
        left=_options(exhibit.pictures, left),
        right=_options(exhibit.pictures, right),
        strip=strip,
    )


def _options(pictures: Iterable[Rendered], chosen: int) -> str:
    return "".join(
        f'<option value="{place}"{" selected" * (place == chosen)}>{escape(each.title)}</option>'
        for place, each in enumerate(pictures)
    )


def _data(picture: Rendered) -> str:
    from PIL import Image

    return data_address(Image.fromarray(picture.pixels), "PNG", optimize=True)


def _scenes_section(figures: Figures, failures: Sequence[str]) -> str:
    parts = [
        "<h2>Every scene</h2><p>Median PSNR of the scene's patches, dB: RGB / luminance / chrominance. Quantiles, whole-image "
        "PSNR, SSIM and wrong hues are in evaluation.csv and evaluation.json.</p>"
    ]
    for scene in figures.study.scenes:
        summary, group = f"{scene.name} ({scene.columns} × {scene.rows}, {scene.group})", figures.of(scene)
        content = _table(scene_table(group, scene.name)) if group else ""
        parts.append(f"<details><summary>{escape(summary)}</summary>{bullets(scene.notes, 'soft')}{content}</details>")
    if failures:
        parts.append(f"<h3>Left out</h3>{bullets(failures)}")
    return "\n".join(parts)


def _drawn(tile: Sequence[str]) -> str:
    """The picture of a tile."""
    light = np.array([[float(letter == "W") for letter in row] for row in tile])
    return f'<img src="data:image/png;base64,{b64encode(tile_map(tile, light)).decode()}" alt="{escape("/".join(tile))}">'
