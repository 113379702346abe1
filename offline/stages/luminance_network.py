"""Luminance under the blocks of colour sites, corrected by a network that has seen photographs.

What the wavelets fill in is smooth where an edge, a stroke or a texture runs under a block. A small
network with hidden layers sees the pixels around a block as they are filled, in units of their
contrast, and the noise in these units. It returns what its sites are off by, in these units too: no
brightness and no contrast is special, and what is flat stays as it is.
`tools/training/luminance.py` trains it; `models/README.md` says on what. The paper has none of
this.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...shared import CfaPattern, Mosaic, NoiseModel
from ...shared.arrays import FloatArray, IndexArray, mirrored
from ...shared.networks import NETWORKS, load_network
from ..frame import Sites
from ..numerics.chunks import in_chunks

PATHS = {4: NETWORKS / "luminance.onnx", 3: NETWORKS / "luminance-three.onnx"}
"""Sites of a block of 2 x 2 pixels -> the network for it; of three, the pixel that is panchromatic
is the last one.
"""
REACH = 5
"""Pixels around a block that the network sees."""
SIDE = 2 + 2 * REACH
"""Pixels along the side of what it sees."""
_LEAST_PERIOD = 4  # with less, most of what it sees is filled in
# Contrast, a share of the light, and in standard deviations of the noise, from which on the network
# is asked: with less there is next to nothing to correct.
_PLAIN, _CLEAR = 0.02, 1.2
# rows of blocks computed together, whatever the number of threads: larger chunks leave the cache
_CHUNK = 8


def correct_fill(luminance: FloatArray, mosaic: Mosaic) -> FloatArray:
    """`luminance`, float32 (H, W), corrected in place under the whole blocks of three or four sites
    in 2 x 2 pixels.

    Other blocks stay.

    Parameters
    ----------
    luminance : FloatArray
        (H, W), filled in, scene units. Raises InputError if the network cannot be read.
    """
    pattern, noise = mosaic.pattern, mosaic.calibration.noise
    count = len(pattern.sites)
    if pattern.block_shape != (2, 2) or count not in PATHS or pattern.period < _LEAST_PERIOD:
        return luminance
    network, sites, steps = load_network(PATHS[count]), Sites.in_frame(mosaic), mirrors(pattern)
    turned = steps[0] < 0, steps[1] < 0
    order = [2 * (row ^ turned[0]) + (column ^ turned[1]) for row, column, _ in pattern.sites]
    first_rows, columns = sites.grid.whole_rows, sites.grid.whole_columns
    off = np.zeros((len(first_rows), len(columns), count), np.float32)

    def work(chunk: int) -> None:
        rows = first_rows[chunk * _CHUNK : (chunk + 1) * _CHUNK]
        # Only what this chunk sees, continued beyond the frame's edges: a frame with a border would
        # be one more in memory.
        down = mirrored(np.arange(rows[0] - REACH, rows[-1] + 2 + REACH), mosaic.shape[0])
        across = mirrored(np.arange(-REACH, mosaic.shape[1] + REACH), mosaic.shape[1])
        seen, blocks = np.ix_(down, across), (rows - rows[0], columns)
        asked, inputs, units = network_inputs(luminance[seen], blocks, noise, steps)
        (found,) = network.run(None, {"seen": inputs})
        off[chunk * _CHUNK :][: len(rows)].reshape(-1, count)[asked] = (found * units)[:, order]

    in_chunks(lambda first, _: work(first), -(-len(first_rows) // _CHUNK))
    for site, place in enumerate(sites.places):
        luminance[place] += off[..., site]
    return luminance


def mirrors(pattern: CfaPattern) -> tuple[int, int]:
    """Steps (down, across), 1 or -1, by which the panchromatic pixel of a block of three sites
    comes last; 1 for a full block.
    """
    clear = np.argwhere(pattern.panchromatic_mask((2, 2), pattern.block_origin))
    down, across = (2 * clear[0] - 1).tolist() if len(clear) else (1, 1)
    return down, across


def network_inputs(
    wide: FloatArray,
    blocks: tuple[IndexArray, IndexArray],
    noise: NoiseModel | None,
    steps: tuple[int, int] = (1, 1),
) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Select blocks with enough contrast around them for the network, and return its inputs.

    Parameters
    ----------
    wide : FloatArray
        Luminance with `REACH` more pixels on each side.
    blocks : tuple[IndexArray, IndexArray]
        First rows and first columns of blocks, without these pixels.
    steps : tuple[int, int], optional
        -1 along an axis (down, across) that is mirrored, otherwise 1.

    Returns
    -------
    tuple[IndexArray, FloatArray, FloatArray]
        Their n numbers, row by row; what the network sees, float32 (n, SIDE^2 + 1); and the unit of
        its answer, scene units, (n, 1).
    """
    windows = sliding_window_view(wide, (SIDE, SIDE))[np.ix_(*blocks)]
    pixels = windows[..., :: steps[0], :: steps[1]].reshape(-1, SIDE**2)
    # half the time of means and squares
    mean = np.einsum("ij->i", pixels)[:, None] / np.float32(SIDE**2)
    pixels -= mean
    squares = np.einsum("ij,ij->i", pixels, pixels)[:, None]
    units: FloatArray = np.sqrt(squares / np.float32(SIDE**2))
    deviation = np.sqrt(noise.variance(mean, -1) if noise else np.zeros_like(mean))
    plain = np.maximum(np.float32(_PLAIN) * np.abs(mean), np.float32(_CLEAR) * deviation)
    asked = np.flatnonzero(units > plain)
    units, inputs = units[asked], np.empty((len(asked), SIDE**2 + 1), np.float32)
    np.divide(pixels[asked], units, out=inputs[:, :-1])
    inputs[:, -1:] = np.log2(1 + deviation[asked] / units)
    return asked, inputs, units
