"""The report on a burst, an HTML page: the picture beside one frame's, where they differ most, what was merged, how frames lie."""

from collections.abc import Iterable, Iterator, Sequence
from math import degrees, log2
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shared import Mosaic
from shared.arrays import ByteArray, FloatArray
from tools.pictures.display import ColourTransform
from tools.pictures.html import cell, figure, picture, reduced, report, row, row_title, table, without_folders
from tools.pictures.plot import Plot, round_step, ticks
from tools.pictures.samples import Sample, display_codes, upright

from .burst_files import BurstFile

if TYPE_CHECKING:
    from PIL.Image import Image

CELL = 96
"""Pixels, each way, of a place to look at."""
_STYLE = Path(__file__).with_name("burst_report.css")
_PLACES, _ENLARGED = 4, 4
_ALONE = 0.97  # of the variance of one frame: from there on it is one frame
_ONE, _ALL = np.array((232, 93, 4), np.float32), np.array((10, 77, 104), np.float32)  # colours of the map, as in page.html
_HEAD = ("", "", "right", "down", "degrees", "parallax", "exposure, EV", "agrees", "sharpness", "error")
_SEEN = 0.35  # share of the picture in the map
_SIZE, _MARGINS = (420, 420), (58, 16, 16, 48)


class Shown:
    """A rendering in sRGB, 8 bits, taken while its bands go by: 3 bytes per pixel.

    mosaic: its shot.
    exposure: gain, stops.
    Raises InputError if nothing is known of the sensor's colours.
    """

    def __init__(self, mosaic: Mosaic, exposure: float) -> None:
        self._colours = ColourTransform.to_space(mosaic.calibration)
        self._channels = len(mosaic.pattern.channels)
        self._exposure, self._orientation = exposure, mosaic.metadata.orientation
        self._codes = np.empty((*mosaic.shape, 3), np.uint8)

    def taken(self, bands: Iterable[FloatArray]) -> Iterator[FloatArray]:
        """Yield the bands of the rendering, from top to bottom, as they are."""
        top = 0
        for band in bands:
            picture = band[..., : self._channels]  # without what it may state behind them
            self._codes[top : top + len(band)] = display_codes(picture, self._colours, 8, self._exposure)
            top += len(band)
            yield band

    @property
    def picture(self) -> ByteArray:
        """The picture, uint8 (H, W, 3), upright."""
        return self.upright(self._codes)

    def upright(self, plane: NDArray[Sample]) -> NDArray[Sample]:
        """A plane of the sensor (H, W, ...), turned like the picture."""
        return upright(plane, self._orientation)


def page(frames: Sequence[BurstFile], reference: int, shares: FloatArray | None, alone: Shown, merged: Shown) -> bytes:
    """Return the page as HTML.

    frames: all files, and what became of them.
    reference: index of the frame that the picture shows.
    shares: (H, W), noise variance of the merged luminance relative to the reference's, 1 = the reference alone; None = no burst.
    alone: the reference, rendered.
    merged: the burst, rendered.
    """
    used = [frame for frame in frames if not frame.reason]
    refused = [without_folders(frame.line, [each.name for each in frames]) for frame in frames if frame.reason]
    tone = "bad" if len(used) < 2 else "care" if refused else "good"
    sections = {"One frame, and the burst": _beside(alone.picture, merged.picture)}
    facts: list[str] = []
    if shares is not None and len(used) > 1:
        share = float((shares > _ALONE).mean())
        facts = [
            f"Noise of luminance, in the median of the picture: {float(np.median(shares)) ** 0.5:.2f} times that of one frame.",
            f"{100 * share:.1f} % of the picture comes from the reference alone, because nothing else agrees with it there.",
        ]
        sections["Where frames were merged"] = _map(shares, merged, len(used))
    if len(places := _places(frames)) > 1:
        caption = "Where the scene lies in each frame, compared with the reference (blue); red: left out."
        sections["Motion"] = figure(_shift_plot(frames, reference, places), caption)
    sections["Frames"] = _table(frames, reference)
    name = Path(frames[reference].name).name
    return report(
        f"Burst of {len(frames)} frames",
        f"The picture shows what {name} shows.",
        f"{len(used)} of {len(frames)} frames are in the picture",
        tone,
        sections,
        facts=facts,
        remarks=refused,
        css=_STYLE.read_text("utf-8"),
    )


def _beside(alone: ByteArray, merged: ByteArray) -> str:
    """Both pictures, and the places where they differ most."""
    places = most_different(alone, merged, _PLACES)
    marked = [_marked(pixels, places) for pixels in (alone, merged)]
    names = "One frame", "The burst"
    whole = "".join(_figure(image, name) for name, image in zip(names, marked, strict=True))
    parts = []
    for number, (top, left) in enumerate(places, 1):
        twins = []
        for name, pixels in zip(names, (alone, merged), strict=True):
            part = reduced(pixels[top : top + CELL, left : left + CELL])
            part = part.resize((_ENLARGED * part.width, _ENLARGED * part.height), 0)  # pixels as squares
            twins.append(_figure(part, f"{name}, place {number}: row {top}, column {left}"))
        parts.append(f'<div class="twins">{"".join(twins)}</div>')
    most = f"<p>Where they differ most, {_ENLARGED} times enlarged:</p>" if parts else "<p>They are the same.</p>"
    return f'<div class="pair">{whole}</div>{most}<div class="pair">{"".join(parts)}</div>'


def _marked(pixels: ByteArray, places: Sequence[tuple[int, int]]) -> "Image":
    """A picture of the page's width with numbered frames around places."""
    from PIL import ImageDraw, ImageFont

    image = reduced(pixels)
    scale = image.width / pixels.shape[1]
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(max(14, image.width / 40))
    for number, (top, left) in enumerate(places, 1):
        box = [round(scale * side) for side in (left, top, left + CELL, top + CELL)]
        draw.rectangle(box, outline=(0, 0, 0), width=4)
        draw.rectangle([box[0] + 1, box[1] + 1, box[2] - 1, box[3] - 1], outline=(255, 255, 255), width=2)
        draw.text((box[0] + 7, box[1] + 4), str(number), (255, 255, 255), font, stroke_width=2, stroke_fill=(0, 0, 0))
    return image


def _map(shares: FloatArray, merged: Shown, frames: int) -> str:
    """The picture in grey, coloured by how many frames were merged."""
    number = 1 / merged.upright(shares).clip(1 / frames, 1)[..., None]
    many = (number - 1) / (frames - 1)
    grey = merged.picture.mean(axis=2, dtype=np.float32)[..., None]
    coloured = (1 - _SEEN) * (_ONE + (_ALL - _ONE) * many) + _SEEN * grey
    legend = f'<div class="legend"><span>1 frame</span><i></i><span>{frames} frames</span></div>'
    caption = "By the noise that is left. Where things moved, were hidden, or lie outside the other frames, the reference is alone."
    return f'<div class="map">{legend}{_figure(reduced(coloured.astype(np.uint8)), caption)}</div>'


def _table(frames: Sequence[BurstFile], reference: int) -> str:
    """What is known of each frame."""
    rows = []
    for index, frame in enumerate(frames):
        title = f"{index + 1}  {Path(frame.name).name}"
        what = "reference" if index == reference else "left out" if frame.reason else "merged"
        cells = [row_title(title), cell(what)]
        judged = frame.judged
        if judged is not None and judged.motion is not None:
            down, right = judged.motion.shift
            parallax = "" if judged.motion.local is None else f"{np.hypot(*np.moveaxis(judged.motion.local, -1, 0)).max():.1f}"
            figures = [
                f"{right:+.2f}",
                f"{down:+.2f}",
                f"{degrees(judged.motion.angle):+.3f}",
                parallax,
                f"{round(log2(judged.gain), 2) + 0.0:+.2f}",
            ]
            figures += [f"{100 * judged.agreement:.0f} %", f"{judged.sharpness:.2f}", f"{judged.error:.3f}"]
            cells += map(cell, figures)
        cells += [cell("")] * (len(_HEAD) - len(cells))
        rows.append(row(cells, "out" if frame.reason else ""))
    note = "Right, down, parallax (the largest local shift) and error are in pixels. Agrees: the part of the frame that was merged."
    return table(_HEAD, rows) + f'<p class="made">{note}</p>'


def _figure(image: "Image", caption: str) -> str:
    return figure(picture(image, caption), caption)


def _shift_plot(frames: Sequence[BurstFile], reference: int, places: Sequence[tuple[int, float, float]]) -> str:
    """A plot of where the scene lies in each frame, compared with the reference, in the order of the frames."""
    reach = 1.15 * max(0.5, *(abs(figure) for _, *place in places for figure in place))
    plot = Plot((-reach, reach), (reach, -reach), _SIZE, _MARGINS)
    steps = ticks((-reach, reach), round_step(2 * reach, 8))
    plot.columns(steps)
    plot.rows(steps)
    plot.name_axes("pixels to the right", "pixels down")
    plot.line([(right, down) for _, right, down in places], "path")
    for index, right, down in places:
        text = f"frame {index + 1}: {right:+.2f} pixels to the right, {down:+.2f} down"
        style = "fill:var(--mark)" if index == reference else "" if not frames[index].reason else "fill:var(--bad)"
        plot.dot(right, down, 6 if index == reference else 4.5, text, style)
        x, y = plot.at(right, down)
        plot.text(x + 8, y - 7, str(index + 1), "start")
    return plot.drawn("Shift of each frame")


def _places(frames: Sequence[BurstFile]) -> list[tuple[int, float, float]]:
    """(index, right, down) of the frames whose motion is known."""
    motions = [(index, frame.judged.motion) for index, frame in enumerate(frames) if frame.judged is not None]
    return [(index, motion.shift[1], motion.shift[0]) for index, motion in motions if motion is not None]


def most_different(one: ByteArray, other: ByteArray, count: int) -> list[tuple[int, int]]:
    """The places, at most `count`, at which two pictures uint8 (H, W, 3) differ most: (row, column) of their first pixels.

    >>> one, other = np.zeros((2, 200, 300, 3), np.uint8)
    >>> other[110:120, 150:160] = 255
    >>> most_different(one, other, 1)
    [(48, 96)]
    """
    return _highest(_cells(np.square(one.astype(np.float32) - other).sum(axis=2)), one.shape, count)


def _cells(plane: FloatArray) -> FloatArray:
    """Means of a plane over cells of half the size of a place, those at the border smaller."""
    half = CELL // 2
    starts = [np.arange(0, size, half) for size in plane.shape]
    sums = np.add.reduceat(np.add.reduceat(plane, starts[0], axis=0), starts[1], axis=1)
    return (sums / half**2).astype(np.float32)


def _highest(cells: FloatArray, shape: tuple[int, ...], count: int) -> list[tuple[int, int]]:
    """The places with the largest sums of 2 x 2 cells, which do not overlap."""
    around = np.pad(cells, ((0, 1), (0, 1)))
    sums = around[:-1, :-1] + around[1:, :-1] + around[:-1, 1:] + around[1:, 1:]
    found: list[tuple[int, int]] = []
    while len(found) < count and sums.max() > 0:
        row, column = (int(each) for each in np.unravel_index(np.argmax(sums), sums.shape))
        sums[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] = 0
        found.append((min(row * CELL // 2, max(shape[0] - CELL, 0)), min(column * CELL // 2, max(shape[1] - CELL, 0))))
    return found
