"""Shading from flat frames: a smooth gain for each plane, and the reasons why flat frames may not
determine it.

An evenly lit surface shows the shading itself. Uneven light differs from shading only by what
lenses do: they darken the picture around a centre near its middle. So light that is brighter on one
side, in all or in one colour, and a centre far off, are refused, and so are frames that differ
among each other, and what no smooth map describes.

Flat frames have few colour samples. How a colour differs from panchromatic varies less over the
frame than the light itself, so that its map has fewer control points.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ...shared import DoubleArray, InputError, Mosaic, Shading
from ...shared.shading import ZOOMED, basis
from .places import CLIP, CLIPPED, FEW, Named, cut_windows, inliers, levels_of, planes_of

# Periods along a side of a window, at least, and windows along an axis.
_PERIODS, _FEWEST, _MOST = 5, 3, 48
_KNOWN = 0.7  # of the windows: fewer do not tell a smooth gain everywhere
# Control points of the panchromatic gain, and of a colour's relative to it.
_POINTS, _COLOUR_POINTS = (13, 17), (6, 7)
# Third differences of control points that are likely: large in the corners of fast lenses.
_ROUGH, _COLOUR_ROUGH = 5.0, 0.05
_LEAST_ERROR = 1e-4  # share of the light: no flat frame is more exact
_WORST = 0.01  # standard error of the gain, as a share: beyond it the frames are too dark
_NOISE = 1.3  # times the noise that windows show of themselves: they do not know it better
_RESIDUAL = 0.005  # share of the light, beyond noise: more is no shading
# Share by which one side may be brighter than the other: all light, or a colour compared with it.
# At the sides either moves no patch of a ColorChecker by more than 1.1 dE2000.
_LIGHT_TILT, _TILT = 0.1, 0.03
_CENTRE = 0.05  # of the diagonal
_CLEARLY = 0.8  # times the residual: a displaced centre explains the frames better than a tilt
_EVEN, _ERRORS = 0.02, 4.0  # as a share, and in standard errors: less than this is no shading
_CLIPPED_FRACTION = 2e-3  # of the samples of a plane: more of them, and it is not just defects
_STRIPS = 4  # of an axis, in which frames are compared with each other
# share by which the light of a frame may fall off in another way than that of all together
_OTHERWISE = 0.03
# of the light of the brightest frame: in dimmer ones, which count little, black level decides how
# it falls off
_COUNTS = 0.1
Size = tuple[int, ...]
"""Rows and columns."""


@dataclass(frozen=True, eq=False)
class ShadingResult:
    """Shading that flat frames show.

    Attributes
    ----------
    shading : Shading | None
        None = none was found.
    frames : int
        Number of frames that it comes from; those that are clipped are left out.
    error : float
        Standard error of the gain where it is known worst, as a share, if the black level is right.
    """

    shading: Shading | None
    frames: int
    error: float

    @property
    def words(self) -> str:
        """The shading, for people."""
        frames = f"{self.frames} flat frame{'s' * (self.frames > 1)}"
        error = f"to ±{100 * self.error:.2g} % (standard error)"
        if (lens := self.shading) is None:
            return f"no shading: {frames}, even {error}"
        residual = f"{100 * lens.residual:.2g} %" if lens.residual else "none beyond noise"
        return f"shading: {lens.words}, known {error} from {frames}, residual: {residual}"


class _Windows(NamedTuple):
    """Light in the windows of a frame that have samples of all planes; per plane and window.

    number: rows and columns of windows, these and others.
    middle: (2, P, N), row and column of the middle of the plane's samples, pixels.
    gain: (P, N), by which its light was multiplied.
    light: (P, N), mean after that.
    error: (P, N), standard error of the mean.
    """

    number: tuple[int, int]
    middle: DoubleArray
    gain: DoubleArray
    light: DoubleArray
    error: DoubleArray


def measure_shading(frames: Sequence[Named]) -> ShadingResult:
    """Measure the shading that evenly lit frames show.

    frames: name and frame, all of one camera and of equal size; their calibration has no shading.
    Raises InputError with the reason if they do not determine it.
    """
    pattern, shape = frames[0][1].pattern, frames[0][1].shape
    least = _FEWEST * _PERIODS * pattern.period
    if min(shape) < least:
        needed = f"along each side it takes {least}, {_FEWEST * _PERIODS} periods of the pattern"
        raise InputError(f"flat frames: {shape[1]} x {shape[0]} pixels do not tell it; {needed}")
    focal = _common_focal_length(frames)
    light, falloffs = _mean_of_unclipped(frames)
    shading, error = Shading(np.ones((len(pattern.planes), 4, 4)), shape, focal), 0.0  # type: ignore[arg-type]
    # The second round sees windows that are nearly even, whose means are those of their middles.
    for _ in range(2):
        windows = _measured(light, frames[0][1], shading)
        if windows.light.shape[1] < _KNOWN * math.prod(windows.number):
            most = "most of their windows are without samples of each filter"
            raise InputError(f"flat frames: {most}; fewer defects can be listed")
        if windows.light.min() <= 0:
            remedy = "expose more, up to three quarters of full scale, and cut masked borders off"
            raise InputError(f"flat frames: they are dark, at least in places; {remedy}")
        shading, error = _refined(shading, windows)
    _check_alike(falloffs)
    left = _measured(light, frames[0][1], shading)
    _check_light(left, shading, pattern.channels)
    share = left.light / left.light.mean(axis=1, keepdims=True) - 1
    beyond = (share**2).mean(axis=1) - _NOISE * ((left.error / left.light) ** 2).mean(axis=1)
    residuals = np.sqrt(np.maximum(beyond, 0)).tolist()  # root mean square, of each plane
    residual, letter = max(zip(residuals, pattern.planes, strict=True))
    if residual > _RESIDUAL:
        off = f"{100 * residual:.2g} % from any smooth shading, {100 * _RESIDUAL:.1f} % are allowed"
        remedy = "take an evenly lit surface without texture, out of focus"
        raise InputError(f"flat frames: in {letter} they differ by {off}; {remedy}")
    is_even = float(np.abs(shading.sketch - 1).max()) < max(_EVEN, _ERRORS * error)
    rounded = None if is_even else replace(shading, residual=float(f"{residual:.2g}"))
    return ShadingResult(rounded, len(falloffs), error)


def _common_focal_length(frames: Sequence[Named]) -> float | None:
    """Return the common focal length of flat frames, millimetres, None if unknown. Raises
    InputError if they differ.
    """
    stated = ((frame.metadata.focal_length, name) for name, frame in frames)
    known = sorted((length, name) for length, name in stated if length is not None)
    if not known:
        return None
    (shortest, one), (longest, other) = known[0], known[-1]
    if longest > shortest * (1 + ZOOMED):
        lengths = f"{one} is taken at {shortest:g} mm, {other} at {longest:g} mm"
        raise InputError(f"flat frames: {lengths}; take all at one focal length")
    return shortest


def _mean_of_unclipped(frames: Sequence[Named]) -> tuple[DoubleArray, dict[str, DoubleArray]]:
    """Return the mean of the frames that are not clipped, (H, W), and, by name, the panchromatic
    light in strips of each.

    Raises InputError if all are clipped.
    """
    pattern, shape = frames[0][1].pattern, frames[0][1].shape
    planes, letters = planes_of(frames[0][1]), pattern.planes
    number, clear = np.bincount(planes.ravel())[: len(letters)], planes == len(letters) - 1
    down, right = (np.linspace(0, length, _STRIPS, endpoint=False).astype(int) for length in shape)
    total, falloffs, clipped = np.zeros(shape), {}, []
    for name, frame in frames:
        levels = levels_of(frame)
        of_planes = np.bincount(planes[levels >= CLIPPED], minlength=number.size)
        shares = of_planes[: number.size] / number
        if shares.max() > _CLIPPED_FRACTION:
            clipped.append((float(shares.max()), letters[int(shares.argmax())], name))
            continue
        total += levels
        strips = np.add.reduceat(np.where(clear, levels, 0), down, dtype=np.float64)
        falloffs[name] = np.add.reduceat(strips, right, axis=1)
    if not falloffs:
        share, letter, name = min(clipped)
        least = f"{name} is least so, in {100 * share:.3g} % of the samples of {letter}"
        remedy = "expose less, so that the brightest read about three quarters of full scale"
        raise InputError(f"flat frames: all are clipped; {least}; {remedy}")
    return total / len(falloffs), falloffs


def _check_alike(falloffs: dict[str, DoubleArray]) -> None:
    """Raise InputError if the light of a frame falls off in another way than that of all; falloffs:
    see `_mean_of_unclipped`.
    """
    together = np.sum(list(falloffs.values()), axis=0)
    brightest = max(falloff.mean() for falloff in falloffs.values())
    for name, falloff in falloffs.items():
        if falloff.mean() < _COUNTS * brightest:
            continue
        unlike = float(np.ptp(falloff / falloff.mean() / (together / together.mean())))
        if unlike > _OTHERWISE:
            way = f"the light of {name} falls off in another way than that of all together"
            much = f"by {100 * unlike:.1f} %, {100 * _OTHERWISE:.0f} % are allowed"
            remedy = "take all with the same lens, focal length, aperture and light"
            raise InputError(f"flat frames: {way}, {much}; {remedy}")


def _measured(light: DoubleArray, frame: Mosaic, shading: Shading) -> _Windows:
    """Measure the light of a frame like this one, (H, W), in windows, with the shading undone as
    far as it is known.
    """
    shape, pattern, planes = frame.shape, frame.pattern, planes_of(frame)
    down, right = (min(length // (_PERIODS * pattern.period), _MOST) for length in shape)
    measured = np.zeros((5, len(shading.gain), down * right))
    for plane in range(len(shading.gain)):
        gain = shading.of_plane(shape, plane)
        for number, window in enumerate(cut_windows(shape, (down, right))):
            rows, columns = np.nonzero(planes[window] == plane)
            values = (light[window] * gain[window])[rows, columns]
            if len(values) < FEW:  # the others are defects
                measured[:, plane, number] = np.nan
                continue
            off = values - np.median(values)
            kept = values[inliers(off, float(np.abs(off).std()) / CLIP)]
            mean = float(kept.mean())
            # Second differences do not see light that falls off.
            error = max(np.diff(kept, 2).std() / (6 * len(kept)) ** 0.5, _LEAST_ERROR * mean)
            middle = window[0].start + rows.mean(), window[1].start + columns.mean()
            measured[:, plane, number] = *middle, gain[window][rows, columns].mean(), mean, error
    known = measured[:, :, np.isfinite(measured).all(axis=(0, 1))]
    return _Windows((down, right), known[:2], *known[2:])


def _refined(shading: Shading, windows: _Windows) -> tuple[Shading, float]:
    """Return the shading that also undoes what is left in the windows, and the standard error of
    its gain, as a share.

    Raises InputError if that is too large.
    """
    enough = np.array(windows.number) // 3 + 3
    full, low = (tuple(np.minimum(most, enough).tolist()) for most in (_POINTS, _COLOUR_POINTS))
    missing, errors = windows.gain / windows.light, windows.error / windows.light
    size = shading.size
    design = _design(size, full, windows.middle[:, -1])
    panchromatic, error = _spline(design, full, missing[-1], errors[-1], _ROUGH)
    # Where a colour's samples are in the windows, and how the product of two splines becomes one.
    places = [np.linspace(0, size[axis] - 1, 4 * full[axis]) for axis in (0, 1)]
    down, right = (basis(size[axis], full[axis], places[axis]) for axis in (0, 1))
    of_colour, at = (basis(size[axis], low[axis], places[axis]) for axis in (0, 1))
    gains = []
    for plane in range(len(missing) - 1):
        middle = windows.middle[:, plane]
        target = missing[plane] / _values(panchromatic, size, middle)
        design = _design(size, low, middle)
        relative, own = _spline(design, low, target, errors[plane], _COLOUR_ROUGH)
        error = max(error, own)
        gain = (down @ panchromatic @ right.T) * (of_colour @ relative @ at.T)
        gains.append(np.linalg.pinv(down) @ gain @ np.linalg.pinv(right).T)
    if not error <= _WORST:
        known = f"±{100 * error:.1f} % (standard error), {100 * _WORST:.0f} % are allowed"
        fault = f"they are too dark, and tell the shading only to {known}"
        remedy = "expose more, up to three quarters of full scale, or take more"
        raise InputError(f"flat frames: {fault}; {remedy}")
    centre = np.array([[(length - 1) / 2] for length in size])
    scaled = [(gain / _values(gain, size, centre)[0]).tolist() for gain in (*gains, panchromatic)]
    rounded = [[[float(f"{x:.6g}") for x in row] for row in gain] for gain in scaled]
    return replace(shading, gain=rounded), error  # type: ignore[arg-type]


def _spline(
    design: DoubleArray, points: Size, target: DoubleArray, errors: DoubleArray, rough: float
) -> tuple[DoubleArray, float]:
    """Return the control points of the spline through values in the windows, and its largest
    standard error, as a share.

    design: (N, points), weights of the control points in the windows.
    target: (N,), the values; errors: (N,), their standard errors, as a share.
    rough: standard deviation of third differences of the control points.
    """
    design = design / target[:, None]
    down, right = (np.diff(np.eye(number), 3, axis=0) for number in points)
    thirds = np.kron(down, np.eye(points[1])), np.kron(np.eye(points[0]), right)
    smooth = np.concatenate(thirds) / rough
    weighted = design / errors[:, None]
    inverse = np.linalg.inv(weighted.T @ weighted + smooth.T @ smooth)
    control_points = inverse @ (weighted.T @ (1 / errors))
    variance = ((design @ inverse) * design).sum(axis=1)
    return control_points.reshape(points), float(variance.max() ** 0.5)


def _design(size: Size, points: Size, places: DoubleArray) -> DoubleArray:
    """Return the weights of all control points at N places, (N, points); places: (2, N), row and
    column.
    """
    down, right = map(basis, size, points, places)
    return (down[:, :, None] * right[:, None, :]).reshape(len(down), -1)


def _values(points: DoubleArray, size: Size, places: DoubleArray) -> DoubleArray:
    """Return a spline's values at N places, (N,); see `_design`."""
    return _design(size, points.shape, places) @ points.ravel()


def _check_light(windows: _Windows, shading: Shading, letters: str) -> None:
    """Raise InputError if the light is brighter on one side, or falls off around a place far from
    the middle.

    shading: with which the windows were measured. letters: of the channels. Light whose colour
    differs from side to side is uneven too, so that each is compared with all light.
    """
    size, half = shading.size, np.hypot(*shading.size) / 2
    rows, columns = windows.middle[:, -1]
    y, x = (rows - (size[0] - 1) / 2) / half, (columns - (size[1] - 1) / 2) / half
    gains = [_values(np.array(points), size, windows.middle[:, -1]) for points in shading.gain]
    weights = windows.light / windows.error
    levels = [np.log(gains[-1] / gain) for gain in gains[:-1]]
    levels.append(np.log(windows.light / windows.gain)[-1])

    def fit_around(
        centre: DoubleArray, plane: int, *more: DoubleArray
    ) -> tuple[DoubleArray, DoubleArray]:
        """Fit what falls off around a centre; returns the residuals and the coefficients, those of
        `more` last.
        """
        down, right = y - centre[0], x - centre[1]
        square = down**2 + right**2
        terms = [np.ones_like(x), down**2, right**2, square**2, square**3, *more]
        design = np.stack(terms, axis=1) * weights[plane][:, None]
        target = levels[plane] * weights[plane]
        coefficients = np.linalg.lstsq(design, target, rcond=None)[0].astype(np.float64)
        return design @ coefficients - target, coefficients

    def fit_tilt(centre: DoubleArray, plane: int) -> tuple[float, str, float]:
        """Return by how much one side is brighter, as a share, which side that is, and the sum of
        the squared residuals.
        """
        residuals, coefficients = fit_around(centre, plane, y, x)
        down, right = coefficients[-2:] * size / half
        side = "right" if right > 0 else "left"
        if abs(down) > abs(right):
            side = "bottom" if down > 0 else "top"
        return float(np.expm1(np.hypot(down, right))), side, float(np.square(residuals).sum())

    tilt, side, squares = fit_tilt(np.zeros(2), -1)

    def residuals_around(centre: DoubleArray) -> DoubleArray:
        return fit_around(centre, -1)[0]

    displaced = least_squares(residuals_around, np.zeros(2), bounds=(-1, 1), x_scale=0.1)
    away = float(np.hypot(*displaced.x)) / 2
    clearly = np.square(displaced.fun).sum() < _CLEARLY**2 * squares
    if clearly and away > _CENTRE:
        place = f"a place that is {100 * away:.0f} % of the diagonal off the middle"
        fault = f"the light falls off around {place}, {100 * _CENTRE:.0f} % are allowed"
        raise InputError(f"flat frames: {fault}; is the lens or the light askew?")
    tilts = {"": (0.0 if clearly else tilt, side)}
    # With little fall-off both centres are possible.
    centres = [np.zeros(2), displaced.x] if away <= _CENTRE else [np.zeros(2)]
    for plane, letter in enumerate(letters):
        key = f" in {letter}, compared with W"
        tilts[key] = min(fit_tilt(centre, plane)[:2] for centre in centres)
    for which, (tilt, side) in tilts.items():
        if tilt > (limit := _TILT if which else _LIGHT_TILT):
            much = f"{100 * tilt:.1f} % brighter at the {side} of the sensor than opposite"
            fault = f"the light is tilted{which}: {much}, {100 * limit:.0f} % are allowed"
            turn = "turn the camera by half a turn to see what is the light's"
            raise InputError(f"flat frames: {fault}; take an evenly lit surface, and {turn}")
