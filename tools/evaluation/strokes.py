"""How much colour a method keeps in narrow strokes on white: letters of a logo, lines of a drawing. Medians of photographs hide it.

The scene is drawn, once for a study: diagonal strokes of one colour on white, each panel with one colour and one width. Of the
colour (the channels minus their mean) that a method shows inside the strokes, at least two pixels from their edges, the part
that lies along the true one is measured: 1 = all of it, 0 = grey.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from shared.arrays import FloatArray, IndexArray
from shared.errors import PanchromaError
from tools.camera.protocols import Protocol
from tools.scenes.scene import RGB

from .cache import FOLDER, Cache, key
from .cameras import CameraPair
from .methods import choose, methods
from .metrics import BORDER
from .study import Study, can_photograph
from .team import Team
from .tiles import Tile

VERSION = 1
"""Of the drawing and of what is measured in it: raise it whenever either changes, so that kept results are made again."""
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


@dataclass(frozen=True)
class Piece:
    """One result to find or make. folder: of the study; for the others see `Strokes`."""

    method: str
    level: Protocol
    tile: Tile | None
    seed: int
    folder: Path

    @property
    def name(self) -> str:
        """Name of the result in the cache."""
        return key(
            scene=f"strokes {VERSION}",
            protocol=[self.level.name, self.level.version],
            level=self.level.level,
            seed=self.seed if self.level.noisy else 0,
            pattern=(self.tile.letters, self.tile.pattern.channels) if self.tile else None,
            **methods()[self.method].identity,
        )


def measure_strokes(study: Study, folder: Path, team: Team) -> tuple[list[Strokes], list[str]]:
    """What every method of a study keeps at every level with every pattern, and a line for each result that failed.

    folder: of the study; results are kept there, and made once.
    """
    pieces = [
        Piece(method.name, level, tile, study.seed, folder)
        for level in study.levels
        for method in choose(list(study.methods))
        for tile in study.cameras(method)
        if can_photograph(tile, RGB)
    ]
    found = team.together("strokes", measure, pieces, drawing()[1].size)
    both = list(zip(pieces, found, strict=True))
    made = [Strokes(piece.method, piece.level, piece.tile, each) for piece, each in both if not isinstance(each, str)]
    return made, [each for each in found if isinstance(each, str)]


def measure(piece: Piece) -> Kept | str:
    """The result of a piece, from the cache or made now; a line of text if it failed. Raises OutputError if it cannot be kept."""
    cache = Cache(piece.folder / FOLDER)
    if (known := cache.numbers(piece.name, (len(COLOURS), len(WIDTHS)))) is not None:
        return tuple(map(tuple, known.tolist()))
    tile = piece.tile or Tile.of_period(6)
    cameras = CameraPair(piece.level, piece.seed, drawing()[0], tile.pattern, (1.0,) * len(RGB))
    try:
        found = kept(methods()[piece.method].render(cameras))
    except (PanchromaError, MemoryError) as error:
        return f"strokes: {piece.method}, {piece.level.text}: {error or 'not enough memory'}"
    cache.put_numbers(piece.name, np.array(found))
    return found
