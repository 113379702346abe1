"""Noise and dead pixels per filter colour, from pairs of flat frames (EMVA Standard 1288, release
4).

Photon transfer: variance over mean tells gain and read noise (J. R. Janesick, Photon Transfer, SPIE
2007).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from ...shared import BoolArray, DoubleArray, InputError, Mosaic, NoiseModel, SensorCalibration
from . import places
from .dark_frames import DEFECT, HIDDEN, ROUNDING, DarkResult
from .places import Named, PlaceSamples

_LEAST_SHARE = 0.2  # of the variance that a place shows: its weight does not count on less
_HIGH = 4.0  # standard deviations above the line: beyond is texture, not noise
_DEAD = 0.5  # a pixel in a flat frame is dead below this part of the median of its plane nearby
_MOST_DEAD = 0.1  # of the pixels of a plane in a window: more of them are a shadow, not dead
_SAME_EXPOSURE = 0.03  # largest relative difference of two flat frames
_LEAST = 1e-3  # of full scale: pixels that differ by less are no defects
_OTHER_GAIN = 1.3  # ratio of noises: more is another gain, or light that changes
_SURE_NOISE = 5.0  # standard errors
_HARMLESS = 0.003  # of the variance: flicker that adds less does not matter
# Logarithm of the light, from window to window; of all steps, those that lenses of 3 stops do not
# make; of the brightest window, what is not told from black.
_STEP, _STEPS, _DIMMEST = 0.5, 0.05, 0.02
_WORST_NOISE = 0.25  # half width over variance at full scale: beyond it noise is a guess
SIGMAS = 1.96  # standard errors in half a 95 % interval


@dataclass(frozen=True)
class PhotonTransfer:
    """The line variance = shot * mean + read**2 of one plane, in parts of full scale.

    Attributes
    ----------
    shot : float
        Variance per level.
    read : float
        Standard deviation without light.
    shot_error, read_error : float
        Their standard errors; infinite = the places do not determine them; 0 = given, not fitted.
    """

    shot: float
    read: float
    shot_error: float
    read_error: float

    def variance(self, mean: DoubleArray) -> DoubleArray:
        """Return the variance of a single sample at these means."""
        return self.shot * np.maximum(mean, 0) + self.read**2


def fit_photon_transfer(
    mean: DoubleArray, variance: DoubleArray, count: DoubleArray, read: float | None = None
) -> PhotonTransfer:
    """Fit the line through the means and variances of N places of one plane; neither shot nor read
    is negative.

    An intercept that is fitted may be: then black is lower than it is taken for, which must not
    tilt the line. Places far above the line have texture and are left out.

    Parameters
    ----------
    mean, variance : DoubleArray
        (N,), parts of full scale.
    count : DoubleArray
        (N,), number of samples; it gives the weight, because the variance of n samples has the
        variance 2 variance^2 / (n - 1).
    read : float | None, optional
        Read noise from dark frames, parts of full scale; None = it is the line's intercept.
    """
    good = (count > 1) & np.isfinite(variance)
    mean, variance, root = mean[good], variance[good], np.sqrt((count[good] - 1) / 2)
    columns = np.maximum(mean, 0)[:, None]
    if read is None:
        columns = np.insert(columns, 1, 1.0, axis=1)
    signed = np.concatenate([columns, -columns[:, 1:]], axis=1)  # nnls: none is negative
    offset = 0.0 if read is None else read**2
    predicted = np.maximum(variance, variance.mean() * 1e-3) if mean.size else variance
    kept: BoolArray = np.ones(mean.size, bool)
    for _ in range(12):  # rounds of weighting
        weight = (root / np.maximum(predicted, 1e-15))[kept]
        coefficients, _ = nnls(signed[kept] * weight[:, None], (variance[kept] - offset) * weight)
        least = np.maximum(_LEAST_SHARE * variance, 1e-15)
        predicted = np.maximum(signed @ coefficients + offset, least)
        score = (variance / predicted - 1) * root
        kept = score <= _HIGH * max(1.0, places.robust_deviation(score))
        if kept.sum() < 2:
            kept = np.ones(mean.size, bool)
    scaled = columns[kept] * (root / predicted)[kept, None]
    information = scaled.T @ scaled
    # A pseudo-inverse would report an error of nearly 0 for what the places do not determine.
    unknowns = len(information)
    errors = np.full(unknowns, np.inf)
    if kept.any() and np.linalg.matrix_rank(information, hermitian=True) == unknowns:
        errors = np.sqrt(np.diag(np.linalg.inv(information)))
    # Places that differ by more than noise explains, as with texture, tell it less well.
    spread = float(np.sqrt((score[kept] ** 2).sum() / max(int(kept.sum()) - unknowns, 1)))
    errors = errors * max(1.0, spread)
    shot, *intercept = coefficients
    if read is not None:
        return PhotonTransfer(float(shot), read, float(errors[0]), 0.0)
    fitted = float(np.sqrt(max(intercept[0] - intercept[1], 0.0)))
    read_error = np.inf
    if np.isfinite(errors[1]):
        read_error = float(errors[1] / (2 * max(fitted, np.sqrt(errors[1]))))
    return PhotonTransfer(float(shot), fitted, float(errors[0]), read_error)


@dataclass(frozen=True, eq=False)
class FlatResult:
    """Measurements of pairs of flat frames.

    Attributes
    ----------
    pairs : int
        Their number.
    points : PlaceSamples
        Mean and variance in parts of full scale, in the windows of each pair; rounding to codes is
        part of the variance.
    dead : tuple[tuple[int, int], ...]
        (row, column) of pixels that are dead in the brightest pair.
    blind : float
        Part of the pixels whose light is too weak, or too uneven nearby, to tell a dead pixel from
        a good one.
    flicker : Sequence[str]
        Sentences on pairs that show light that flickers; it is no part of `points`.
    names : Sequence[str]
        Of the frames, for people.
    step : int
        Between codes.
    """

    pairs: int
    points: PlaceSamples
    dead: tuple[tuple[int, int], ...]
    blind: float = 0.0
    flicker: Sequence[str] = ()
    names: Sequence[str] = ()
    step: int = 1


@dataclass(frozen=True, eq=False)
class NoiseResult:
    """Photon transfer in parts of full scale.

    Attributes
    ----------
    lines : tuple[PhotonTransfer, ...]
        Per plane (the channels, then panchromatic).
    points : PlaceSamples
        The measurements that the lines were fitted to.
    source : str
        Which frames they come from, for people.
    """

    lines: tuple[PhotonTransfer, ...]
    points: PlaceSamples
    source: str

    def model(self, full_scale: float) -> NoiseModel:
        """Return the noise model in scene units.

        full_scale: scene units at the white level.
        """
        shot, read = full_scale * np.array([(line.shot, line.read) for line in self.lines]).T
        return NoiseModel(tuple(shot.tolist()), tuple(read.tolist()))

    @property
    def uncertainty(self) -> float:
        """Half the 95 % interval of what light adds to the variance at full scale, over that
        variance: of the plane known worst.
        """
        of_lines = [line.shot_error / max(line.shot + line.read**2, 1e-30) for line in self.lines]
        return SIGMAS * max(of_lines)


def check_flat(frame: Mosaic) -> None:
    """Raise InputError if a frame that is given as flat shows a scene: its dark edges would pass
    for dead pixels.
    """
    planes, levels = places.planes_of(frame), places.levels_of(frame)
    clear = planes == len(frame.pattern.planes) - 1
    middles = [float(np.median(levels[window][clear[window]])) for window in places.windows(planes)]
    side = math.isqrt(len(middles))
    light = np.log(np.maximum(middles, max(_DIMMEST * max(middles), 1e-6))).reshape(side, side)
    steps = np.concatenate([np.diff(light, axis=axis).ravel() for axis in (0, 1)])
    if (np.abs(steps) > _STEP).sum() > _STEPS * steps.size:
        instead = "take an evenly lit surface, out of focus"
        raise InputError(f"is no flat frame: it shows a scene; {instead}")


def measure_flats(named: Sequence[Named], dark: DarkResult | None = None) -> FlatResult:
    """Measure pairs of equal flat frames: half the variance of their difference is noise without
    fixed pattern. Light that flickers lifts whole rows, which is subtracted.

    Raises InputError if there is no pair; if light flickers and there are no dark frames: read
    noise that rows have in common is then not told from it.

    Parameters
    ----------
    named : Sequence[Named]
        Flat frames of one or more exposures, in any order, after their names; those that are
        clipped, or that no other has the exposure of, do not count.
    dark : DarkResult | None, optional
        Measurements of dark frames; None = there are none.
    """
    names, frames = zip(*named, strict=True)
    planes = places.planes_of(frames[0])
    white = len(frames[0].pattern.planes) - 1
    levels = [places.levels_of(frame).astype(np.float64) for frame in frames]
    lights = [float(np.median(level[planes == white])) for level in levels]
    lit = sorted((light, index) for index, light in enumerate(lights) if 0 < light < places.CLIPPED)
    pairs: list[tuple[int, int]] = []
    while len(lit) > 1:
        light, first = lit.pop(0)
        if lit[0][0] <= light * (1 + _SAME_EXPOSURE):
            pairs.append((first, lit.pop(0)[1]))
    if not pairs:
        remedy = "take two of each, at several exposures up to three quarters of full scale"
        raise InputError(f"flat frames: no two unclipped frames have the same exposure; {remedy}")
    frames_of = [((levels[one] + levels[two]) / 2, levels[one] - levels[two]) for one, two in pairs]
    rows = [_common_rows(*pair, planes, white) for pair in frames_of]
    span = frames[0].calibration.white_level - frames[0].calibration.black_level[-1]
    # Rows of the sensor have this in common without light.
    most = dark.rows / span**2 if dark else math.inf
    usual = max(min(most, *(excess for _, excess, _ in rows)), 0)
    flicker, remedy = [], "take flat frames in daylight, or under a lamp that does not flicker"
    for (one, two), (_, excess, least) in zip(pairs, rows, strict=True):
        if excess - usual > least:
            much = f"{100 * math.sqrt(2 * (excess - usual)) / lights[one]:.2g} %"
            fault = f"the light flickers, rows differ by {much}"
            flicker.append(f"{names[one]} and {names[two]}: {fault}; {remedy}")
    if flicker and dark is None:
        raise InputError(f"flat frames: {flicker[-1]}, or add dark frames (`dark`)")
    if flicker:
        frames_of = [(pair[0], steady) for pair, (steady, *_) in zip(frames_of, rows, strict=True)]
    moments = [_pair_points(*pair, planes, white + 1) for pair in frames_of]
    mean, variance, count = np.moveaxis(np.concatenate(moments), 1, 0)
    variance, number = variance + usual * bool(flicker), len(mean)
    points = PlaceSamples(mean, variance, count, np.zeros(number, bool), np.zeros((number, 2)))
    every = places.planes_of(frames[0], defects=True)
    dead, step = _dead(*frames_of[-1], every), places.code_step(frames[pairs[-1][0]].codes)
    return FlatResult(len(pairs), points, *dead, flicker, names, step)


def noise_of_flats(
    flats: FlatResult, calibration: SensorCalibration, dark: DarkResult | None, black: DoubleArray
) -> NoiseResult:
    """Fit the noise of flat frames: a line per plane, after subtracting the variance that rounding
    to codes adds.

    Raises InputError if the pairs do not show how the noise grows with light.

    Parameters
    ----------
    calibration : SensorCalibration
        Its black and white level are those of the frames.
    dark : DarkResult | None
        Measurements of dark frames; None = the read noise is the intercept of the fit.
    black : DoubleArray
        (C + 1,), standard error of the black level, codes.
    """
    points, span = flats.points, calibration.white_level - np.array(calibration.black_level)
    rounding = ROUNDING * (flats.step / span) ** 2
    points = replace(points, variance=np.maximum(points.variance - rounding, 0))
    known = dark if dark is not None and dark.shows_read else None
    lines = []
    for plane, full in enumerate(span.tolist()):
        read = None if known is None else float(known.read[plane] / full)
        mean, variance = points.mean[:, plane], points.variance[:, plane]
        line = fit_photon_transfer(mean, variance, points.count[:, plane], read)
        # Black that is off stretches the levels, and moves the line's intercept.
        moved = line.shot * float(black[plane] / full)
        read_error = math.hypot(line.read_error, moved / max(line.read, moved**0.5, 1e-12))
        if known is not None:
            read_error = float(known.read_error[plane] / full)
        shot_error = math.hypot(line.shot_error, moved)
        lines.append(replace(line, shot_error=shot_error, read_error=read_error))
    source = f"{flats.pairs} pair{'s' if flats.pairs > 1 else ''} of flat frames"
    noise = NoiseResult(tuple(lines), points, source)
    fault = ""
    if float((points.variance * span**2).max(axis=0, initial=0).min()) < (HIDDEN * flats.step) ** 2:
        fault = "show less noise than rounding to codes hides"
    elif not noise.uncertainty <= _WORST_NOISE:
        spread = f"±{100 * noise.uncertainty:.0f} %" if noise.uncertainty < 1 else "±100 % or more"
        allowed = f"{100 * _WORST_NOISE:.0f} % are allowed"
        fault = f"tell the noise at full scale only to {spread}, and {allowed}"
    if fault:
        exposures = "several exposures, up to three quarters of full scale"
        remedy = f"take two frames of each of {exposures}, and dark frames (`dark`)"
        raise InputError(f"flat frames: {noise.source} {fault}; {remedy}")
    return noise


def contradiction(
    lines: Sequence[PhotonTransfer],
    calibration: SensorCalibration,
    dark: DarkResult | None,
    charts: Sequence[PlaceSamples],
    points: PlaceSamples | None = None,
) -> str:
    """Return what contradicts the noise of flat frames; "" = nothing does.

    Parameters
    ----------
    lines : Sequence[PhotonTransfer]
        Per plane (the channels, then panchromatic).
    calibration : SensorCalibration
        Its levels are those of the frames. Its shading is undone in charts, which raises their
        noise by its gain at most.
    dark : DarkResult | None
        Measurements of dark frames; None = there are none.
    charts : Sequence[PlaceSamples]
        Patches of charts.
    points : PlaceSamples | None, optional
        The measurements that the lines were fitted to; None = they are not known.
    """
    *colours, white = lines
    photon = white.shot, white.shot_error
    shot, error = np.mean([(line.shot, line.shot_error) for line in colours], axis=0).tolist()
    rows = [("photon", photon, (shot, error), 1.0, "colour samples")] if points else []
    if charts:
        patches = np.concatenate([_panchromatic(chart) for chart in charts], axis=1)
        gain = float(calibration.shading.sketch[-1].max()) if calibration.shading else 1.0
        rows.append(("photon", photon, _fit_chart(*patches), gain, "the chart"))
    if dark and dark.shows_read:
        free = white if points is None else fit_photon_transfer(*_panchromatic(points))
        read = float(dark.read[-1] / (calibration.white_level - calibration.black_level[-1]))
        rows.append(("read", (free.read, free.read_error), (read, 0.0), 1.0, "dark frames"))
    for kind, (ours, error), (theirs, other), more, whom in rows:
        unlike = not theirs / (_OTHER_GAIN * more) < ours < theirs * _OTHER_GAIN
        if unlike and abs(ours - theirs) > _SURE_NOISE * math.hypot(error, other):
            return f"their {kind} noise is {ours / max(theirs, 1e-12):.2g} times that of {whom}"
    return ""


def _panchromatic(points: PlaceSamples) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """Return mean, variance and count of the panchromatic samples in N exposed places, (N,)."""
    here = points.exposed, -1
    return points.mean[here], points.variance[here], points.count[here]


def _fit_chart(mean: DoubleArray, variance: DoubleArray, count: DoubleArray) -> tuple[float, float]:
    """Return by how much the variance of patches grows with the light, and the standard error.
    Fixed pattern and texture grow with its square.
    """
    weight = np.sqrt(count / 2) / np.maximum(variance, 1e-15)
    scaled = np.stack([mean, np.ones_like(mean), mean**2], axis=1) * weight[:, None]
    (shot, *_), left = nnls(scaled, variance * weight)
    spread = max(left / math.sqrt(len(mean)), 1.0)
    return float(shot), spread * float(np.linalg.pinv(scaled.T @ scaled)[0, 0] ** 0.5)


def _common_rows(
    mean: DoubleArray, difference: DoubleArray, planes: np.ndarray, white: int
) -> tuple[DoubleArray, float, float]:
    """Return the difference of two frames (H, W) without what the samples of a row have in common,
    in parts of their light; half the variance of that in the panchromatic plane, beyond what noise
    explains; and the least of it that matters.
    """
    row = np.arange(len(planes))[:, None] * (places.NO_PLANE + 1) + planes
    count = np.bincount(row.ravel())
    light, total = (np.bincount(row.ravel(), each.ravel()) for each in (mean, difference))
    share = np.clip(total / np.maximum(light, _LEAST * count + 1e-9), -1, 1)
    steady = difference - share[row] * mean
    # Of shot noise, so much stays: the brighter frame has more of it, and counts less.
    steady *= np.sqrt(count / np.maximum(count - 1, 1) / (1 - share**2 / 4))[row]
    squares = np.bincount(row.ravel(), steady.ravel() ** 2)
    clear = np.unique(row[planes == white])
    count, light, total, squares = (each[clear] for each in (count, light, total, squares))
    variance = float(((total - light * total.sum() / light.sum()) / count).var())
    excess = (variance - float((squares / count**2).mean())) / 2
    noise = _HARMLESS * float(squares.sum() / count.sum()) / 2
    return steady, excess, _SURE_NOISE * variance / math.sqrt(2 * len(count)) + noise


def _pair_points(
    mean: DoubleArray, difference: DoubleArray, planes: np.ndarray, number: int
) -> DoubleArray:
    """Return mean, half the variance of the difference of two frames, and number of samples, in N
    windows that are not clipped, nor full of defects.

    number: of planes P; the result is (N, 3, P).
    """
    found = []
    for window in places.windows(planes):
        place, brightest = np.zeros((3, number)), 0.0
        for plane in range(number):
            light, apart = (each[window][planes[window] == plane] for each in (mean, difference))
            if light.size < places.FEW:
                break
            centre, spread = places.clipped_moments(apart)
            good = np.abs(apart - centre) <= places.CLIP * max(spread, 1e-12)
            good &= places.inliers(light - np.median(light), max(spread, _LEAST))
            light, apart = light[good], apart[good]
            place[:, plane] = light.mean(), apart.var(ddof=1) / 2, light.size
            brightest = max(brightest, float(np.quantile(light + np.abs(apart) / 2, 0.99)))
        if brightest < places.CLIPPED and place[2].all():
            found.append(place)
    return np.reshape(found, (-1, 3, number))


def _dead(
    mean: DoubleArray, difference: DoubleArray, planes: np.ndarray
) -> tuple[tuple[tuple[int, int], ...], float]:
    """Return (row, column) of pixels that are dead in two frames, and the part of the pixels that
    cannot tell; mean, difference: of the frames, (H, W).

    Dead is less than half the light of the plane in the same window. A good pixel must not be as
    dark by chance, nor a dead one as bright: half the light is DEFECT deviations of the noise away
    from both. Where many pixels are dark the light is uneven.
    """
    dead: list[tuple[int, int]] = []
    blind = 0
    for window in places.windows(planes):
        top, left = window[0].start, window[1].start
        levels, noise = 2 * mean[window], difference[window]
        for plane in np.unique(planes[window]):
            own = planes[window] == plane
            middle, number = float(np.median(levels[own])), int(own.sum())
            low = own & (levels < _DEAD * middle)
            noisy = (1 - _DEAD) * middle < DEFECT * places.clipped_moments(noise[own])[1]
            if noisy or low.sum() > max(_MOST_DEAD * number, 2):
                blind += number
            else:
                dead += [(top + row, left + column) for row, column in np.argwhere(low).tolist()]
    return tuple(dead), blind / planes.size
