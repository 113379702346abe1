"""Luminance under the blocks of colour sites, corrected by a network that has seen photographs.

What the wavelets fill in is smooth where an edge, a stroke or a texture runs under a block. A small network with two hidden layers
sees the pixels around a block as they are filled, in units of their contrast, and the noise in these units. It returns what its
sites are off by, in these units too: no brightness and no contrast is special, and what is flat stays as it is.
`tools/training/luminance.py` trains it; `models/README.md` says on what. The paper has none of this.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from shared.arrays import BORDER, FloatArray, IndexArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.mosaic import Mosaic

from ..kernels.pieces import in_pieces

PATH = Path(__file__).parents[1] / "models" / "luminance.onnx"
REACH = 5
"""Pixels around a block that the network sees."""
SIDE = 2 + 2 * REACH
"""Pixels along the side of what it sees."""
_LEAST_PERIOD = 4  # with less, most of what it sees is filled in
_FLAT = 1e-5  # contrast, a share of the light, that is rounding
_NOISIEST = 8.0  # binary logarithm of noise in units of contrast: bounds an input
_TINY = 1e-30  # keeps quotients finite
_PIECE = 32  # rows of blocks that are computed together, whatever the number of threads


def refilled(luminance: FloatArray, mosaic: Mosaic) -> FloatArray:
    """l[n], float32 (H, W), corrected under the whole blocks of 2 x 2 sites; `luminance` itself for other blocks.

    luminance: (H, W), filled in, scene units. Raises InputError if the network cannot be read.
    """
    pattern, noise = mosaic.pattern, mosaic.calibration.noise
    if pattern.is_scattered or pattern.block_shape != (2, 2) or len(pattern.sites) != 4 or pattern.period < _LEAST_PERIOD:
        return luminance
    network, grid, result = _session(), pattern.grid(mosaic.shape), luminance.copy()
    wide = np.pad(luminance, REACH, mode=BORDER)

    def work(piece: int) -> None:
        rows, columns = grid.whole_rows[piece * _PIECE : (piece + 1) * _PIECE], grid.whole_columns
        seen, units = seen_around(wide, (rows, columns), noise)
        (found,) = network.run(None, {"seen": seen})
        off = (found * units).reshape(len(rows), len(columns), 2, 2)
        for down in range(2):
            for across in range(2):
                result[np.ix_(rows + down, columns + across)] += off[:, :, down, across]

    in_pieces(lambda first, _: work(first), -(-len(grid.whole_rows) // _PIECE) if len(grid.whole_columns) else 0)
    return result


def seen_around(wide: FloatArray, blocks: tuple[IndexArray, IndexArray], noise: NoiseModel | None) -> tuple[FloatArray, FloatArray]:
    """What the network sees around blocks, float32 (blocks, SIDE^2 + 1), and the unit of its answer, scene units, (blocks, 1).

    wide: luminance with `REACH` more pixels on each side. blocks: first rows and first columns of blocks, without these pixels.
    """
    pixels = sliding_window_view(wide, (SIDE, SIDE))[np.ix_(*blocks)].reshape(-1, SIDE**2)
    mean = pixels.mean(axis=1, keepdims=True)
    seen = np.empty((len(pixels), SIDE**2 + 1), np.float32)
    np.subtract(pixels, mean, out=seen[:, :-1])
    units: FloatArray = np.sqrt(np.square(seen[:, :-1]).mean(axis=1, keepdims=True))
    units[units <= np.float32(_FLAT) * np.abs(mean)] = 0
    safe = np.maximum(units, np.float32(_TINY))
    seen[:, :-1] /= safe
    variance = noise.variance(mean, -1) if noise else np.zeros_like(mean)
    seen[:, -1:] = np.minimum(np.log2(1 + np.sqrt(variance) / safe), _NOISIEST)
    return seen, units


@cache
def _session() -> Any:
    from shared.runtime import session

    try:
        return session(PATH)
    except InputError as error:
        raise InputError(f"{PATH}: {error}; install Panchroma again") from error
