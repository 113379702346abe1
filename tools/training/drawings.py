"""Drawn scenes to learn from: what photographs show too rarely. Strokes, letters, saturated
colours, edges without luminance, pages of print, signs that shine at night.
"""

from functools import cache
from pathlib import Path

import numpy as np

from ...shared.arrays import FloatArray, IndexArray
from ..simulation.drawn.dead_leaves import dead_leaves

SIZE = 384
_FINE = 3  # samples per pixel and axis
_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789&%?"
_WORDS = (
    "sphinx of black quartz judge my vow pack box with five dozen liquor jugs how vexingly quick "
    "daft zebras jump The Quick BROWN Fox 1984 3.14 lazy dogs & 42% waltz nymph for bad"
)
_TYPE = (0.8, 1.5)  # pixels: decimal logarithms of the least and largest size of type on a page
_MARKS = 90  # on a drawing, on average
_DOCUMENTS = 0.4  # share of drawings that are mostly black on white
# of equal gamma weights: what "without luminance" means to the sensor
_LUMINANCE = np.array([1.0, 1.0, 1.0]) / 3
_DARKEST = 0.004
_PANELS = 1.5  # rectangles of a colour under what is printed, on average
_MARKED, _RULED = 0.15, 0.15  # share of words on a colour of their own, of rules below paragraphs
_LAMPS, _NIGHT = 40, (1.0, 7.0)  # in a scene, on average; stops by which the rest is darker
_SHINING = (-0.7, 1.0)  # their brightness, powers of ten
_PAGES = (0.3, 0.35, 0.15, 0.1, 0.1)  # share of the kinds of pages, in their order below


def drawing(random: np.random.Generator) -> FloatArray:
    """A scene, float32 (SIZE, SIZE, 3), 0 to 1: marks of all kinds on paper, on leaves, on a
    gradient, or on one colour.
    """
    from PIL import Image, ImageDraw

    if random.random() < _DOCUMENTS:
        ground = np.broadcast_to(np.float32(random.uniform(0.6, 0.95)), (SIZE, SIZE, 3)).copy()
        black = np.full(3, random.uniform(0.008, 0.05), np.float32)
        palette = [black, black, *(colour(random) for _ in range(random.integers(1, 4)))]
    else:
        ground = _ground(random)
        palette = [colour(random) for _ in range(random.integers(2, 9))]
    marks = [_mark(random) for _ in range(random.poisson(_MARKS))]
    inks = [_ink(random, palette, ground) for _ in marks]
    # Numbers of marks are drawn instead of inks: pictures of 8 bits have too few dark tones, and
    # floats would be drawn three times.
    numbers = Image.new("I", (SIZE * _FINE, SIZE * _FINE))
    pen = ImageDraw.Draw(numbers)
    pen.fontmode = "1"
    for number, (kind, arguments) in enumerate(marks):
        getattr(pen, kind)(**arguments, fill=number + 1)
    return _inked(np.asarray(numbers), np.array(inks, np.float32).reshape(-1, 3), ground)


def page(random: np.random.Generator) -> FloatArray:
    """A page of print, float32 (SIZE, SIZE, 3), 0 to 1: lines of words of several fonts and sizes,
    black or coloured, on light paper or on dark, or shining in the dark; some words are marked, and
    some stand on panels.
    """
    from PIL import Image, ImageDraw, ImageFont
    from scipy.ndimage import gaussian_filter

    tint = np.clip(1 + random.normal(0, 0.05, 3), 0.8, 1.2).astype(np.float32)
    paper = tint * np.float32(random.uniform(0.5, 0.95))
    black = np.full(3, random.uniform(0.008, 0.08), np.float32)
    kind = random.choice(["black", "mixed", "coloured", "reversed", "shining"], p=_PAGES)
    inks = [colour(random) for _ in range(random.integers(1, 5))]
    if kind == "black":
        inks = [black]
    elif kind == "mixed":
        inks += [black] * int(random.integers(1, 6))
    elif kind in ("reversed", "shining"):
        paper, inks = black, [tint * np.float32(random.uniform(0.5, 0.95)), *inks]
        if random.random() < 0.5:
            paper = colour(random) * np.float32(random.uniform(0.1, 0.6))
    fine, top = SIZE * _FINE, float(random.uniform(-20, 20))
    numbers = Image.new("I", (fine, fine))
    pen = ImageDraw.Draw(numbers)
    pen.fontmode = "1"
    words, by_word = _WORDS.split(), bool(random.random() < 0.5)
    grounds = [*inks, *(colour(random) for _ in range(random.integers(1, 4)))]
    for _ in range(random.poisson(_PANELS)):
        place = random.uniform(-0.2, 1, 2)
        shape = [*place * fine, *(place + random.uniform(0.02, 0.6, 2)) * fine]
        pen.rectangle(shape, fill=int(random.integers(len(grounds))) + 1)
    marked = random.choice([0, _MARKED], p=[0.6, 0.4])
    while top < fine:
        size = _FINE * 10 ** random.uniform(*_TYPE)
        font = ImageFont.truetype(random.choice(_fonts()), size)
        pitch = size * random.uniform(1.1, 1.6)
        for _ in range(int(random.integers(1, 7))):
            left, ink = float(random.uniform(-60, 60)), int(random.integers(len(inks)))
            while left < fine:
                word = random.choice(words)
                ink = int(random.integers(len(inks))) if by_word else ink
                if random.random() < marked:
                    right, behind = left + font.getlength(word + " "), random.integers(len(grounds))
                    pen.rectangle([left, top, right, top + pitch], fill=int(behind) + 1)
                pen.text((left, top), word, fill=ink + 1, font=font)
                left += font.getlength(word + " ")
            top += pitch
        if random.random() < _RULED:
            thick = _FINE * 10 ** random.uniform(-0.3, 0.7)
            pen.rectangle([0, top, fine, top + thick], fill=int(random.integers(len(grounds))) + 1)
            top += thick
        top += size * random.uniform(0, 1.5)
    ground = np.broadcast_to(np.asarray(paper, np.float32), (SIZE, SIZE, 3))
    scene = _inked(np.asarray(numbers), np.array(grounds, np.float32), ground)
    if kind == "shining":
        width = random.uniform(2, 8)
        scene = scene + random.uniform(0.1, 0.6) * gaussian_filter(scene, (width, width, 0))
    return np.asarray(scene, np.float32)


def with_lamps(scene: FloatArray, random: np.random.Generator) -> FloatArray:
    """A scene, (H, W, 3), at night, with small lamps of many colours."""
    down, across = np.mgrid[0 : scene.shape[0], 0 : scene.shape[1]]
    night = scene * np.float32(2 ** -random.uniform(*_NIGHT))
    for _ in range(random.poisson(_LAMPS)):
        row, column = random.uniform(0, scene.shape[:2])
        radius = 10 ** random.uniform(-0.3, 0.7)
        near = np.s_[max(int(row - radius) - 1, 0) : int(row + radius) + 3]
        beside = np.s_[max(int(column - radius) - 1, 0) : int(column + radius) + 3]
        apart = np.hypot(down[near, beside] - row, across[near, beside] - column)
        share = (radius + 0.5 - apart).clip(0, 1)[..., None]
        lamp = colour(random)
        lamp *= np.float32(10 ** random.uniform(*_SHINING) / lamp.max())
        night[near, beside] = night[near, beside] * (1 - share) + lamp * share
    return night


def _inked(numbers: IndexArray, inks: FloatArray, ground: FloatArray) -> FloatArray:
    """Marks, by number from 1 on, in their inks on a ground, with `_FINE` samples per pixel."""
    sums, table = np.zeros((SIZE, SIZE, 3), np.float32), np.concatenate([np.zeros((1, 3)), inks])
    for down, across in np.ndindex(_FINE, _FINE):
        marked = numbers[down::_FINE, across::_FINE]
        sums += np.where((marked > 0)[..., None], table[marked], ground)
    return sums / np.float32(_FINE**2)


@cache
def _fonts() -> list[str]:
    """Files of the fonts of letters that Matplotlib brings."""
    import matplotlib

    folder = Path(matplotlib.get_data_path(), "fonts", "ttf")
    names = "DejaVuSans*", "DejaVuSerif*", "STIXGeneral*", "cmr10*", "cmss10*", "cmtt10*"
    return [str(path) for name in names for path in sorted(folder.glob(f"{name}.ttf"))]


def colour(random: np.random.Generator) -> FloatArray:
    """A colour, float32 (3,), 0 to 1: one in three is grey, one in three saturated."""
    light, kind = 10 ** random.uniform(-1.6, 0), random.integers(3)
    if kind == 0:
        return np.full(3, light, np.float32)
    weight = random.uniform(0, 1, 3) ** (3 if kind == 1 else 1)
    return np.maximum(light * weight / weight.max(), _DARKEST).astype(np.float32)


def _ground(random: np.random.Generator) -> FloatArray:
    kind = random.integers(3)
    if kind == 0:
        scale, seed = SIZE * random.uniform(0.5, 2), int(random.integers(1 << 30))
        leaves = dead_leaves(SIZE, SIZE, scale, seed)
        mixing = np.eye(3) + random.normal(0, 0.25, (3, 3))
        return (leaves @ np.abs(mixing)).clip(_DARKEST, 1).astype(np.float32)
    first, last = colour(random), colour(random) if kind == 1 else None
    if last is None:
        return np.broadcast_to(first, (SIZE, SIZE, 3)).copy()
    angle = random.uniform(0, 2 * np.pi)
    down, across = np.mgrid[0:SIZE, 0:SIZE] / SIZE - 0.5
    share = (np.cos(angle) * across + np.sin(angle) * down + 0.5).clip(0, 1)[..., None]
    return (first * (1 - share) + last * share).astype(np.float32)


def _ink(random: np.random.Generator, palette: list[FloatArray], ground: FloatArray) -> FloatArray:
    ink = palette[random.integers(len(palette))]
    if random.random() < 0.25:  # as bright as some place of the ground
        here = ground[tuple(random.integers(SIZE, size=2))]
        ink = (ink * (here @ _LUMINANCE) / (ink @ _LUMINANCE)).clip(_DARKEST, 1).astype(np.float32)
    return ink


def _mark(random: np.random.Generator) -> tuple[str, dict[str, object]]:
    """The name of a method of Pillow's pen, and its arguments but the ink."""
    from PIL import ImageFont

    fine = SIZE * _FINE
    place = random.uniform(0, fine, 2)
    kinds = ["line", "text", "ellipse", "rectangle", "polygon"]
    kind = random.choice(kinds, p=[0.35, 0.3, 0.15, 0.1, 0.1])
    if kind == "text":
        count = random.integers(1, 12)
        font = ImageFont.load_default(float(_FINE * 10 ** random.uniform(0.75, 1.7)))
        text = "".join(random.choice(list(_LETTERS), count))
        return "text", {"xy": tuple(place), "text": text, "font": font}
    length = fine * 10 ** random.uniform(-2.2, -0.2)
    if kind == "line":
        width = max(round(_FINE * 10 ** random.uniform(-0.3, 1.1)), 1)
        return "line", {"xy": [*place, *(place + random.normal(0, length, 2))], "width": width}
    if kind == "polygon":
        corners = place + random.normal(0, length / 2, (random.integers(3, 7), 2))
        return "polygon", {"xy": corners.ravel().tolist()}
    return str(kind), {"xy": [*place, *(place + length * random.uniform(0.2, 1, 2))]}
