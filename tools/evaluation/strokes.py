"""How much colour a method keeps in narrow strokes on white: letters of a logo, lines of a drawing. Medians of photographs hide it.

The scene is drawn, once for a study: diagonal strokes of one colour on white, each panel with one colour and one width. Of the
colour (the channels minus their mean) that a method shows inside the strokes, at least two pixels from their edges, the part
that lies along the true one is measured: 1 = all of it, 0 = grey.
"""

import json
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from shared.arrays import FloatArray, IndexArray
from shared.errors import InputError, PanchromaError
from tools.camera.protocols import Protocol
from tools.scenes.scene import RGB

from .cameras import CameraPair
from .method import Method
from .methods import choose, method_of, methods
from .metrics import BORDER
from .study import FOLDER, Cache, Study, can_photograph, result_name
from .team import Team
from .tiles import Tile

VERSION = 1
"""Version of the drawing and of what is measured in it: raise it whenever either changes, so that kept results are made again."""
WIDTHS = (8, 12, 16, 24, 36)
"""Pixels across a stroke."""
COLOURS = {"red": (0.5, 0.05, 0.05), "blue": (0.03, 0.05, 0.3), "dark red": (0.12, 0.015, 0.015)}
"""Red, green and blue of the strokes, scene units."""
WHITE = 0.8
"""Every channel of the ground."""
MARGIN = 2
"""Pixels along the edges of a stroke that are left out: there the colour of the ground shines in, for every method."""
_PANEL = 132  # pixels: a whole number of periods of most patterns; three strokes of the widest
_APART = 37.3  # pixels between two strokes
_TURN = np.radians(50)  # between the rows and what crosses a stroke: not 45 degrees, so that each meets all places of the pattern

Kept = tuple[tuple[float, ...], ...]
"""Part of the colour that was kept, of each of COLOURS in strokes of each of WIDTHS."""
Piece = tuple[str, Protocol, Tile | None]
"""Method, noise level and pattern of a result."""


@dataclass(frozen=True)
class Strokes:
    """What a method keeps of the drawing, at a noise level, with a pattern (None: a Bayer camera's method)."""

    method: str
    level: Protocol
    tile: Tile | None
    kept: Kept

    @property
    def least(self) -> tuple[float, ...]:
        """The least of all colours, for each of WIDTHS."""
        return tuple(map(min, zip(*self.kept, strict=True)))


@lru_cache(maxsize=1)
def drawing() -> tuple[FloatArray, IndexArray]:
    """Light of the scene, float32 (H, W, 3), scene units, and where it is measured, (H, W).

    That is inside the strokes the number of their panel, row by row (a row for each of COLOURS, a column for each of WIDTHS), else
    -1.
    """
    rows, columns = np.mgrid[:_PANEL, :_PANEL]
    light = np.full((len(COLOURS) * _PANEL, len(WIDTHS) * _PANEL, len(RGB)), WHITE, np.float32)
    places = np.full(light.shape[:2], -1, np.intp)
    inner = (np.minimum(rows, columns) >= BORDER) & (np.maximum(rows, columns) < _PANEL - BORDER)
    for row, colour in enumerate(COLOURS.values()):
        for column, width in enumerate(WIDTHS):
            panel = tuple(slice(place * _PANEL, (place + 1) * _PANEL) for place in (row, column))
            across = (rows * np.cos(_TURN) + columns * np.sin(_TURN)) % (width + _APART)
            light[panel][across < width] = colour
            inside = (across >= MARGIN) & (across < width - MARGIN) & inner
            places[panel][inside] = row * len(WIDTHS) + column
    light.flags.writeable = places.flags.writeable = False
    return light, places


def kept(rendered: FloatArray) -> Kept:
    """How much colour a rendering of the drawing keeps. rendered: (H, W, 3), scene units."""
    _, places = drawing()
    found = []
    for row, colour in enumerate(COLOURS.values()):
        truth = np.array(colour) - np.mean(colour)
        means = [rendered[places == row * len(WIDTHS) + column].mean(axis=0, dtype=np.float64) for column in range(len(WIDTHS))]
        found.append(tuple(float(mean @ truth / (truth @ truth)) for mean in means))
    return tuple(found)


def measure_strokes(study: Study, folder: Path, team: Team) -> tuple[list[Strokes], list[str]]:
    """What every method of a study keeps at every level with every pattern, and a line for each result that failed.

    folder: of the study; results are kept there, and made once.
    """
    pieces = _pieces(study)
    found = team.together("strokes", partial(measure, study, Cache(folder / FOLDER)), pieces, drawing()[1].size)
    made = [Strokes(*piece, each) for piece, each in zip(pieces, found, strict=True) if not isinstance(each, str)]
    return made, list(dict.fromkeys(each for each in found if isinstance(each, str)))


def result_names(study: Study) -> list[str]:
    """Names of the kept results of a study."""
    return [_name(study, methods()[name], level, tile) for name, level, tile in _pieces(study)]


def _pieces(study: Study) -> list[Piece]:
    return [
        (method.name, level, tile)
        for level in study.levels
        for method in choose(list(study.methods))
        for tile in study.cameras(method)
        if can_photograph(tile, RGB)
    ]


def _name(study: Study, method: Method, level: Protocol, tile: Tile | None) -> str:
    return f"{result_name(method, level, tile, study.seed, scene=f'strokes {VERSION}')}.json"


def measure(study: Study, cache: Cache, piece: Piece) -> Kept | str:
    """What a method keeps at a level with a pattern, from the cache or made now; a line of text if it failed.

    Raises OutputError if it cannot be kept.
    """
    name, level, tile = piece
    try:
        method = method_of(name, study.networks)
    except InputError as error:
        return str(error)
    file = _name(study, method, level, tile)
    if (known := cache.get(file, _decoded)) is not None:
        return known
    cameras = CameraPair(level, study.seed, drawing()[0], (tile or study.tile).pattern, (1.0,) * len(RGB))
    try:
        found = kept(method.render(cameras))
    except (PanchromaError, MemoryError) as error:
        return f"strokes: {name}, {level.text}: {error or 'not enough memory'}"
    cache.put(file, json.dumps(found).encode())
    return found


def _decoded(data: bytes) -> Kept:
    """The result in a file. Raises ValueError or TypeError for anything else."""
    found = np.array(json.loads(data), float)
    if found.shape != (len(COLOURS), len(WIDTHS)) or not np.isfinite(found).all():
        raise ValueError(found.shape)
    return tuple(map(tuple, found.tolist()))
