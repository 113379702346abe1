"""An exhibit of the gallery as HTML: two pictures of one place under a slider, chosen from a strip of all."""

from collections.abc import Sequence
from html import escape

from tools.pictures.html import css_class, data_address

from ..methods import methods
from .gallery import Exhibit, Rendered


def exhibit_html(exhibit: Exhibit, left: int, right: int) -> str:
    """The article of an exhibit. left, right: places of the pictures that are shown at first."""
    crop = exhibit.crop
    brighter = f", brightened by {exhibit.stops:.1f} stops" if exhibit.stops else ""
    where = f"{crop.why}; row {crop.row}, column {crop.column}{brighter}"
    strip = "".join(
        f'<li{css_class("ours" * is_ours(p))}><button type="button" title="show on the right side"><img src="{_data(p)}" '
        f'alt="{escape(_name(p))}" width="{crop.width}" height="{crop.height}">{escape(_caption(p))}</button></li>'
        for p in exhibit.pictures
    )
    return (
        f'<article class="exhibit"><h4>{escape(crop.scene.name)}<span class="soft">{escape(where)}</span></h4>'
        f'<div class="viewer" data-script hidden data-pixels="{crop.width}" style="--pixels:{crop.width};--zoom:4">'
        '<img-comparison-slider><img slot="first" alt=""><img slot="second" alt=""></img-comparison-slider></div>'
        f'<div class="controls" data-script hidden><label>Left <select>{_options(exhibit.pictures, left)}</select></label>'
        f"<label>Right <select>{_options(exhibit.pictures, right)}</select></label>"
        '<span class="zoom" role="group" aria-label="Zoom"><button type="button" value="-1" aria-label="smaller">−</button>'
        '<output>4×</output><button type="button" value="1" aria-label="larger">+</button></span></div>'
        f'<ul class="strip">{strip}</ul></article>'
    )


def is_ours(picture: Rendered) -> bool:
    """Whether a picture is to be told apart as ours; where only patterns differ, none is."""
    return bool(picture.method) and not picture.pattern and methods()[picture.method].ours


def _options(pictures: Sequence[Rendered], chosen: int) -> str:
    return "".join(
        f'<option value="{index}"{" selected" * (index == chosen)}>{escape(_caption(picture))}</option>'
        for index, picture in enumerate(pictures)
    )


def _name(picture: Rendered) -> str:
    if not picture.method:
        return "truth"
    method = methods()[picture.method]
    return picture.pattern or (method.title if method.ours else method.short)


def _caption(picture: Rendered) -> str:
    return f"{_name(picture)}, {picture.psnr:.1f} dB" if picture.psnr is not None else "truth"


def _data(picture: Rendered) -> str:
    from PIL import Image

    return data_address(Image.fromarray(picture.pixels), "PNG", optimize=True)
