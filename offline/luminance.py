"""Recovering luminance under the colour sites by a wavelet total-variation prior (section 3.1, Eqs. 1-5)."""

import numpy as np

from shared.arrays import BORDER, BoolArray, FloatArray, IndexArray
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from .kernels.holes import CHUNK, REACH, fill_blocks
from .kernels.shrinkage import SLACK, shrink_once
from .settings import LuminanceSettings

# Daubechies-2 scaling taps (Daubechies 1992, table 6.1) over sqrt(2): one level without decimation is then a tight frame, in which
# synthesis by the same taps undoes analysis.
_ROOT3 = 3**0.5
LOW: FloatArray = np.array([(1 + _ROOT3) / 8, (3 + _ROOT3) / 8, (3 - _ROOT3) / 8, (1 - _ROOT3) / 8], np.float32)
HIGH: FloatArray = (LOW[::-1] * [1, -1, 1, -1]).astype(np.float32)
_TAPS: FloatArray = np.stack([LOW, HIGH])

_PIECE = 128  # rows of blocks filled between two reports of progress


def recover_luminance(mosaic: Mosaic, settings: LuminanceSettings, progress: Progress = SILENT) -> FloatArray:
    """l[n] in scene units, float32 (H, W): the measured samples, and between them the minimiser of Eqs. 1-2.

    Fifty rounds of shrinking and restoring (Eqs. 3-5) with a threshold that falls by beta each time.
    """
    pattern, signal = mosaic.pattern, mosaic.signal
    thresholds = (settings.threshold * settings.decay ** np.arange(settings.iterations)).astype(np.float32)
    rows, columns = (_alone(pattern, mosaic.shape, axis) for axis in (0, 1))
    if len(rows) == 0 or len(columns) == 0:
        progress.stage("luminance", settings.iterations)
        return fill(signal, _holes(pattern, (pattern.period, signal.shape[1])), thresholds, progress)
    pieces = [rows[start : start + _PIECE] for start in range(0, len(rows), _PIECE)]
    progress.stage("luminance", len(pieces))
    luminance = signal.copy()
    _fill_margins(luminance, signal, pattern, (rows, columns), thresholds)
    holes = np.array([site[:2] for site in pattern.sites])
    response = _response(pattern.block_shape, holes)
    for piece in pieces:
        first, blocks = (int(piece[0]), int(columns[0])), (len(piece), len(columns))
        fill_blocks(signal, luminance, first, blocks, pattern.period, pattern.block_shape, holes, response, _TAPS, thresholds)
        progress.advance()
    return luminance


def fill(signal: FloatArray, holes: BoolArray, thresholds: FloatArray, progress: Progress = SILENT) -> FloatArray:
    """`signal` (H, W) with its holes filled by one iteration of Eqs. 3-5 per threshold over the whole plane.

    holes: where they are, bool (rows, W), of rows that repeat.
    """
    width = signal.shape[1]
    plane = np.ascontiguousarray(np.pad(signal, ((0, 0), (REACH, REACH + SLACK)), mode=BORDER))
    result = plane.copy()
    where = np.ascontiguousarray(np.pad(holes.astype(np.float32), ((0, 0), (0, SLACK))))
    for threshold in thresholds:
        shrink_once(plane, result, width, where, _TAPS, threshold)
        plane, result = result, plane
        progress.advance()
    return plane[:, REACH : REACH + width].copy()


def _alone(pattern: CfaPattern, shape: tuple[int, int], axis: int) -> IndexArray:
    """First rows (axis 0) or columns (1) of the blocks in whose surroundings is neither another block nor the frame's edge."""
    grid = pattern.grid(shape)
    size, origins = pattern.block_shape[axis], (grid.rows, grid.columns)[axis]
    if pattern.period < size + REACH:
        return origins[:0]
    return origins[(origins >= REACH) & (origins + size + REACH <= shape[axis])]


def _holes(pattern: CfaPattern, shape: tuple[int, int], first: tuple[int, int] = (0, 0)) -> BoolArray:
    return pattern.filter_map(shape, first) < len(pattern.channels)


def _fill_margins(
    luminance: FloatArray,
    signal: FloatArray,
    pattern: CfaPattern,
    alone: tuple[IndexArray, IndexArray],
    thresholds: FloatArray,
) -> None:
    """Fill the blocks that see themselves in the mirror at the frame's edge: they lie in four margins, filled like whole planes.

    A margin ends where the blocks that are alone begin, farther from its own holes than they reach. Those at the sides are turned,
    so that their rows are long.
    """
    (height, width), (rows, columns), (down, across) = signal.shape, alone, pattern.block_shape
    for start, stop in ((0, int(rows[0])), (int(rows[-1]) + down, height)):
        holes = _holes(pattern, (stop - start, width), (start, 0))
        luminance[start:stop] = fill(signal[start:stop], holes, thresholds)
    for start, stop in ((0, int(columns[0])), (int(columns[-1]) + across, width)):
        holes = _holes(pattern, (height, stop - start), (0, start))
        luminance[:, start:stop] = fill(signal[:, start:stop].T, holes.T, thresholds).T


def _response(extent: tuple[int, int], holes: IndexArray) -> FloatArray:
    """What a unit in each hole of a block adds to the high-pass coefficients that see it, as `fill_blocks` wants it."""
    (low_down, high_down), (low_across, high_across) = (
        np.stack([_seen(taps, size) for taps in _TAPS])[:, :, places] for size, places in zip(extent, holes.T, strict=True)
    )
    pairs = ((low_down, high_across), (high_down, low_across), (high_down, high_across))
    response = np.stack([down[:, None] * across for down, across in pairs]).reshape(-1, len(holes))
    return np.pad(response, ((0, 0), (0, -len(holes) % CHUNK)))


def _seen(taps: FloatArray, size: int) -> FloatArray:
    """[coefficient, pixel]: which tap it is that a pixel of a row of `size` meets, for all coefficients that see one."""
    seen = np.zeros((size + 3, size), np.float32)
    for pixel in range(size):
        seen[pixel : pixel + 4, pixel] = taps[::-1]
    return seen
