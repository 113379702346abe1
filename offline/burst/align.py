"""Motion of a frame of a hand-held series against the reference: found from both, and applied to points and planes.

Coarse to fine: phase correlation finds the shift of small copies of both planes (Kuglin and Hines 1975). On each larger copy, every
tile then says how far its true place is from where the motion so far puts it (Lucas and Kanade 1981), and how certain that is. The
shift and rotation in which most tiles agree correct the motion, so that moving things do not pull it. Where neighbouring tiles
agree on something else (parallax), the motion gets local shifts.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError

from ..numerics.arrays import Doubles2, Doubles3, Floats2, Floats4
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.gaussian import smoothed
from ..numerics.interpolation import interpolated
from .motion import Motion

DEVIATIONS = 3.0
"""Standard deviations of noise that are tolerated: 0.3 % of Gaussian noise exceed them. Half of it costs 0.2 dB."""
TINY = 1e-12
"""Keeps divisions finite."""

# Chosen on drawn scenes. `python -m tests.benchmarks.alignment` measures on photographs.
_BLUR = 1.2  # pixels: standard deviation of the Gaussian that takes away what sampling and filled pixels add to texture
_SPREAD = 4 * np.pi * _BLUR**2  # pixels whose mean has the variance that white noise has after that blur
_STEEPNESS = (1 - np.exp(-1 / _BLUR**2)) / 2  # squared gradient of blurred white noise, per variance
_LARGEST, _SMALLEST = 1_500_000, 24  # pixels: larger planes are compared at half their size; shorter side of the smallest copy
_CORRELATED, _PEAKS, _APART = 128, 3, 3  # pixels: longer side of correlated copies; shifts that are tried, pixels between them
_FARTHEST = 0.2  # fraction of a side: the largest shift that is looked for
_TILE, _COARSE_TILE = 32, 16  # pixels of the largest copy, and of smaller ones
_FLOOR = 0.03  # pixels: error of a tile's shift even without noise, from aliasing and filled pixels
_FAR, _FITS = 9.0, 12  # squared deviations, of their variance, from which on a tile counts clearly less; rounds that find them
_STEPS, _STILL = 8, 1e-2  # corrections on each copy at most, until one is smaller, pixels of the copy
_LOCAL_STEPS = 2  # measurements of local shifts on each of the two largest copies
_NEAR, _WINDOW = 0.7, 2.0  # nodes: standard deviations of neighbourhoods that share local shifts, and in which these are judged
_VAGUE = 0.25  # pixels: a tile with this uncertainty has half the weight of a certain one
_LOST, _WON = 0.4, 0.7  # share of squared deviations that local shifts must explain to be taken at all, and in full
_LEAST = 0.2  # that share of all
_LEAST_AGREEMENT = 0.3  # another scene agrees by less
_MOST_ERROR = 0.5  # pixels
_ROUNDS = 5  # that invert local shifts, which differ by less than 0.1 from pixel to pixel: each divides the error by 10 or more


@dataclass(frozen=True, eq=False)
class View:
    """Luminance as one frame shows it.

    luminance: float32 (H, W), scene units.
    noise: of its samples; None = there is none, or it is unknown.
    limit: scene units from which on it is clipped.
    """

    luminance: FloatArray
    noise: NoiseModel | None = None
    limit: float = np.inf

    def variance(self, light: Any) -> Any:
        """Variance of panchromatic samples that see some light."""
        return self.noise.variance(np.asarray(light)) if self.noise else np.zeros_like(light)


class Motions(NamedTuple):
    """Motions of F frames for kernels, see `Motion`.

    turns: (F, 2, 2). starts: (F, 2). shifts: (F, node rows, node columns, 2), 1 x 1 nodes if there are none. spacing: nodes per
    pixel, down and across.
    """

    turns: Doubles3
    starts: Doubles2
    shifts: Floats4
    spacing: tuple[float, float]

    @classmethod
    def of(cls, motions: Sequence[Motion], shape: tuple[int, ...]) -> "Motions":
        """Motions of frames of this shape, whose local shifts have the same nodes."""
        turns, starts = zip(*(motion.affine(shape) for motion in motions), strict=True)
        nodes = next((motion.local.shape for motion in motions if motion.local is not None), (1, 1, 2))
        shifts = np.array([np.zeros(nodes) if motion.local is None else motion.local for motion in motions], np.float32)
        spacing = [(count - 1) / max(size - 1, 1) for count, size in zip(nodes, shape, strict=False)]
        return cls(np.array(turns), np.array(starts), shifts, (spacing[0], spacing[1]))


@kernel
def frame_place(motions: Motions, frame: int, y: float, x: float) -> tuple[float, float]:
    """Place in a frame of the point (y, x) of the reference."""
    turn, start, local = motions.turns[frame], motions.starts[frame], _local_shift(motions, frame, y, x)
    return turn[0, 0] * y + turn[0, 1] * x + start[0] + local[0], turn[1, 0] * y + turn[1, 1] * x + start[1] + local[1]


@kernel
def reference_place(motions: Motions, frame: int, y: float, x: float) -> tuple[float, float]:
    """Place in the reference of the point (y, x) of a frame: turn^T (point - start - local shift), iterated."""
    turn, down, across = motions.turns[frame], y - motions.starts[frame, 0], x - motions.starts[frame, 1]
    place = turn[0, 0] * down + turn[1, 0] * across, turn[0, 1] * down + turn[1, 1] * across
    for _ in range(_ROUNDS if motions.shifts.shape[1] > 1 else 0):
        local = _local_shift(motions, frame, place[0], place[1])
        v, u = down - local[0], across - local[1]
        place = turn[0, 0] * v + turn[1, 0] * u, turn[0, 1] * v + turn[1, 1] * u
    return place


@kernel
def _local_shift(motions: Motions, frame: int, y: float, x: float) -> tuple[float, float]:
    """Local shift at a point of the reference, bilinear; beyond the outermost nodes it is theirs."""
    rows, columns = motions.shifts.shape[1], motions.shifts.shape[2]
    if rows < 2:
        return 0.0, 0.0
    y, x = min(max(y * motions.spacing[0], 0.0), rows - 1.0), min(max(x * motions.spacing[1], 0.0), columns - 1.0)
    top, left = min(int(y), rows - 2), min(int(x), columns - 2)
    down, across = y - top, x - left
    upper, lower = motions.shifts[frame, top], motions.shifts[frame, top + 1]
    a, b, c, d = (1 - down) * (1 - across), (1 - down) * across, down * (1 - across), down * across
    v = a * upper[left, 0] + b * upper[left + 1, 0] + c * lower[left, 0] + d * lower[left + 1, 0]
    u = a * upper[left, 1] + b * upper[left + 1, 1] + c * lower[left, 1] + d * lower[left + 1, 1]
    return v, u


@parallel_kernel()
def map_points(pieces: Pieces, motions: Motions, points: Doubles2, inverse: int, out: Floats2) -> None:
    """Write the places in a frame of points (N, 2) of the reference, or with `inverse` the other way. motions: one."""
    for point in range(pieces[0], pieces[1]):
        y, x = points[point, 0], points[point, 1]
        out[point, 0], out[point, 1] = reference_place(motions, 0, y, x) if inverse else frame_place(motions, 0, y, x)


@parallel_kernel()
def displace(pieces: Pieces, plane: Floats2, motions: Motions, out: Floats2) -> None:
    """Write a frame's plane, (H, W), as the reference would see it; NaN where the frame sees nothing. motions: one."""
    height, width = plane.shape
    for row in range(pieces[0], pieces[1]):
        for column in range(width):
            y, x = frame_place(motions, 0, float(row), float(column))
            inside = -0.5 <= y < height - 0.5 and -0.5 <= x < width - 0.5
            out[row, column] = interpolated(plane, y, x) if inside else np.float32(np.nan)


def in_frame(motion: Motion, y: Any, x: Any, shape: tuple[int, ...]) -> FloatArray:
    """Places (down, across) in a frame of points (y, x) of the reference, pixels; float32 (2, *points).

    y, x: arrays of one shape, or that NumPy brings to one. shape: (H, W) of both frames. Points and places may lie outside.

    >>> from offline.burst import Motion, in_frame
    >>> in_frame(Motion((2.0, -1.0)), 10, 20, (101, 101)).tolist()
    [12.0, 19.0]
    """
    return _mapped(motion, y, x, shape, 0)


def in_reference(motion: Motion, y: Any, x: Any, shape: tuple[int, ...]) -> FloatArray:
    """Places in the reference of points of a frame: the inverse of `in_frame`."""
    return _mapped(motion, y, x, shape, 1)


def _mapped(motion: Motion, y: Any, x: Any, shape: tuple[int, ...], inverse: int) -> FloatArray:
    points = np.stack(np.broadcast_arrays(y, x), axis=-1).astype(np.float64)
    places = np.empty((points.size // 2, 2), np.float32)
    map_points(Motions.of([motion], shape), points.reshape(-1, 2), inverse, places)
    return np.moveaxis(places.reshape(points.shape), -1, 0)


def displaced(plane: FloatArray, motion: Motion) -> FloatArray:
    """A frame's plane (H, W) as the reference would see it; NaN where the frame sees nothing."""
    result = np.empty(plane.shape, np.float32)
    displace(plane, Motions.of([motion], plane.shape), result)
    return result


@dataclass(frozen=True, eq=False)
class Alignment:
    """Motion of a frame against the reference.

    motion: where the reference's points lie in the frame.
    gain: how many times as bright the frame is as the reference.
    error: estimated error of the frame's shift and rotation, pixels, root mean square over the frame.
    agreement: 0 to 1, the share of the reference's texture that the frame shows where the motion says.
    """

    motion: Motion
    gain: float = 1.0
    error: float = 0.0
    agreement: float = 1.0


def align(reference: View, frame: View) -> Alignment:
    """Find the motion of a frame, compared with the reference.

    reference, frame: luminance of every pixel (`recover_luminance`). Clipped pixels do not count; noise decides only how much the
        two may differ.

    Raises InputError that says why, where the frame cannot be aligned: another size, another scene, or too little texture.
    """
    result = find_motion(reference, frame)
    if isinstance(result, str):
        raise InputError(result)
    return result


def find_motion(reference: View, frame: View) -> Alignment | str:
    """Return what `align` returns, or why the frame cannot be aligned."""
    shapes = reference.luminance.shape, frame.luminance.shape
    if shapes[0] != shapes[1]:
        sizes = ["{1} x {0}".format(*shape) for shape in shapes[::-1]]
        return f"{sizes[0]} pixels, expected {sizes[1]} like the reference"
    if min(shapes[0]) < _SMALLEST // 2:
        return f"{shapes[0][1]} x {shapes[0][0]} pixels are too few to be aligned"
    copies = list(_copies(reference, frame))[::-1]
    small = [copy for copy in copies if max(copy.reference.shape) <= _CORRELATED] or copies[:1]
    scale = small[-1].scale / small[0].scale
    tried = [_refined(small, Motion(shift).times(scale)) for shift in _shifts(small[-1])]
    best = max(tried, key=lambda fit: fit.tiles.agreement)
    best = _refined(copies[len(small) :], best.motion.times(2)) if copies[len(small) :] else best
    scale = copies[-1].scale
    if not best.error * scale <= _MOST_ERROR:
        return f"cannot be aligned to {_MOST_ERROR} pixels: too little texture, or another scene"
    motion, agreement, local = best.motion, best.tiles.agreement, _local_shifts(copies[-2:], best.motion)
    if local.any():
        motion = replace(motion, local=local)
        agreement = max(agreement, copies[-1].tiles(motion).agreement)
    if agreement < _LEAST_AGREEMENT:
        share = f"{100 * agreement:.0f} % of the picture agrees with the reference, at least {100 * _LEAST_AGREEMENT:.0f} % must"
        return f"another scene, or too little texture: {share}"
    return Alignment(motion.times(scale), best.tiles.gain, best.error * scale, agreement)


class _Tiles(NamedTuple):
    """A measurement of the tiles around (R, C) nodes, which lie evenly from the first pixel to the last.

    shifts: (R, C, 2), how much farther (down, across) than the motion says the tiles lie, pixels of the copies.
    information: (R, C, 2, 2), inverse of the shifts' covariance: small where there is no texture, or along an edge, or where the
        two planes differ by more than a shift. The differences that the shift leaves say how much noise there is.
    gain, agreement: see `Alignment`.
    """

    shifts: DoubleArray
    information: DoubleArray
    gain: float
    agreement: float


class _Fit(NamedTuple):
    """A motion, the last measurement of tiles, and the estimated error; pixels of the copies."""

    motion: Motion
    tiles: _Tiles
    error: float


class _Copies(NamedTuple):
    """Smaller, smooth copies of both planes; NaN at the border, and where a sample is clipped.

    scale: pixels of the frame per pixel. nodes: of its tiles. views: of the frames, for their noise.
    """

    scale: int
    reference: FloatArray
    frame: FloatArray
    nodes: tuple[int, int]
    views: tuple[View, View]

    def tiles(self, motion: Motion) -> _Tiles:
        """Measure how the tiles lie, compared with a motion."""
        down, across, light, difference = range(4)
        planes = np.stack([*np.gradient(self.reference), self.reference, displaced(self.frame, motion)])
        finite = np.isfinite(planes).all(axis=0)
        planes[:, ~finite] = 0
        pixels, own, other = self.around(finite), self.around(planes[light]), self.around(planes[difference])
        lit, number = (own > 0) & (other > 0), np.maximum(pixels, 1)
        gain = float(np.median(other[lit] / own[lit])) if lit.any() else 1.0
        planes[difference] = planes[difference] / np.float32(gain) - planes[light]
        means = self.around(planes) / number
        least = 1e-6 * float(np.square(planes[light]).mean()) + TINY  # differences below it are rounding

        def products(one: int, other: int) -> DoubleArray:
            return self.around(planes[one] * planes[other]) - number * means[one] * means[other]

        squares = np.empty((*self.nodes, 2, 2))
        squares[..., 0, 0], squares[..., 1, 1] = products(down, down), products(across, across)
        squares[..., 0, 1] = squares[..., 1, 0] = products(down, across)
        right = np.stack([products(down, difference), products(across, difference)], axis=-1)
        shifts = -_solved(squares + least * np.eye(2), right)
        rest = np.maximum(products(difference, difference) + (right * shifts).sum(axis=-1), 0)
        noise = rest / np.maximum(pixels - 3, 1) + least
        # Half of the differences' noise is the reference's, and makes gradients of its own: by chance as much as this.
        chance = _STEEPNESS / 2 * noise * (pixels + DEVIATIONS * np.sqrt(_SPREAD * pixels))
        values, axes = np.linalg.eigh(squares - chance[..., None, None] * np.eye(2))
        information = np.maximum(values, 0) / (noise * _SPREAD)[..., None]
        information /= 1 + _FLOOR**2 * information
        information = (axes * information[..., None, :]) @ np.swapaxes(axes, -1, -2)

        smooth = pixels / (_SPREAD * self.scale**2)
        first, second = (smooth * view.variance(means[light] * factor) for view, factor in zip(self.views, (1, gain), strict=True))
        texture = np.maximum(products(light, light) - first, 0)
        differs = np.maximum(rest - first - second / gain**2, 0)
        contrast = np.sqrt(texture / number)
        weights = pixels * contrast / (contrast + max(float(contrast.mean()), TINY))
        share = np.clip(1 - differs / np.maximum(texture, TINY), 0, 1)  # of the texture, beyond noise, that the frame shows too
        return _Tiles(shifts, information, gain, float((weights * share).sum() / max(weights.sum(), TINY)))

    def around(self, planes: FloatArray | BoolArray) -> DoubleArray:
        """Sums of planes (..., H, W) over the pixels nearest to each node."""
        sums = planes.astype(np.float32, copy=False)
        for axis, count in zip((-2, -1), self.nodes, strict=True):
            middles = (np.arange(count - 1) + 0.5) * ((planes.shape[axis] - 1) / (count - 1))
            sums = np.add.reduceat(sums, np.r_[0, np.ceil(middles).astype(np.intp)], axis)
        return sums.astype(np.float64)


def _copies(*views: View) -> Iterator[_Copies]:
    """Smaller and smaller copies."""
    planes = [np.where(view.luminance < view.limit, view.luminance, np.float32(np.nan)) for view in views]
    shape, scale = planes[0].shape, 1
    first = 2 if planes[0].size > _LARGEST else 1
    while scale <= first or min(planes[0].shape) >= _SMALLEST:
        if scale >= first:
            smooth = [np.pad(smoothed(plane, _BLUR)[1:-1, 1:-1], 1, constant_values=np.nan) for plane in planes]
            tile = _TILE * first if scale == first else _COARSE_TILE * scale
            nodes = max(round(shape[0] / tile) + 1, 2), max(round(shape[1] / tile) + 1, 2)
            yield _Copies(scale, smooth[0], smooth[1], nodes, (views[0], views[1]))
        planes, scale = [_halved(plane) for plane in planes], 2 * scale


def _halved(plane: FloatArray) -> FloatArray:
    """Means of 2 x 2 pixels."""
    height, width = (size // 2 * 2 for size in plane.shape)
    rows = plane[:height:2, :width] + plane[1:height:2, :width]
    return np.float32(0.25) * (rows[:, ::2] + rows[:, 1::2])


def _shifts(copies: _Copies) -> Iterator[tuple[float, float]]:
    """The most probable shifts, pixels of the copies."""
    shape = copies.frame.shape
    window = np.outer(*(np.hanning(size + 2)[1:-1] for size in shape))
    planes = [np.ma.masked_invalid(plane) for plane in (copies.reference, copies.frame)]
    spectra = [np.fft.rfft2((plane - plane.mean()).filled(0) * window) for plane in planes]
    cross = np.conj(spectra[0]) * spectra[1]
    cross /= np.maximum(np.abs(cross), 1e-3 * np.abs(cross).mean() + TINY)
    y, x = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])
    surface = np.fft.irfft2(cross * np.exp(-2 * np.pi**2 * (y**2 + x**2)), shape)  # a Gaussian of one pixel
    rows, columns = (np.rint(np.fft.fftfreq(size) * size) for size in shape)
    surface[np.abs(rows) > _FARTHEST * shape[0]] = -np.inf
    surface[:, np.abs(columns) > _FARTHEST * shape[1]] = -np.inf
    yield 0.0, 0.0  # a large thing that moves may have the highest peaks
    for _ in range(_PEAKS):
        row, column = np.unravel_index(np.argmax(surface), shape)
        yield float(rows[row]), float(columns[column])
        surface[np.ix_(np.abs(rows - rows[row]) <= _APART, np.abs(columns - columns[column]) <= _APART)] = -np.inf


def _refined(levels: list[_Copies], motion: Motion) -> _Fit:
    """The motion on the last copies from that on the first."""
    for level in levels:
        motion = motion if level is levels[0] else motion.times(2)
        for _ in range(_STEPS):
            before, fit = motion, _corrected(level, motion, level.tiles(motion))
            motion, moved = fit.motion, np.hypot(*np.subtract(fit.motion.shift, before.shift))
            if moved + abs(motion.angle - before.angle) * np.hypot(*level.reference.shape) / 2 < _STILL:
                break
    return fit


def _corrected(level: _Copies, motion: Motion, tiles: _Tiles) -> _Fit:
    """The motion corrected as most tiles agree."""
    shape = level.reference.shape
    places = (np.linspace(-(size - 1) / 2, (size - 1) / 2, count) for size, count in zip(shape, level.nodes, strict=True))
    arm = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1) @ motion.affine(shape)[0].T
    length = float(np.square(arm).sum(axis=-1).mean()) ** 0.5 + TINY
    jacobian = np.zeros((*level.nodes, 2, 3))  # of down and across, by a shift and by the turn that moves tiles by a pixel
    jacobian[..., 0, 0] = jacobian[..., 1, 1] = 1
    jacobian[..., 0, 2], jacobian[..., 1, 2] = -arm[..., 1] / length, arm[..., 0] / length
    matrices = np.swapaxes(jacobian, -1, -2) @ tiles.information
    squares, right = matrices @ jacobian, (matrices @ tiles.shifts[..., None])[..., 0]
    weights = np.ones(level.nodes)
    for _ in range(_FITS):
        matrix = np.einsum("ab,abpq->pq", weights, squares) + 1e-6 * np.eye(3)  # where nothing is known: no correction
        step = np.linalg.solve(matrix, np.einsum("ab,abp->p", weights, right))
        far = _squared(tiles.shifts - jacobian @ step, tiles.information)
        weights = _counts(far)
    scatter = max(1.0, float((weights * far).sum() / max(2 * weights.sum(), 1)))
    error = float(np.trace(np.linalg.inv(matrix)) * scatter) ** 0.5
    shift = motion.shift[0] + float(step[0]), motion.shift[1] + float(step[1])
    return _Fit(Motion(shift, motion.angle + float(step[2]) / length), tiles, error)


def _local_shifts(levels: list[_Copies], motion: Motion) -> FloatArray:
    """Local shifts of the nodes of the last copies, (R, C, 2), pixels of them: 0 where the tiles do not agree on others.

    Tiles agree where one half of them, chosen like the squares of a chessboard, predicts what the other half measures.
    """
    local = np.zeros((*levels[-1].nodes, 2), np.float32)
    for level in [level for level in levels for _ in range(_LOCAL_STEPS)]:
        part = levels[-1].scale / level.scale
        tiles = level.tiles(replace(motion, local=local).times(part))
        shifts, information = tiles.shifts + part * local, tiles.information
        weights = _counts(_squared(shifts - _shared(shifts, information), information))
        odd = np.indices(level.nodes).sum(axis=0) % 2
        halves = [_shared(shifts, information * (weights * half)[..., None, None]) for half in (1 - odd, odd)]
        without, left = (weights * _squared(rest, information) for rest in (shifts, shifts - np.where(odd[..., None], *halves)))
        freedom = np.trace(np.linalg.solve(information + np.eye(2) / _VAGUE**2, information), axis1=2, axis2=3)  # 2 at most
        won, most = without - left, without + weights * freedom
        share = smoothed(won, _WINDOW) / (smoothed(most, _WINDOW) + TINY) if won.sum() > _LEAST * most.sum() else np.zeros_like(won)
        field = _shared(shifts, information * weights[..., None, None])
        local = (field / part * np.clip((share - _LOST) / (_WON - _LOST), 0, 1)[..., None]).astype(np.float32)
        if not local.any():
            break  # nor would the next measurement find any
    return local


def _shared(shifts: DoubleArray, information: DoubleArray) -> DoubleArray:
    """The shifts that the tiles around each node agree on most."""
    right = (information @ shifts[..., None])[..., 0]
    near = np.moveaxis(smoothed(np.moveaxis(right, 2, 0), _NEAR), 0, 2)
    total = np.moveaxis(smoothed(np.moveaxis(information, (2, 3), (0, 1)), _NEAR), (0, 1), (2, 3))
    return _solved(total + 1e-3 * np.eye(2), near)


def _solved(matrices: DoubleArray, right: FloatArray | DoubleArray) -> DoubleArray:
    """Solutions of systems of two equations, (R, C, 2, 2) and (R, C, 2)."""
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0], np.float64)


def _squared(shifts: DoubleArray, information: DoubleArray) -> DoubleArray:
    """Squared deviations in units of their variance: (R, C)."""
    return np.einsum("abi,abij,abj->ab", shifts, information, shifts)


def _counts(far: DoubleArray) -> DoubleArray:
    """Weights of tiles by squared deviations in units of their variance, as by Geman and McClure."""
    limit = max(_FAR, 4 * float(np.median(far)))
    return (limit / (limit + far)) ** 2
