"""design.html: the best tiles drawn, light against luminance against colour, fast and slow judge side by side, and crops."""

from collections.abc import Sequence
from html import escape

import numpy as np

from tools.pictures.html import cell, data_address, figure, report, row, row_title, table
from tools.pictures.illustrations import tile_picture
from tools.pictures.plot import Plot, round_step, ticks

from ..page.gallery import WHY_PATTERNS, Exhibit
from .judge import Figures
from .proposals import Proposal, front, spearman

_SIZE, _MARGINS = (720, 420), (58, 16, 16, 46)
_MOST_DOTS, _ROWS = 3000, 12
_CSS = """
.tiles { display: flex; flex-wrap: wrap; gap: 18px } .tiles figure { width: 150px } .tiles svg { width: 112px; margin-bottom: 6px }
.tiles rect { stroke: #8a8b92; stroke-width: .5 } .tiles svg text { fill: #fff; font-size: 8px; text-anchor: middle }
code { overflow-wrap: anywhere; font-size: 12px; user-select: all } .plot .point { stroke: var(--card); stroke-width: .7 }
.crops { display: flex; flex-wrap: wrap; gap: 10px } .crops img { width: 192px; image-rendering: pixelated }
.crops figcaption { width: 192px; overflow-wrap: anywhere } td.win { font-weight: 700 }
"""


def page(
    shown: Sequence[Proposal],
    every: Sequence[Proposal],
    lights: Sequence[str],
    photographs: int,
    exhibits: Sequence[Exhibit],
    facts: Sequence[str],
    program: str,
) -> bytes:
    """Return the content of the page's file.

    shown: the best tiles, the best first, and known ones beside them.
    every: all tiles that were judged, the best first.
    lights: their names.
    photographs: number of those on which the slow judge measured the tiles; 0 = it did not.
    exhibits: crops.
    facts: sentences about the search.
    """
    first = shown[0]
    sections = {
        "Tiles": f'<p>Numbers are ranks for the fast judge.</p><div class="tiles">{"".join(map(_card, shown))}</div>',
        "Light, luminance and colour": _front_section(every[:_MOST_DOTS], shown),
        "Fast judge": _fast_table(shown, lights),
        "Fast and slow judge": _both(shown, lights, photographs) if photographs else "",
        "Crops": "".join(_crops(each) for each in exhibits if each.crop.why == WHY_PATTERNS),
    }
    verdict = f"{first.letters} is the best tile {'on these photographs' if photographs else 'for the fast judge'}"
    tone = "good" if photographs else "care"
    return report("Which filter tile?", f"Made by {program}.", verdict, tone, sections, facts=facts, remarks=(), css=_CSS)


def _card(each: Proposal) -> str:
    return (
        f"<figure>{tile_picture(each.tile)}<figcaption><b>{escape(each.name)}</b><br>"
        f"{each.light:.2f}× the light of a Bayer sensor<br>score {each.score:.2f} dB<br>"
        f"<code>{escape(each.letters)}</code></figcaption></figure>"
    )


def _front_section(every: Sequence[Proposal], shown: Sequence[Proposal]) -> str:
    """All tiles by luminance and colour, the brighter, the more light; those of the front are larger."""
    known = {each.letters: each for each in (*every, *shown)}
    dots = sorted(known.values(), key=lambda each: each.light)
    best = front(dots)
    values = np.array([(each.mean.luminance, each.mean.colour) for each in dots])
    low, high = values[best].min(axis=0) - 0.5, values.max(axis=0) + 0.3
    across, up = ((float(first), float(last)) for first, last in zip(low, high, strict=True))
    plot = Plot(across, up, _SIZE, _MARGINS)
    plot.columns(ticks(across, round_step(across[1] - across[0], 8)))
    plot.rows(ticks(up, round_step(up[1] - up[0], 6)))
    plot.name_axes("luminance, dB", "colour, dB")
    for each, chosen, (luminance, colour) in zip(dots, best, values, strict=True):
        if (low <= (luminance, colour)).all():
            text = f"{each.name or each.letters}: light {each.light:.2f}, luminance {luminance:.2f} dB, colour {colour:.2f} dB"
            fill = f"fill:hsl({40 + 200 * min(3 - each.light, 1):.0f} 75% 50%)"
            plot.dot(luminance, colour, 6 if chosen else 3, text, fill + ("" if chosen else ";opacity:.45"))
    for each in shown:
        if (low <= each.mean[:2]).all():
            x, y = plot.at(*each.mean[:2])
            plot.text(x, y - 9, each.name)
    said = (
        "Each dot is a tile, the mean over the lights. Large dots are the front: no tile has more of light, luminance and colour. "
        "Yellow dots collect most light, blue ones least."
    )
    drawn = plot.drawn("luminance and colour of all tiles that were judged")
    ends = [each for each, chosen in zip(dots, best, strict=True) if chosen]
    rows = [
        row([cell(f"{value:.2f}") for value in (each.light, *each.mean[:2])] + [cell(each.letters)])
        for each in ends[:: -(-len(ends) // _ROWS)]
    ]
    return figure(drawn, said) + table(("light", "luminance, dB", "colour, dB", "of the front"), rows)


def _fast_table(shown: Sequence[Proposal], lights: Sequence[str]) -> str:
    """The figures of every light."""
    head = ["", "light", *(f"{light}: {name}" for light in lights for name in Figures._fields)]
    figures = np.array([np.concatenate(each.figures) for each in shown])
    rows = []
    for each, values, best in zip(shown, figures.tolist(), (figures >= figures.max(axis=0) - 0.005).tolist(), strict=True):
        cells = [cell(f"{value:.2f}", best=mark) for value, mark in zip(values, best, strict=True)]
        rows.append(row([row_title(each.name), cell(f"{each.light:.2f}"), *cells]))
    return "<p>Expected PSNR, dB.</p>" + table(head, rows)


def _both(shown: Sequence[Proposal], lights: Sequence[str], photographs: int) -> str:
    """What both judges say, for each light, and how well they agree."""
    said = (
        f"The fast judge expects what the slow one measures on renders of {photographs} photographs (PSNR; worst: the tenth of the "
        "patches with the worst colour). Differences between tiles count."
    )
    parts = [f"<p>{said}</p>"]
    for place, text in enumerate(lights):
        fast, slow = [each.figures[place] for each in shown], [each.slow[place] for each in shown]
        rows = [
            row([row_title(each.name), *(cell(f"{one:.2f} | {other:.2f}") for one, other in zip(*pair, strict=True))])
            for each, *pair in zip(shown, fast, slow, strict=True)
        ]
        agreement = (spearman(*columns) for columns in zip(zip(*fast, strict=True), zip(*slow, strict=True), strict=True))
        rows.append(row([row_title("rank correlation"), *(cell(f"{value:.2f}") for value in agreement)]))
        parts.append(f"<h3>{escape(text)}</h3>" + table(("fast | slow, dB", *Figures._fields), rows))
    return "".join(parts)


def _crops(each: Exhibit) -> str:
    from PIL import Image

    pictures = "".join(
        figure(f'<img src="{data_address(Image.fromarray(one.pixels), "PNG")}" alt="{escape(one.name)}">', one.title)
        for one in each.pictures
    )
    return f'<h3>{escape(each.crop.scene.name)}, {escape(each.crop.level.text)}</h3><div class="crops">{pictures}</div>'
