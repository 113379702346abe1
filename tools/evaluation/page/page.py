"""The page: verdict, plots, gallery, all tables, in one HTML file that needs no network."""

import base64
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from io import BytesIO

from ..figures import Figures, title
from ..methods import methods
from ..metrics import BORDER, PATCH
from ..protocol import CROP
from ..verdict import capital, comparisons, heading, headline, losses
from .gallery import Exhibit, Picture
from .sections import noise_plots, period_section

_HERE = files("tools.evaluation.page")
_PLANE_TITLES = ("RGB", "luminance", "chrominance")


def page(figures: Figures, exhibits: Sequence[Exhibit], program: str, failures: Sequence[str]) -> str:
    """The HTML text."""
    sections = [("verdict", "Verdict", _verdict(figures)), ("noise", "Noise", noise_plots(figures))]
    if len(figures.study.periods) > 1 and figures.ours:
        sections.append(("period", "Period", period_section(figures)))
    if exhibits:
        sections.append(("gallery", "Gallery", _gallery(exhibits, figures)))
    sections += [("scenes", "Scenes", _scenes(figures, failures)), ("method", "How it was measured", _how(figures))]
    slider = _HERE / "vendor" / "img-comparison-slider"
    parts = {
        "css": _read("page.css") + (slider / "styles.css").read_text("utf-8"),
        "lede": _lede(figures),
        "navigation": " ".join(f'<a href="#{name}">{escape(label)}</a>' for name, label, _ in sections),
        "sections": "\n".join(f'<section id="{name}">{text}</section>' for name, _, text in sections),
        "program": escape(program),
        "slider_licence": (slider / "LICENSE").read_text("utf-8"),
        "slider": (slider / "index.js").read_text("utf-8"),
        "script": _read("page.js"),
    }
    text = _read("page.html")
    # In pieces, not by replacing one after the other: what is put in may hold braces of its own.
    pieces = text.split("{{")
    return pieces[0] + "".join(parts[name] + rest for name, rest in (piece.split("}}", 1) for piece in pieces[1:]))


def _read(name: str) -> str:
    return (_HERE / name).read_text("utf-8")


def _lede(figures: Figures) -> str:
    study = figures.study
    levels = ", ".join(study.protocol.describe(level) for level in study.levels)
    light = (
        "additive Gaussian noise on every sample, nothing clipped (the paper's protocol)"
        if study.protocol.kind == "paper"
        else "equal exposure time on equal pixels: shot and read noise, clipping, 12 bits"
    )
    count = len(study.scenes)
    return (
        f"{count} scene{'s' * (count != 1)}, photographed with a panchromatic sensor that has one Bayer block per {study.period} × "
        f"{study.period} pixels, and with a Bayer sensor under the same light; {escape(light)}; {escape(levels)}. "
        f"Quality is the PSNR of every {PATCH} × {PATCH} patch."
    )


def _verdict(figures: Figures) -> str:
    parts = []
    for index, group in enumerate(figures.groups):
        parts.append(f"<h2>{escape(heading(figures, group))}</h2>")
        parts.append(f'<p class="headline">{escape(headline(figures, group))}</p>')
        parts.append("".join(f"<p>{escape(sentence)}</p>" for sentence in comparisons(figures, group)))
        said = [
            f'<li>“{escape(claim.text)}”: <span class="finding">{escape(claim.finding)}</span>'
            f'<span class="soft why">{escape(claim.why)}</span></li>'
            for claim in figures.claims(group)
        ]
        lost = losses(figures, group)
        said += [f'<li>Where we lose<span class="soft why">{escape(lost)}</span></li>'] if lost else []
        parts.append(f'<ul class="verdict">{"".join(said)}</ul>')
        tabs = "".join(
            f'<button role="tab" id="tab-{index}-{plane}" aria-controls="table-{index}-{plane}">{capital(name)}</button>'
            for plane, name in enumerate(_PLANE_TITLES)
        )
        parts.append(f'<div class="tabs" role="tablist" aria-label="Which error" hidden>{tabs}</div>')
        for plane, name in enumerate(_PLANE_TITLES):
            label = f"tab-{index}-{plane}"
            parts.append(
                f'<div id="table-{index}-{plane}" role="tabpanel" aria-labelledby="{label}"><p class="soft">Median {name} PSNR of '
                f"all patches of the set, dB; higher is better. The winner of each column is marked ★.</p>"
                f"{_table(figures, group, plane)}</div>"
            )
    return "\n".join(parts)


def _table(figures: Figures, group: str, plane: int) -> str:
    study = figures.study
    head = "".join(f'<th scope="col">{escape(study.protocol.describe(level))}</th>' for level in study.levels)
    winners = {level: figures.winner(group, level, plane) for level in study.levels}
    rows = []
    for name in study.methods:
        cells = []
        for level in study.levels:
            figure = figures.pooled(group, level, name)
            text = f"{figure.quality.median[plane]:.1f}" if figure else "–"
            cells.append(f'<td class="win">★ {text}</td>' if name == winners[level] else f"<td>{text}</td>")
        kind = ' class="ours"' if methods()[name].ours else ""
        rows.append(f'<tr{kind}><th scope="row">{escape(title(name))}</th>{"".join(cells)}</tr>')
    margins = [figures.margin(group, level, plane) for level in study.levels]
    if figures.ours and any(margins):
        cells = [f'<td>{m[1]:+.1f}<span class="by">{escape(m[0])}</span></td>' if m else "<td>–</td>" for m in margins]
        rows.append(f'<tr class="margin"><th scope="row">{figures.ours} minus best rival</th>{"".join(cells)}</tr>')
    return _scrolling(f'<thead><tr><th scope="col">Method</th>{head}</tr></thead><tbody>{"".join(rows)}</tbody>')


def _gallery(exhibits: Sequence[Exhibit], figures: Figures) -> str:
    parts = [
        "<h2>Gallery</h2><p>Squares chosen by the figures, not by hand: where the best render of ours gains most on the best "
        "rival of the scene, where it loses most, and where its error is largest. Choose two pictures, move the slider by finger, "
        "mouse or arrow keys, and zoom in to single pixels. Colours as a screen shows them; dark scenes are brightened.</p>"
    ]
    for level in dict.fromkeys(exhibit.place.level for exhibit in exhibits):
        parts.append(f"<h3>{escape(capital(figures.study.protocol.describe(level)))}</h3>")
        shown = [_exhibit(each, figures) for each in exhibits if each.place.level == level]
        parts.append(f'<div class="exhibits">{"".join(shown)}</div>')
    return "\n".join(parts)


def _exhibit(exhibit: Exhibit, figures: Figures) -> str:
    place = exhibit.place
    rival = next((i for i, p in enumerate(exhibit.pictures) if p.method and not methods()[p.method].ours), 0)
    own = next((i for i, p in enumerate(exhibit.pictures) if p.method == figures.ours), 0)
    brighter = f", brightened by {exhibit.stops:.1f} stops" if exhibit.stops else ""
    where = f"{place.why}; row {place.row}, column {place.column}{brighter}"
    strip = "".join(
        f'<li{_kind(p)}><button type="button" title="show on the right side"><img src="{_data(p)}" alt="{escape(_name(p))}" '
        f'width="{place.width}" height="{place.height}">{escape(_caption(p))}</button></li>'
        for p in exhibit.pictures
    )
    return (
        f'<article class="exhibit"><h4>{escape(place.scene.name)}<span class="soft">{escape(where)}</span></h4>'
        f'<div class="viewer" data-script hidden data-pixels="{place.width}" style="--pixels:{place.width};--zoom:4">'
        '<img-comparison-slider><img slot="first" alt=""><img slot="second" alt=""></img-comparison-slider></div>'
        f'<div class="controls" data-script hidden><label>Left <select>{_options(exhibit.pictures, rival)}</select></label>'
        f"<label>Right <select>{_options(exhibit.pictures, own)}</select></label>"
        '<span class="zoom" role="group" aria-label="Zoom"><button type="button" value="-1" aria-label="smaller">−</button>'
        '<output>4×</output><button type="button" value="1" aria-label="larger">+</button></span></div>'
        f'<ul class="strip">{strip}</ul></article>'
    )


def _options(pictures: Sequence[Picture], chosen: int) -> str:
    return "".join(
        f'<option value="{index}"{" selected" * (index == chosen)}>{escape(_caption(picture))}</option>'
        for index, picture in enumerate(pictures)
    )


def _kind(picture: Picture) -> str:
    return ' class="ours"' if picture.method and methods()[picture.method].ours else ""


def _name(picture: Picture) -> str:
    if not picture.method:
        return "truth"
    method = methods()[picture.method]
    return method.title if method.ours else method.short


def _caption(picture: Picture) -> str:
    return f"{_name(picture)}, {picture.psnr:.1f} dB" if picture.psnr is not None else "truth"


def _data(picture: Picture) -> str:
    from PIL import Image

    buffer = BytesIO()
    Image.fromarray(picture.pixels).save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _scenes(figures: Figures, failures: Sequence[str]) -> str:
    study = figures.study
    parts = [
        "<h2>Every scene</h2><p>Median PSNR of the scene's patches, dB: RGB / luminance / chrominance. Quartiles, whole-image PSNR "
        "and SSIM are in evaluation.csv and evaluation.json.</p>"
    ]
    head = "".join(f'<th scope="col">{escape(study.protocol.describe(level))}</th>' for level in study.levels)
    for scene in study.scenes:
        rows = []
        for name in study.methods:
            found = [figures.of_scene(scene.name, level, name) for level in study.levels]
            best = [figures.best_of_scene(scene.name, level) for level in study.levels]
            cells = "".join(
                f"<td{_win(name == winner)}>{' / '.join(f'{value:.1f}' for value in figure.quality.median) if figure else '–'}</td>"
                for figure, winner in zip(found, best, strict=True)
            )
            kind = ' class="ours"' if methods()[name].ours else ""
            rows.append(f'<tr{kind}><th scope="row">{escape(title(name))}</th>{cells}</tr>')
        notes = "".join(f"<li>{escape(note)}</li>" for note in scene.notes)
        summary = f"{scene.name} ({scene.columns} × {scene.rows}, {scene.group})"
        table = _scrolling(f'<thead><tr><th scope="col">Method</th>{head}</tr></thead><tbody>{"".join(rows)}</tbody>')
        parts.append(
            f"<details><summary>{escape(summary)}</summary>{f'<ul class=soft>{notes}</ul>' if notes else ''}{table}</details>"
        )
    if failures:
        lines = "".join(f"<li>{escape(line)}</li>" for line in failures)
        parts.append(f"<h3>Left out</h3><ul>{lines}</ul>")
    return "\n".join(parts)


def _how(figures: Figures) -> str:
    study = figures.study
    entries = {
        "Patches": f"all overlapping {PATCH} × {PATCH} squares at least {BORDER} pixels inside the frame; 10 log10(1 / MSE), "
        "intensities in scene units (1 = the white level of the scene's source); luminance is the mean of the channels, "
        "chrominance the rest; pooled over all patches of a set, as in Fig. 3 of the paper",
        "Frames": f"cut to whole multiples of {CROP} pixels before sampling",
        "Noise": f"seed {study.protocol.seed}, the same scene light for every camera; {study.protocol.conditions}",
        "Sets": "what sensors measured is pooled; developed 8-bit pictures (Kodak, McMaster, others) are linearised and reported "
        "apart, for they were interpolated and sharpened before",
        "Rivals": "get samples with a pedestal, so that no noise is clipped; LibRaw's methods and those called balanced get "
        "white-balanced samples, as raw developers do; BM3D (package bm3d, for non-commercial use only) denoises each of the four "
        "planes and is told the noise",
        "Whole image": f"PSNR and SSIM (Wang 2004, mean of the channels) leave out the same {BORDER} pixels; of a set, the mean of "
        "its scenes",
    }
    listed = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}.</dd>" for name, text in entries.items())
    names = "".join(f"<dt>{escape(name)}</dt><dd>{escape(title(name))}</dd>" for name in study.methods)
    return f"<h2>How it was measured</h2><dl>{listed}</dl><h3>Names in the tables</h3><dl>{names}</dl>"


def _win(wins: bool) -> str:
    return ' class="win"' if wins else ""


def _scrolling(rows: str) -> str:
    return f'<div class="scroll" tabindex="0" role="region" aria-label="table"><table>{rows}</table></div>'
