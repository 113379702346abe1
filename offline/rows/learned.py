"""Correction of chromaticity by a network that has seen photographs: one block in K x K pixels does not know everything.

The picture is cut into cells, K x K pixels with the block in the middle. The network works on the grid of cells: the pixels of a
cell are its channels (space to depth). It sees luminance, chromaticity, what the render missed at the colour sites before that was
corrected, and the noise there. It returns a correction of chromaticity, and luminance stays. `tools/training/` builds and trains
it; `models/README.md` says on what, and where its limits are.

The files in `models/` are for RGGB. The other Bayer orders are its mirror images, and cells are symmetric, so cells are mirrored
on the way in and out. Frames are processed in tiles of one fixed size at fixed places: threads and bands do not change a bit.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from shared.arrays import FloatArray, IndexArray, mirrored
from shared.errors import InputError
from shared.pattern import CfaPattern

from ..kernels.compile import threads
from ..settings import LearnedSettings
from ..sites import BlockSamples
from ..tiling import DARK, Part

FOLDER = Path(__file__).parents[1] / "models"
ORDER = "RGGB"
_MIRRORED = {"RGGB": (1, 1), "GRBG": (1, -1), "GBRG": (-1, 1), "BGGR": (-1, -1)}
UNKNOWN = 1e6
"""Variance, in scene units squared, of a sample that is not trusted: the network then corrects nothing around it."""


@dataclass(frozen=True)
class Cells:
    """The cells of a frame, and their way to and from the order RGGB.

    period: K, even.
    origin: frame row and column at which the first cell begins, 0 or less.
    shape: number of cells (down, across).
    blocks: index of the first cell (down, across) with a whole block.
    steps: 1, or -1 along an axis that is mirrored.
    channels: the pattern's indices of red, green and blue.
    sites: indices of the sites of a block, in the order R, G, G, B of the mirrored block.
    """

    period: int
    origin: tuple[int, int]
    shape: tuple[int, int]
    blocks: tuple[int, int]
    steps: tuple[int, int]
    channels: list[int]
    sites: list[int]

    @classmethod
    def of(cls, pattern: CfaPattern, shape: tuple[int, int]) -> "Cells":
        """The cells of a frame of this shape; the pattern has a Bayer block and an even period."""
        period, grid = pattern.period, pattern.grid(shape)
        steps = _MIRRORED[_block_letters(pattern)]
        margin = (period - 2) // 2  # pixels of a cell before its block
        origin = [-((margin - first) % period) for first in pattern.block_origin]
        count = [-(-(size - start) // period) for size, start in zip(shape, origin, strict=True)]
        whole = [
            (int(places[0]) - margin - start) // period
            for places, start in zip((grid.whole_rows, grid.whole_columns), origin, strict=True)
        ]
        square = np.arange(4).reshape(2, 2)[:: steps[0], :: steps[1]]
        return cls(
            period,
            (origin[0], origin[1]),
            (count[0], count[1]),
            (whole[0], whole[1]),
            steps,
            [pattern.channels.index(letter) for letter in "RGB"],
            square.ravel().tolist(),
        )

    def picture(self, part: Part, gamma: FloatArray, rows: tuple[int, int], columns: tuple[int, int], height: int) -> FloatArray:
        """gamma_i times channel i of these rows and columns of cells, float32 (3, rows K, columns K); the frame is mirrored out.

        part: all rows of the frame that the cells show. height: rows of the frame.
        """
        width = part.luminance.shape[1]
        down = mirrored(self._pixels(0, rows), height).clip(part.first, part.end - 1) - part.first
        across = mirrored(self._pixels(1, columns), width)
        place = _slices(down, across) or np.ix_(down, across)
        light, colour = part.luminance[place], part.chromaticity[place]
        planes = np.empty((len(self.channels), *light.shape), np.float32)
        for plane, channel in zip(planes[:, :: self.steps[0], :: self.steps[1]], self.channels, strict=True):
            np.multiply(colour[..., channel], light, out=plane)
        planes *= gamma[self.channels, None, None]
        return planes

    def blocks_of(self, values: FloatArray, rows: tuple[int, int], columns: tuple[int, int], outside: float) -> FloatArray:
        """Values of whole blocks, (rows, columns, n), at these rows and columns of cells, float32 (n, rows, columns)."""
        down, across = (np.arange(*span) - first for span, first in zip((rows, columns), self.blocks, strict=True))
        inside = (((down >= 0) & (down < values.shape[0]))[:, None]) & ((across >= 0) & (across < values.shape[1]))
        found = values[np.ix_(down.clip(0, values.shape[0] - 1), across.clip(0, values.shape[1] - 1))]
        found = np.where(inside[..., None], found, np.float32(outside)).transpose(2, 0, 1)
        return np.ascontiguousarray(found[:, :: self.steps[0], :: self.steps[1]])

    def _pixels(self, axis: int, span: tuple[int, int]) -> IndexArray:
        return self.origin[axis] + np.arange(span[0] * self.period, span[1] * self.period)


def _slices(down: IndexArray, across: IndexArray) -> tuple[slice, slice] | None:
    """Both as slices, if each counts up one by one: a view is then cheaper than a copy."""
    for places in (down, across):
        if places[-1] - places[0] != len(places) - 1 or (np.diff(places) != 1).any():
            return None
    return slice(int(down[0]), int(down[-1]) + 1), slice(int(across[0]), int(across[-1]) + 1)


class Learner:
    """A network, loaded, for one pattern.

    path: one of `models/`. pattern: has a Bayer block and the network's period.
    gamma: (C,), the weights of Eq. 7.
    Raises InputError when the file cannot be read.
    """

    def __init__(self, path: Path, pattern: CfaPattern, gamma: tuple[float, ...]) -> None:
        self._session = _session(path)
        self._pattern, self._gamma = pattern, np.array(gamma, np.float32)
        side = self._session.get_inputs()[1].shape[-1]
        self._tile = self._session.get_outputs()[0].shape[-1] // pattern.period  # cells
        self._halo = (side - self._tile) // 2

    def steps(self, sites: BlockSamples) -> tuple[int, int, int]:
        """(reach, step, origin) for `tiling.windows`: rows that a result depends on, rows of a tile, and where the first begins."""
        period, origin = self._pattern.period, Cells.of(self._pattern, sites.sites.grid.frame).origin[0]
        return (self._halo + 1) * period + sites.reach, self._tile * period, origin

    def refine(self, before: Part, part: Part, sites: BlockSamples, rows: tuple[int, int]) -> Part:
        """`part` with its chromaticity corrected in these rows of the frame, which end where tiles do.

        before: the same rows of the picture before `correct_sites`.
        """
        height, width = sites.sites.grid.frame
        cells = Cells.of(self._pattern, (height, width))
        inputs = Inputs(cells, before, part, sites, self._gamma)
        size = self._tile * cells.period
        first, last = ((row - cells.origin[0]) // size for row in (rows[0], rows[1] - 1))
        chromaticity = part.chromaticity.copy()

        def work(tile: tuple[int, int]) -> None:
            span = [(each * self._tile - self._halo, (each + 1) * self._tile + self._halo) for each in tile]
            top, left = (start + each * size for start, each in zip(cells.origin, tile, strict=True))
            (found,) = self._session.run(None, inputs.cut(*span))
            share = found[0][:, :: cells.steps[0], :: cells.steps[1]].transpose(1, 2, 0)
            place = slice(max(top, rows[0]), min(top + size, rows[1])), slice(max(left, 0), min(left + size, width))
            share = share[place[0].start - top : place[0].stop - top, place[1].start - left : place[1].stop - left]
            inside = slice(place[0].start - part.first, place[0].stop - part.first), place[1]
            light = part.luminance[inside]
            # No channel gains or loses more than all light: among pixels below black the network knows no bound.
            most = np.maximum(light, np.abs(share).max(axis=2))
            per_light = np.divide(1, most, out=np.zeros_like(light), where=light > DARK)
            for channel, index in enumerate(cells.channels):
                chromaticity[(*inside, index)] += share[..., channel] * (per_light * (1 / self._gamma[index]))

        tiles = [(down, across) for down in range(first, last + 1) for across in range(-(-cells.shape[1] // self._tile))]
        with ThreadPoolExecutor(threads(), "learned") as pool:
            for _ in pool.map(work, tiles):
                pass  # raises the error of a tile
        return Part(part.first, part.luminance, chromaticity)


class Inputs:
    """What the network sees of a part of a picture.

    before, part: the picture before and after `correct_sites`, the same rows.
    gamma: (C,), float32.
    """

    def __init__(self, cells: Cells, before: Part, part: Part, sites: BlockSamples, gamma: FloatArray) -> None:
        self._cells, self._part, self._gamma, self._height = cells, part, gamma, sites.sites.grid.frame[0]
        rows = sites.within(before)
        self._error = sites.error(before, gamma, rows)[..., cells.sites]
        noise = sites.scaled_variance(gamma, rows)
        known = np.zeros(self._error.shape[:2], np.float32) if noise is None else noise.mean(axis=2)
        self._variance = np.where(sites.unclipped[rows], known, np.float32(UNKNOWN))[..., None]
        self._blocks = replace(cells, blocks=(cells.blocks[0] + rows.start, cells.blocks[1]))

    def cut(self, rows: tuple[int, int], columns: tuple[int, int]) -> dict[str, FloatArray]:
        """The inputs of the network for these rows and columns of cells, which may lie outside the frame."""
        return {
            "picture": self._cells.picture(self._part, self._gamma, rows, columns, self._height)[None],
            "error": self._blocks.blocks_of(self._error, rows, columns, 0.0)[None],
            "variance": self._blocks.blocks_of(self._variance, rows, columns, UNKNOWN)[None],
        }


def model_for(pattern: CfaPattern) -> Path | None:
    """The network for a pattern; None if there is none, because the pattern has no Bayer block or another period."""
    if len(pattern.sites) != len(ORDER) or pattern.block_shape != (2, 2) or _block_letters(pattern) not in _MIRRORED:
        return None
    path = FOLDER / f"{ORDER.lower()}-k{pattern.period}.onnx"
    return path if path.exists() else None


def _block_letters(pattern: CfaPattern) -> str:
    """The letters of the 2 x 2 pixels from a block's origin on, row by row."""
    return "".join(row[:2] for row in pattern.letters_from(pattern.block_origin)[:2])


def rows_held(path: Path, period: int) -> int:
    """About how many rows of a frame are held at a time: those of a tile, of its surroundings, and of a band that has arrived."""
    side: int = _session(path).get_inputs()[1].shape[-1]
    return 2 * side * period


def network_name(pattern: CfaPattern) -> str | None:
    """The name of the network that corrects colour for a pattern, in the preset BEST; None if there is none for it.

    >>> from offline import network_name
    >>> from shared import CfaPattern
    >>> network_name(CfaPattern.bayer(6)), network_name(CfaPattern.bayer(5))
    ('rggb-k6', None)
    """
    path = model_for(pattern)
    return path.stem if path else None


def learner_for(pattern: CfaPattern, gamma: tuple[float, ...], settings: LearnedSettings) -> Learner | None:
    """The network for a pattern, loaded; None if the settings do without, or there is none."""
    path = model_for(pattern) if settings.used else None
    return Learner(path, pattern, gamma) if path else None


@cache
def _session(path: Path) -> Any:
    """An onnxruntime session, which computes in the calling thread; any number of threads may call it."""
    from shared.runtime import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # tiles run in parallel instead
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4  # errors are raised anyway
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # each error code of onnxruntime has its own class, without a common base
        raise InputError(f"{path}: is not a network that onnxruntime can run ({error}); install Panchroma again") from error
