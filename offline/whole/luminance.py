"""Recovering luminance under the colour sites by a wavelet total-variation prior (section 3.1, Eqs. 1-5)."""

import numpy as np

from shared.arrays import BORDER, BoolArray, FloatArray, IndexArray, strips
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern
from shared.progress import SILENT, Progress

from ..gaussian import smoothed
from ..kernels.holes import CHUNK, REACH, fill_blocks
from ..kernels.pieces import copied
from ..kernels.shrinkage import SLACK, shrink_margins, shrink_once
from ..settings import LuminanceSettings
from .filling import refilled

# Daubechies-2 scaling taps (Daubechies 1992, table 6.1) over sqrt(2): one level without decimation is then a tight frame, in which
# synthesis by the same taps undoes analysis.
_ROOT3 = 3**0.5
LOW: FloatArray = np.array([(1 + _ROOT3) / 8, (3 + _ROOT3) / 8, (3 - _ROOT3) / 8, (1 - _ROOT3) / 8], np.float32)
HIGH: FloatArray = (LOW[::-1] * [1, -1, 1, -1]).astype(np.float32)
_TAPS: FloatArray = np.stack([LOW, HIGH])

_AROUND = 1.0  # pixels: standard deviation of the start's means (0.0 dB); every scattered site has a panchromatic pixel in reach
# White, scene units, if gamma is 1 for three channels: the paper's threshold of 1 fills flat scenes up to there. At 3.3 its
# iterations end 4 % short (measured), so that brighter frames start with a larger one.
_WHITE = 3.0
_FEW = 4  # sites of a block that the samples in it are a good start for: those of a Bayer block
_PIECE = 128  # rows of blocks that are filled between two reports of progress


def recover_luminance(mosaic: Mosaic, settings: LuminanceSettings, progress: Progress = SILENT) -> FloatArray:
    """l[n] in scene units, float32 (H, W): the measured samples, and between them the minimiser of Eqs. 1-2.

    Each iteration shrinks wavelet coefficients and restores the measured samples (Eqs. 3-5); the threshold falls by beta each time.
    """
    luminance = _filled(mosaic, settings, progress)
    return refilled(luminance, mosaic) if settings.learned else luminance


def _filled(mosaic: Mosaic, settings: LuminanceSettings, progress: Progress) -> FloatArray:
    pattern, signal = mosaic.pattern, mosaic.signal
    first = _first_threshold(float(signal.max()), settings)
    thresholds = (first * settings.decay ** np.arange(settings.iterations)).astype(np.float32)
    around = settings.relative or len(pattern.sites) > _FEW
    rows, columns = (_isolated(pattern, mosaic.shape, axis) for axis in (0, 1))
    if len(rows) == 0 or len(columns) == 0:
        progress.stage("luminance", settings.iterations)
        holes = _holes(pattern, (pattern.period, signal.shape[1]))
        luminance, change = fill(_start(signal, holes) if around else signal, holes, thresholds, progress)
        progress.solved("luminance", settings.iterations, change)
        return luminance
    progress.stage("luminance", -(-len(rows) // _PIECE))
    luminance, changes = copied(signal), np.empty(len(rows), np.float32)
    change = _fill_margins(luminance, pattern, (rows, columns), thresholds, around)
    places, extent = np.array([site[:2] for site in pattern.sites]), pattern.block_shape
    starts, response = _shares(extent, places, around), _response(extent, places)
    for start in range(0, len(rows), _PIECE):
        piece = changes[start : start + _PIECE]
        origin, blocks = (int(rows[start]), int(columns[0])), (len(piece), len(columns))
        fill_blocks(signal, luminance, origin, blocks, pattern.period, extent, places, starts, response, _TAPS, thresholds, piece)
        progress.advance()
    progress.solved("luminance", settings.iterations, max(change, float(changes.max())))
    return luminance


def fill(signal: FloatArray, holes: BoolArray, thresholds: FloatArray, progress: Progress = SILENT) -> tuple[FloatArray, float]:
    """Fill the holes of a plane by one iteration of Eqs. 3-5 per threshold.

    signal: (H, W), scene units.
    holes: True at a hole, bool (rows, W); the rows repeat down the plane.
    thresholds: one per iteration, scene units.
    Returns the filled plane, float32 (H, W), and the largest change of a sample in the last iteration.
    """
    plane, result, where = _bordered(signal, holes)
    for threshold in thresholds:
        shrink_once(plane, result, signal.shape[1], where, _TAPS, threshold)
        plane, result = result, plane
        progress.advance()
    change = max(float(np.abs(plane[rows] - result[rows]).max()) for rows in strips(len(plane)))
    return plane[:, REACH : REACH + signal.shape[1]].copy(), change


def _first_threshold(brightest: float, settings: LuminanceSettings) -> float:
    if settings.relative:
        return settings.threshold * max(brightest, 0.0)
    return max(settings.threshold, (brightest - 1) / 2) if brightest > _WHITE else settings.threshold


def _start(signal: FloatArray, holes: BoolArray) -> FloatArray:
    """The plane with a mean of the panchromatic samples around each hole in it, float32 (H, W). holes: see `fill`.

    Holes of scattered sites and of many channels may be so wide that iterations which start from the samples in them, the paper's
    start, end too early: a flat scene is off by 80 % after 50 of them for eight channels in 2 x 4 pixels, and by 2 % after 62.
    """
    clear = ~holes[np.arange(len(signal)) % len(holes)]
    known = clear.astype(np.float32)
    around = smoothed(signal * known, _AROUND) / smoothed(known, _AROUND)
    return np.where(clear, signal, around)


def _shares(extent: tuple[int, int], holes: IndexArray, around: bool) -> FloatArray:
    """What the start of each hole of an isolated block is, as `fill_blocks` takes it: its sample, or as in `_start`."""
    own = np.zeros((len(holes), *(size + 2 * REACH for size in extent)), np.float32)
    own[np.arange(len(holes)), *(holes + REACH).T] = 1
    if not around:
        return own
    near = smoothed(own, _AROUND) * (1 - own.sum(axis=0))
    return near / near.sum(axis=(1, 2), keepdims=True)


def _bordered(signal: FloatArray, holes: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A plane with mirrored columns, its copy, and where its holes are, as `shrink_once` takes them."""
    plane = np.ascontiguousarray(np.pad(signal, ((0, 0), (REACH, REACH + SLACK)), mode=BORDER))
    return plane, plane.copy(), np.ascontiguousarray(np.pad(holes.astype(np.float32), ((0, 0), (0, SLACK))))


def _isolated(pattern: CfaPattern, shape: tuple[int, int], axis: int) -> IndexArray:
    """First rows (axis 0) or columns (axis 1) of the isolated blocks: no other block and no frame edge within `REACH` pixels."""
    grid = pattern.grid(shape)
    size, origins = pattern.block_shape[axis], (grid.rows, grid.columns)[axis]
    if pattern.period < size + REACH:
        return origins[:0]
    return origins[(origins >= REACH) & (origins + size + REACH <= shape[axis])]


def _holes(pattern: CfaPattern, shape: tuple[int, int], first: tuple[int, int] = (0, 0)) -> BoolArray:
    return pattern.filter_map(shape, first) < len(pattern.channels)


def _fill_margins(
    luminance: FloatArray, pattern: CfaPattern, isolated: tuple[IndexArray, IndexArray], thresholds: FloatArray, around: bool
) -> float:
    """Fill the blocks near the frame's edge, which are mirrored there. They lie in four margins, each filled like a whole plane.

    A margin ends where the isolated blocks begin, farther from its own holes than they reach. The margins at the sides are
    transposed, so that their rows are long. Returns the largest change of a sample in the last iteration.
    """
    (height, width), (rows, columns), (down, across) = luminance.shape, isolated, pattern.block_shape
    ends = [slice(0, int(rows[0])), slice(int(rows[-1]) + down, height)]
    sides = [slice(0, int(columns[0])), slice(int(columns[-1]) + across, width)]
    targets = [luminance[end] for end in ends] + [luminance[:, side].T for side in sides]
    holes = [_holes(pattern, (end.stop - end.start, width), (end.start, 0)) for end in ends]
    holes += [_holes(pattern, (height, side.stop - side.start), (0, side.start)).T for side in sides]
    starts = map(_start, targets, holes) if around else targets
    planes, results, where = zip(*map(_bordered, starts, holes), strict=True)
    lengths = tuple(target.shape[1] for target in targets)
    shrink_margins(planes, results, lengths, where, _TAPS, thresholds)
    last = results if len(thresholds) % 2 else planes
    for target, filled, length in zip(targets, last, lengths, strict=True):
        target[:] = filled[:, REACH : REACH + length]
    return max(float(np.abs(plane - result).max()) for plane, result in zip(planes, results, strict=True))


def _response(extent: tuple[int, int], holes: IndexArray) -> FloatArray:
    """How much a sample of 1 in each hole of a block adds to the high-pass coefficients that see it, as `fill_blocks` takes it."""
    (low_down, high_down), (low_across, high_across) = (
        np.stack([_seen(taps, size) for taps in _TAPS])[:, :, places] for size, places in zip(extent, holes.T, strict=True)
    )
    pairs = ((low_down, high_across), (high_down, low_across), (high_down, high_across))
    response = np.stack([down[:, None] * across for down, across in pairs]).reshape(-1, len(holes))
    return np.pad(response, ((0, 0), (0, -len(holes) % CHUNK))).reshape(len(response), -1, CHUNK)


def _seen(taps: FloatArray, size: int) -> FloatArray:
    """[coefficient, pixel]: the tap that multiplies a pixel in each coefficient that sees any pixel of a row of `size`."""
    seen = np.zeros((size + 3, size), np.float32)
    for pixel in range(size):
        seen[pixel : pixel + 4, pixel] = taps[::-1]
    return seen
