"""Find how a frame of a hand-held series lies against the reference, from their luminance.

OpenCV finds shift and rotation: phase correlation of small copies (Kuglin and Hines 1975), then the largest correlation coefficient
(ECC: Evangelidis and Psarakis 2008) on larger and larger copies, without the tiles that disagree, so that moving things do not pull.
OpenCV looks between pixels to 1/32 pixel. A last step compares tiles with bicubic interpolation (Lucas and Kanade 1981): the shift
and rotation in which most agree, and how certain that is. Optical flow (DIS: Kroeger et al. 2016), averaged on a grid of nodes, gives
local shifts (parallax) where they explain what shift and rotation leave.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import atan2
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter

from shared.arrays import BoolArray, DoubleArray, FloatArray
from shared.errors import InputError
from shared.motion import Motion

from ..gaussian import smoothed
from .frames import DEVIATIONS, View, displaced

# Chosen on drawn scenes. `python -m tests.benchmarks.alignment` measures on photographs.
_BLUR = 1.2  # pixels: standard deviation of the Gaussian that takes away what sampling and filled pixels add to texture
_SPREAD = 4 * np.pi * _BLUR**2  # pixels whose mean has the variance that white noise has after that blur
_STEEPNESS = (1 - np.exp(-1 / _BLUR**2)) / 2  # squared gradient of blurred white noise, per variance
_LARGEST, _SMALL, _SMALLEST = (
    1_500_000,
    128,
    24,
)  # pixels: all of the largest copy; the longer side of correlated ones; the shorter side
_PEAKS, _APART = 3, 3  # how many shifts are tried, and pixels by which they differ
_MASKS = 1
_FARTHEST = 0.2  # fraction of a side: the largest shift that is looked for
_BORDER = 2  # pixels
_TILE = 32  # pixels of the largest copy; half as many of smaller ones
_ODD = 2.0, 0.1  # tiles do not count that leave more of the texture than twice the median, and than a tenth
_ITERATIONS, _STILL = 50, 1e-7  # of ECC: at most, and the change of the coefficient that ends them
_FLOOR = 0.03  # pixels: error of a tile's shift even without noise, from aliasing and filled pixels
_FAR, _ROUNDS = (
    9.0,
    12,
)  # squared deviations in units of their variance, from which on a tile counts clearly less; rounds of the fit
_STEP = 0.3  # pixels: how much local shifts differ from a node to the next (0.3 dB)
_LOCAL_ROUNDS, _LOCAL_FITS = 2, 3  # measurements on each of two levels, and rounds as above for local shifts
_VAGUE = 0.25  # pixels: a tile with this uncertainty has half the weight of a certain one
_NEAR, _OVERALL = 2, 0.02  # nodes: radius of the window in which local shifts are validated; weight of all other tiles there
_LOST, _WON = 0.4, 0.7  # share of a window's squared deviations that local shifts must explain to be taken at all, and in full
_LEAST = 0.2  # that share of all
_WEAK = 1e-6  # information: where nothing is known, there is no shift
_LEAST_AGREEMENT = 0.3  # another scene agrees by less
_MOST_ERROR = 0.5  # pixels
_TINY = float(np.finfo(np.float32).tiny)


@dataclass(frozen=True, eq=False)
class Alignment:
    """How a frame lies against the reference.

    motion: where the reference's points lie in the frame.
    gain: how many times as bright the frame is as the reference.
    error: estimated error of the frame's shift and rotation, pixels, root mean square over the frame.
    agreement: 0 to 1, the share of the reference's texture that the frame shows where the motion says.
    """

    motion: Motion
    gain: float
    error: float
    agreement: float


def align(reference: View, frame: View) -> Alignment:
    """Find the motion of a frame, compared with the reference.

    reference, frame: luminance of every pixel (`recover_luminance`). Clipped pixels do not count; noise decides only how much the
        two may differ.

    Raises InputError that says why, where the frame cannot be aligned: another size, another scene, or too little texture.
    """
    shapes = reference.luminance.shape, frame.luminance.shape
    if shapes[0] != shapes[1]:
        sizes = ["{1} x {0}".format(*shape) for shape in shapes[::-1]]
        raise InputError(f"{sizes[0]} pixels, expected {sizes[1]} like the reference")
    levels = list(_levels(reference, frame))[::-1]
    small = [level for level in levels if max(level.reference.shape) <= _SMALL] or levels[:1]
    starts = [Motion(shift).times(small[-1].scale / small[0].scale) for shift in _shifts(small[-1])]
    tried = [_on_larger_copies(small, start) for start in starts]
    motion = max(tried, key=lambda start: _tiles(small[-1], start).agreement)
    motion = _on_larger_copies(levels[len(small) - 1 :], motion)
    finest = levels[-1]
    for _ in range(2):
        tiles = _tiles(finest, motion)
        motion, error = _corrected(finest, tiles, motion)
    error *= finest.scale
    if not error <= _MOST_ERROR:
        raise InputError(f"cannot be aligned to {_MOST_ERROR} pixels: too little texture, or another scene")
    tiles = _tiles(finest, motion)
    motion = _with_local_shifts(levels[-2:], motion)
    if motion.local is not None:
        tiles = max(tiles, _tiles(finest, motion), key=lambda each: each.agreement)
    if tiles.agreement < _LEAST_AGREEMENT:
        share = (
            f"{100 * tiles.agreement:.0f} % of the picture agrees with the reference, at least {100 * _LEAST_AGREEMENT:.0f} % must"
        )
        raise InputError(f"another scene, or too little texture: {share}")
    return Alignment(motion.times(finest.scale), tiles.gain, error, tiles.agreement)


class _Level(NamedTuple):
    """Smoothed copies of both planes, NaN where a sample is clipped.

    scale: pixels of the frame per pixel of the copies. views: of the frames, for their noise. nodes: rows and columns of tiles, whose
    middles lie evenly from the first pixel to the last.
    """

    scale: int
    reference: FloatArray
    frame: FloatArray
    views: tuple[View, View]
    nodes: tuple[int, int]


def _levels(*views: View) -> Iterator[_Level]:
    """Smaller and smaller copies."""
    import cv2

    planes = [np.where(view.luminance < view.limit, view.luminance, np.float32(np.nan)) for view in views]
    scale = 1
    if planes[0].size > _LARGEST:
        planes, scale = [cv2.pyrDown(plane) for plane in planes], 2
    shape, tile = planes[0].shape, _TILE
    while True:
        nodes = max(round(shape[0] / tile) + 1, 2), max(round(shape[1] / tile) + 1, 2)
        yield _Level(scale, smoothed(planes[0], _BLUR), smoothed(planes[1], _BLUR), (views[0], views[1]), nodes)
        if min(planes[0].shape) < 2 * _SMALLEST:
            return
        tile = 2 * tile if planes[0].shape != shape else tile
        planes, scale = [cv2.pyrDown(plane) for plane in planes], 2 * scale


def _shifts(level: _Level) -> Iterator[tuple[float, float]]:
    """The shifts, down and across, from which the search starts."""
    import cv2

    yield 0.0, 0.0  # a large thing that moves may have the highest peak
    height, width = level.reference.shape
    down, across = int(_FARTHEST * height), int(_FARTHEST * width)
    middle = _filled(level.reference)[down : height - down, across : width - across]
    surface = cv2.matchTemplate(_filled(level.frame), middle, cv2.TM_CCOEFF_NORMED)
    for _ in range(_PEAKS):
        y, x = np.unravel_index(np.argmax(surface), surface.shape)
        yield float(y - down), float(x - across)
        surface[max(y - _APART, 0) : y + _APART + 1, max(x - _APART, 0) : x + _APART + 1] = -1
    window = cv2.createHanningWindow((width, height), cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate(*(plane - plane.mean() for plane in map(_filled, level[1:3])), window)
    if abs(x) <= across and abs(y) <= down:
        yield y, x


def _filled(plane: FloatArray) -> FloatArray:
    """The plane with clipped pixels as bright as the brightest of the others."""
    known = np.isfinite(plane)
    return np.where(known, plane, plane[known].max() if known.any() else 0)


def _on_larger_copies(levels: list[_Level], motion: Motion) -> Motion:
    """The motion on the last level from that on the first, where moving things do not count."""
    for level in levels:
        if level is not levels[0]:
            motion = motion.times(2)
        motion = _correlated(level, motion, _tiles(level, motion).counted)
        for _ in range(_MASKS):
            motion, _e = _corrected(level, _tiles(level, motion), motion)
    return motion


def _correlated(level: _Level, motion: Motion, counted: BoolArray) -> Motion:
    """The motion with the largest correlation coefficient. counted: which pixels of the reference do."""
    import cv2

    (height, width), centre = level.reference.shape, (np.array(level.reference.shape) - 1) / 2
    turn, start = motion.affine((height, width))
    warp = np.column_stack([turn[::-1, ::-1], start[::-1]]).astype(np.float32)  # of (x, y)
    mask = cv2.warpAffine((counted & np.isfinite(level.reference)).astype(np.uint8), warp, (width, height), flags=cv2.INTER_NEAREST)
    mask = cv2.erode(mask * np.isfinite(level.frame), np.ones((5, 5)), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    stop = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, _ITERATIONS, _STILL
    try:
        planes = _filled(level.reference), _filled(level.frame)
        warp = cv2.findTransformECC(*planes, warp, cv2.MOTION_EUCLIDEAN, stop, mask, 1)[1]
    except cv2.error:  # they do not correlate
        return motion
    turn, start = warp[::-1, 1::-1].astype(np.float64), warp[::-1, 2].astype(np.float64)
    down, across = start - centre + turn @ centre
    return Motion((float(down), float(across)), atan2(turn[1, 0], turn[0, 0])) if np.isfinite(warp).all() else motion


class _Tiles(NamedTuple):
    """A measurement; (R, C) tiles.

    shifts: (R, C, 2), how much farther (down, across) than the motion says the tiles lie, pixels of the copies.
    information: (R, C, 2, 2), inverse of the shifts' covariance: small where there is no texture, or along an edge, or where the
        two planes differ by more than a shift. The differences that the shift leaves say how much noise there is.
    agreement: see `Alignment`. gain: how many times as bright the frame is.
    counted: (H, W), pixels of the tiles that leave as little of the texture as most.
    """

    shifts: DoubleArray
    information: DoubleArray
    agreement: float
    gain: float
    counted: BoolArray


def _without_border(plane: FloatArray) -> FloatArray:
    """The plane with NaN at its border, which knows what lies beyond only mirrored."""
    inside, found = np.s_[_BORDER:-_BORDER, _BORDER:-_BORDER], np.full_like(plane, np.nan)
    found[inside] = plane[inside]
    return found


def _tiles(level: _Level, motion: Motion) -> _Tiles:
    """Measure how the tiles lie, compared with a motion."""
    import cv2

    own, seen = _without_border(level.reference), displaced(_without_border(level.frame), motion)
    height, width = own.shape
    valid = np.isfinite(own + seen)
    rows, columns = level.nodes
    above, before = round(height / (2 * rows - 2)), round(width / (2 * columns - 2))  # half a tile
    area = (height + 2 * above) * (width + 2 * before) / (rows * columns)

    def sums(plane: FloatArray) -> DoubleArray:
        whole = cv2.copyMakeBorder(plane, above, above, before, before, cv2.BORDER_CONSTANT, value=0)
        return area * cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float64)

    light, shown = (sums(np.where(valid, plane, 0)) for plane in (own, seen))
    lit = (light > 0) & (shown > 0)
    gain = float(np.median(shown[lit] / light[lit])) if lit.any() else 1.0
    down, across = np.gradient(own)
    valid &= np.isfinite(down + across)
    planes = [np.where(valid, plane, np.float32(0)) for plane in (down, across, seen / np.float32(gain) - own, own)]
    pixels = sums(valid.astype(np.float32))
    number = np.maximum(pixels, 1)
    means = [sums(plane) / number for plane in planes]

    def products(i: int, j: int) -> DoubleArray:
        return sums(planes[i] * planes[j]) - number * means[i] * means[j]

    squares = np.stack([products(0, 0), products(0, 1), products(0, 1), products(1, 1)], axis=-1).reshape(*pixels.shape, 2, 2)
    right, texture = np.stack([products(0, 2), products(1, 2)], axis=-1), np.maximum(products(3, 3), 0)
    least = 1e-6 * float(np.square(planes[3]).mean()) + _TINY  # differences below it are rounding
    shifts = -np.linalg.solve(squares + least * np.eye(2), right[..., None])[..., 0]
    rest = np.maximum(products(2, 2) + (right * shifts).sum(axis=-1), 0)
    noise = rest / np.maximum(pixels - 3, 1) + least
    # Half of the differences' noise is the reference's, and makes gradients of its own: by chance as much as this.
    chance = _STEEPNESS / 2 * noise * (pixels + DEVIATIONS * np.sqrt(_SPREAD * pixels))
    values, axes = np.linalg.eigh(squares - chance[..., None, None] * np.eye(2))
    information = (axes * (np.maximum(values, 0) / (noise * _SPREAD)[..., None])[..., None, :]) @ np.swapaxes(axes, -1, -2)

    variances = level.views[0].variance(means[3]), level.views[1].variance(means[3] * gain) / gain**2
    smooth = pixels / (_SPREAD * level.scale**2)
    texture = np.maximum(texture - smooth * variances[0], 0)
    differs = np.maximum(rest - smooth * (variances[0] + variances[1]), 0)
    contrast = np.sqrt(texture / number)
    weights = pixels * contrast / (contrast + max(float(contrast.mean()), _TINY))
    share = np.clip(1 - differs / np.maximum(texture, _TINY), 0, 1)
    odd = differs / (texture + smooth * (variances[0] + variances[1]) + _TINY)
    usual = odd <= max(_ODD[0] * float(np.median(odd)), _ODD[1])
    counted = cv2.resize(usual.astype(np.uint8), (width + 2 * before, height + 2 * above), interpolation=cv2.INTER_NEAREST) > 0
    counted = counted[above : above + height, before : before + width]
    return _Tiles(shifts, information, float((weights * share).sum() / max(weights.sum(), _TINY)), gain, counted)


def _corrected(level: _Level, tiles: _Tiles, motion: Motion) -> tuple[Motion, float]:
    """The motion corrected as most tiles agree, and the estimated error of the places in the frame, pixels of the copies."""
    shape, size = tiles.shifts.shape[:2], level.reference.shape
    middles = (np.linspace(-(side - 1) / 2, (side - 1) / 2, count) for count, side in zip(shape, size, strict=True))
    arm = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1) @ motion.affine((size[0], size[1]))[0].T
    jacobian = np.zeros((*shape, 2, 3))
    jacobian[..., 0, 0] = jacobian[..., 1, 1] = 1
    jacobian[..., 0, 2], jacobian[..., 1, 2] = -arm[..., 1], arm[..., 0]
    certain = _certain(tiles)
    turned = np.square(arm).sum(axis=-1).mean()
    known, weights = np.diag([1e-6, 1e-6, 1e-6 * (turned + 1)]), np.ones(shape)  # where nothing is known: no correction
    for _ in range(_ROUNDS):
        matrix = known + np.einsum("ab,abip,abij,abjq->pq", weights, jacobian, certain, jacobian, optimize=True)
        step = np.linalg.solve(matrix, np.einsum("ab,abip,abij,abj->p", weights, jacobian, certain, tiles.shifts, optimize=True))
        far = _squared(tiles.shifts - jacobian @ step, certain)
        weights = _counts(far)
    covariance = np.linalg.inv(matrix) * max(1.0, float((weights * far).sum() / max(2 * weights.sum(), 1)))
    error = float(np.sqrt(covariance[0, 0] + covariance[1, 1] + covariance[2, 2] * turned))
    return Motion((motion.shift[0] + step[0], motion.shift[1] + step[1]), motion.angle + float(step[2])), error


def _with_local_shifts(levels: list[_Level], motion: Motion) -> Motion:
    """The motion with local shifts, where the tiles agree on some. levels: the coarser one first; the motion is one on the last.

    Tiles agree where one half of them, chosen like the squares of a chessboard, predicts what the other half measures.
    """
    local = np.zeros((*levels[-1].nodes, 2))
    for level in levels * _LOCAL_ROUNDS:
        part = levels[-1].scale / level.scale
        tiles = _tiles(level, replace(motion, local=local.astype(np.float32)).times(part))
        shifts, certain = tiles.shifts + part * local, _certain(tiles)
        weights = np.ones(level.nodes)
        for _ in range(_LOCAL_FITS):
            field = _smooth(shifts, certain * weights[..., None, None])
            weights = _counts(_squared(shifts - field, certain))
        odd = np.indices(level.nodes).sum(axis=0) % 2
        halves = [_smooth(shifts, certain * (weights * half)[..., None, None]) for half in (1 - odd, odd)]
        vague = np.eye(2) / _VAGUE**2
        freedom = np.trace(np.linalg.solve(certain + vague, certain), axis1=2, axis2=3)  # 2, less where there is little texture
        without, left = (weights * _squared(rest, certain) for rest in (shifts, shifts - np.where(odd[..., None], *halves)))
        won, most = without - left, without + weights * freedom
        if won.sum() <= _LEAST * most.sum():
            return motion  # some windows out of many would agree by chance
        share = _window(won) / np.maximum(_window(most), _TINY)
        local = field * np.clip((share - _LOST) / (_WON - _LOST), 0, 1)[..., None] / part
    return replace(motion, local=local.astype(np.float32)) if local.any() else motion


def _certain(tiles: _Tiles) -> DoubleArray:
    """The tiles' information, with an error of `_FLOOR` added to each."""
    return np.asarray(np.linalg.solve(np.eye(2) + _FLOOR**2 * tiles.information, tiles.information), np.float64)


def _squared(shifts: DoubleArray, information: DoubleArray) -> DoubleArray:
    """Squared deviations in units of their variance: (R, C)."""
    return np.einsum("abi,abij,abj->ab", shifts, information, shifts)


def _counts(far: DoubleArray) -> DoubleArray:
    """Weights of tiles by squared deviations in units of their variance, as by Geman and McClure."""
    limit = max(_FAR, 4 * float(np.median(far)))
    return (limit / (limit + far)) ** 2


def _smooth(shifts: DoubleArray, information: DoubleArray) -> DoubleArray:
    """The shifts that fit the tiles' and differ little from node to node."""
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    count = shifts.shape[0] * shifts.shape[1]
    rows, columns = (sparse.diags([-1.0, 1.0], [0, 1], (size - 1, size)) for size in shifts.shape[:2])
    down, across = sparse.kron(rows, sparse.eye(shifts.shape[1])), sparse.kron(sparse.eye(shifts.shape[0]), columns)
    tie = sparse.kron(down.T @ down + across.T @ across, sparse.eye(2) / _STEP**2)
    own = sparse.bsr_matrix((information.reshape(count, 2, 2), np.arange(count), np.arange(count + 1)))
    right = np.einsum("abij,abj->abi", information, shifts).ravel()
    return np.asarray(spsolve((tie + own + _WEAK * sparse.eye(2 * count)).tocsc(), right), np.float64).reshape(shifts.shape)


def _window(values: DoubleArray) -> DoubleArray:
    """Sums over the window around each node, and a little of the sum over all: what decides where a window holds no texture."""
    size = 2 * _NEAR + 1
    return size**2 * uniform_filter(values, size, mode="constant") + _OVERALL * values.sum()
