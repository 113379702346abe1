"""Noise and dead pixels per filter colour, from pairs of flat frames (EMVA Standard 1288, release 4).

Photon transfer: variance over mean tells gain and read noise (J. R. Janesick, Photon Transfer, SPIE 2007).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from shared import Mosaic, NoiseModel, SensorCalibration
from shared.arrays import BoolArray, DoubleArray
from shared.errors import InputError

from .dark_frames import DEFECT, HIDDEN, ROUNDING, DarkResult
from .samples import CLIP, CLIPPED, PlaceSamples, clipped_moments, levels_of, robust_deviation, tiles

_ROUNDS = 12
_LEAST_SHARE = 0.2  # of the variance that a place shows: its weight does not count on less
_HIGH = 4.0  # standard deviations above the line: beyond is texture, not noise
_DEAD = 0.5  # a pixel in a flat frame is dead below this part of the median of its plane nearby
_MOST_DEAD = 0.1  # of the pixels of a plane in a tile: more of them are a shadow, not dead
_SAME_EXPOSURE = 0.03  # largest relative difference of two flat frames
_GROUPS = 6  # of tiles, per pair
_RESTLESS = 2.0  # times the median variance per light of a pair's tiles: something moved between the frames
_WORST_NOISE = 0.25  # half width over variance at full scale: beyond it noise is a guess
SIGMAS = 1.96  # standard errors in half a 95 % interval


@dataclass(frozen=True)
class PhotonTransfer:
    """The line variance = shot * mean + read**2 of one plane, in parts of full scale.

    shot: variance per level.
    read: standard deviation without light.
    shot_error, read_error: their standard errors; infinite = the places do not determine them; 0 = given, not fitted.
    """

    shot: float
    read: float
    shot_error: float
    read_error: float

    def variance(self, mean: DoubleArray) -> DoubleArray:
        """Return the variance of a single sample at these means."""
        return self.shot * np.maximum(mean, 0) + self.read**2


def fit_photon_transfer(mean: DoubleArray, variance: DoubleArray, count: DoubleArray, read: float | None = None) -> PhotonTransfer:
    """Fit the line through the means and variances of N places of one plane; neither shot nor read is negative.

    An intercept that is fitted may be: then black is lower than it is taken for, which must not tilt the line.

    mean, variance: (N,), parts of full scale.
    count: (N,), number of samples; it gives the weight, because the variance of n samples has the variance 2 variance^2 / (n - 1).
    read: read noise from dark frames, parts of full scale; None = it is the line's intercept.

    Places far above the line have texture and are left out.
    """
    good = (count > 1) & np.isfinite(variance)
    mean, variance, count = mean[good], variance[good], count[good]
    design = np.stack([np.maximum(mean, 0), np.ones(mean.size)], axis=1)
    kept: BoolArray = np.ones(mean.size, bool)
    offset = 0.0 if read is None else read**2
    columns = design if read is None else design[:, :1]
    signed = np.concatenate([columns, -columns[:, 1:]], axis=1)
    predicted = np.maximum(variance, variance.mean() * 1e-3) if mean.size else variance
    coefficients = np.zeros(columns.shape[1])
    for _ in range(_ROUNDS):
        weight = np.sqrt((count - 1) / 2) / np.maximum(predicted, 1e-15)
        coefficients, _ = nnls(signed[kept] * weight[kept, None], (variance[kept] - offset) * weight[kept])
        predicted = np.maximum(signed @ coefficients + offset, np.maximum(_LEAST_SHARE * variance, 1e-15))
        score = (variance / predicted - 1) * np.sqrt((count - 1) / 2)
        kept = score <= _HIGH * max(1.0, robust_deviation(score))
        if kept.sum() < 2:
            kept = np.ones(mean.size, bool)
    weight = np.sqrt((count - 1) / 2) / predicted
    scaled = columns[kept] * weight[kept, None]
    information = scaled.T @ scaled
    # A pseudo-inverse would report an error of nearly 0 for what the places do not determine.
    determined = kept.any() and np.linalg.matrix_rank(information, hermitian=True) == len(information)
    errors = np.sqrt(np.diag(np.linalg.inv(information))) if determined else np.full(len(information), np.inf)
    # Places that differ by more than noise explains, as with texture, tell it less well.
    left = ((variance / predicted - 1) * np.sqrt((count - 1) / 2))[kept]
    errors = errors * max(1.0, float(np.sqrt((left**2).sum() / max(len(left) - len(information), 1))))
    shot = float(coefficients[0])
    if read is not None:
        return PhotonTransfer(shot, read, float(errors[0]), 0.0)
    intercept = float(np.sqrt(max(coefficients[1] - coefficients[2], 0.0)))
    read_error = float(errors[1] / (2 * max(intercept, np.sqrt(errors[1])))) if determined else np.inf
    return PhotonTransfer(shot, intercept, float(errors[0]), read_error)


@dataclass(frozen=True, eq=False)
class FlatResult:
    """Measurements of pairs of flat frames.

    pairs: their number.
    points: mean and variance in parts of full scale, in a few groups of places per pair; rounding to codes is part of the variance.
    dead: (row, column) of pixels that are dead in the brightest pair.
    blind: part of the pixels whose light is too weak, or too uneven nearby, to tell a dead pixel from a good one.
    """

    pairs: int
    points: PlaceSamples
    dead: tuple[tuple[int, int], ...]
    blind: float = 0.0


@dataclass(frozen=True, eq=False)
class NoiseResult:
    """Photon transfer in parts of full scale.

    lines: per plane (the channels, then panchromatic).
    points: the measurements that the lines were fitted to.
    source: which frames they come from, for people.
    """

    lines: tuple[PhotonTransfer, ...]
    points: PlaceSamples
    source: str

    def model(self, full_scale: float) -> NoiseModel:
        """Return the noise model in scene units; full_scale: scene units at the white level."""
        return NoiseModel(*(tuple(full_scale * getattr(line, name) for line in self.lines) for name in ("shot", "read")))

    @property
    def uncertainty(self) -> float:
        """Half the 95 % interval of what light adds to the variance at full scale, over that variance: of the plane known worst."""
        return max(SIGMAS * line.shot_error / max(float(line.variance(np.ones(1))[0]), 1e-30) for line in self.lines)


def measure_flats(frames: Sequence[Mosaic]) -> tuple[FlatResult, list[int]]:
    """Measure pairs of equal flat frames: half the variance of their difference is noise without fixed pattern.

    frames: flat frames of one or more exposures, in any order.

    Returns the measurements, and the indices of frames without a partner. Raises InputError if there is no pair.
    """
    planes = frames[0].pattern.filter_map(frames[0].shape)
    white = len(frames[0].pattern.planes) - 1
    levels = [levels_of(frame).astype(np.float64) for frame in frames]
    brightness = [float(np.median(level[planes == white])) for level in levels]
    order = sorted((index for index in range(len(frames)) if 0 < brightness[index] < CLIPPED), key=lambda index: brightness[index])
    pairs, unpaired = [], [index for index in range(len(frames)) if index not in order]
    while order:
        first = order.pop(0)
        if order and brightness[order[0]] <= brightness[first] * (1 + _SAME_EXPOSURE):
            pairs.append((first, order.pop(0)))
        else:
            unpaired.append(first)
    if not pairs:
        raise InputError(
            "flat frames: no two unclipped frames have the same exposure; take two of each, at several exposures up to three "
            "quarters of full scale"
        )
    points = [_grouped(_pair_points(levels[first], levels[second], planes, white + 1)) for first, second in pairs]
    mean, variance, count = np.moveaxis(np.concatenate(points), 1, 0)
    first, second = pairs[-1]
    dead, blind = _dead(levels[first] + levels[second], levels[first] - levels[second], planes)
    places = PlaceSamples(mean, variance, count, np.zeros(len(mean), bool), np.zeros((len(mean), 2)))
    return FlatResult(len(pairs), places, dead, blind), unpaired


def noise_of_flats(
    flats: FlatResult, calibration: SensorCalibration, dark: DarkResult | None, black_error: DoubleArray | None = None
) -> NoiseResult:
    """Fit the noise of flat frames: a line per plane, after subtracting the variance that rounding to codes adds.

    calibration: its black and white level are those of the frames.
    dark: measurements of dark frames; None = the read noise is the intercept of the fit.
    black_error: (C + 1,), standard error of the black level, codes; None = it is exact.

    Raises InputError if the pairs do not show how the noise grows with light.
    """
    points, span = flats.points, calibration.white_level - np.array(calibration.black_level)
    points = replace(points, variance=np.maximum(points.variance - ROUNDING / span**2, 0))
    known = dark if dark is not None and dark.shows_read else None
    lines = []
    for plane, (mean, variance, count) in enumerate(zip(points.mean.T, points.variance.T, points.count.T, strict=True)):
        line = fit_photon_transfer(mean, variance, count, None if known is None else float(known.read[plane] / span[plane]))
        stretch = 0.0 if black_error is None else float(black_error[plane] / span[plane])
        # Black that is off stretches the levels, and moves the line's intercept.
        line = replace(line, shot_error=float(np.hypot(line.shot_error, line.shot * stretch)))
        if known is None:
            least = max(line.read, float(np.sqrt(line.shot * stretch)), 1e-12)
            lines.append(replace(line, read_error=float(np.hypot(line.read_error, line.shot * stretch / least))))
        else:
            lines.append(replace(line, read_error=float(known.read_error[plane] / span[plane])))
    noise = NoiseResult(tuple(lines), points, f"{flats.pairs} pair{'s' * (flats.pairs > 1)} of flat frames")
    fault = ""
    if float((points.variance * span**2).max(axis=0, initial=0).min()) < HIDDEN**2:
        fault = "show less noise than rounding to codes hides"
    elif not noise.uncertainty <= _WORST_NOISE:
        part = f"±{100 * noise.uncertainty:.0f} %" if noise.uncertainty < 1 else "±100 % or more"
        fault = f"tell the noise at full scale only to {part}, and {100 * _WORST_NOISE:.0f} % are allowed"
    if fault:
        raise InputError(
            f"flat frames: {noise.source} {fault}; take two frames of each of several exposures, up to three quarters of full "
            "scale, and dark frames (`dark`)"
        )
    return noise


def _grouped(places: DoubleArray) -> DoubleArray:
    """Return a few groups of places of like brightness, without places that have more than noise (something moved).

    A line fits the groups as well as the places. places: see `_pair_points`; the groups are of the same form.
    """
    if not places.size:
        return places
    per_light = places[:, 1, -1] / np.maximum(places[:, 0, -1], 1e-6)
    kept = places[per_light <= _RESTLESS * np.median(per_light)]
    groups = []
    for group in np.array_split(np.argsort(kept[:, 0, -1]), min(_GROUPS, len(kept))):
        mean, variance, count = np.moveaxis(kept[group], 1, 0)
        free = np.maximum(count - 1, 0)
        known = (variance * free).sum(axis=0) / np.maximum(free.sum(axis=0), 1)
        groups.append(((mean * count).sum(axis=0) / count.sum(axis=0), known, free.sum(axis=0) + 1))
    return np.array(groups)


def _pair_points(first: DoubleArray, second: DoubleArray, planes: np.ndarray, number: int) -> DoubleArray:
    """Return mean, half the variance of the difference of two frames, and number of samples, in N tiles that are not clipped.

    number: of planes P; the result is (N, 3, P).
    """
    places = []
    for window in tiles(planes):
        here, place = planes[window], np.zeros((3, number))
        brightest = 0.0
        for plane in range(number):
            a, b = first[window][here == plane], second[window][here == plane]
            difference = a - b
            centre, spread = clipped_moments(difference)
            good = np.abs(difference - centre) <= CLIP * max(spread, 1e-12)
            place[:, plane] = (a[good].mean() + b[good].mean()) / 2, difference[good].var(ddof=1) / 2, good.sum()
            brightest = max(brightest, float(np.quantile(np.maximum(a, b), 0.99)))
        if brightest < CLIPPED:
            places.append(place)
    return np.reshape(places, (-1, 3, number))


def _dead(bright: DoubleArray, difference: DoubleArray, planes: np.ndarray) -> tuple[tuple[tuple[int, int], ...], float]:
    """Return (row, column) of pixels with less than half the light of their plane in the same tile, and the part that cannot tell.

    bright, difference: (H, W), sum and difference of two frames; the difference shows the noise of the sum.

    A good pixel must not be as dark by chance, nor a dead one as bright: the limit, half the light, is DEFECT deviations of the
    noise away from both. Where many pixels are dark it is the light that is uneven.
    """
    found, blind = [], 0
    for window in tiles(planes):
        tile, here, noise = bright[window], planes[window], difference[window]
        for plane in np.unique(here):
            own = here == plane
            middle = float(np.median(tile[own]))
            low = own & (tile < _DEAD * middle)
            if (1 - _DEAD) * middle < DEFECT * clipped_moments(noise[own])[1] or low.sum() > max(_MOST_DEAD * own.sum(), 2):
                blind += int(own.sum())
                continue
            found += [(window[0].start + row, window[1].start + column) for row, column in np.argwhere(low).tolist()]
    return tuple(found), blind / planes.size
