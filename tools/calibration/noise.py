"""Black level, noise and defects per filter colour, from dark frames and pairs of flat frames (EMVA Standard 1288, release 4)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from shared import Mosaic, NoiseModel, SensorCalibration
from shared.arrays import DoubleArray
from shared.errors import InputError

from .photon_transfer import PhotonTransfer, fit_photon_transfer
from .samples import CLIPPED, PlaceSamples, levels_of

_ROUNDING = 1 / 12  # code^2, the variance that rounding to whole codes adds (Sheppard's correction)
_CLIP = 5.0  # standard deviations: samples beyond are left out when a deviation is measured
_DEFECT = 5.5  # standard deviations in the averaged dark frame: 4e-8 of good pixels are beyond
_LEAST_DEFECT = 1.5  # codes: rounding alone moves good pixels by one
_DEAD = 0.5  # a pixel in a flat frame is dead below this part of the median of its plane nearby
_MOST_DEAD = 0.1  # of the pixels of a plane in a tile: more of them are a shadow, not dead
_NOT_DARK = 0.1  # of full scale above black
_UNLIKE = 4.0  # times the variance of another dark frame: one has another gain or exposure, or is no measurement at all
_USUAL_DRIFT, _USUAL_DRIFT_FRAMES = 0.02, 2  # of the read noise; and what that counts, in frames, beside the drift that is seen
_LEAK = 1 / 1024  # of the range of codes: black levels of the planes that differ by less are those of electronics
_LEAST_LEAK = 3.0  # codes
_IN_LINE = 0.9  # correlation of levels and variances of the planes, from which on both rise together
_DRIFT = 3.0  # standard deviations (and codes) that black may move between dark frames, as with temperature
_SAME_EXPOSURE = 0.03  # largest relative difference of two flat frames
_TILES = 12  # per side, at most: flat frames are never quite even, so means and variances are measured in tiles
_LEAST_SAMPLES = 40  # samples of the rarest plane in a tile, about
_GROUPS = 6  # of tiles, per pair
_RESTLESS = 2.0  # times the median variance per light of a pair's tiles: something moved between the frames
_HIDDEN = 0.5  # code: rounding distorts a smaller standard deviation, whatever is subtracted for it (EMVA 1288 asks for as much)
_WORST_NOISE = 0.25  # half width over variance at full scale: beyond it noise is a guess
SIGMAS = 1.96  # standard errors in half a 95 % interval


@dataclass(frozen=True, eq=False)
class DarkResult:
    """Measurements of dark frames, per plane (the C channels, then panchromatic), in codes.

    frames: their number.
    black: (C + 1,), black level.
    black_error: (C + 1,), its standard error.
    read: (C + 1,), read noise as a standard deviation, without the effect of rounding to codes.
    read_error: (C + 1,), its standard error.
    defects: (row, column) of pixels that are not black.
    """

    frames: int
    black: DoubleArray
    black_error: DoubleArray
    read: DoubleArray
    read_error: DoubleArray
    defects: tuple[tuple[int, int], ...]

    @property
    def shows_read(self) -> bool:
        """Whether the codes are fine enough to show the read noise."""
        return bool((self.read >= _HIDDEN).all())


@dataclass(frozen=True, eq=False)
class FlatResult:
    """Measurements of pairs of flat frames.

    pairs: their number.
    black: (C + 1,), the black level that the points refer to, codes.
    points: mean and variance in parts of full scale, in a few groups of places per pair; rounding to codes is part of the variance.
    dead: (row, column) of pixels that are dead in the brightest pair.
    blind: part of the pixels whose light is too weak, or too uneven nearby, to tell a dead pixel from a good one.
    """

    pairs: int
    black: DoubleArray
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


def measure_dark(frames: Sequence[Mosaic]) -> DarkResult:
    """Measure black level and read noise per filter colour, and find the pixels that are not black.

    frames: one or more, with the same exposure. Raises InputError if they are not dark, or clearly differ in noise or level.
    """
    first = frames[0]
    planes = first.pattern.filter_map(first.shape)
    number = len(first.pattern.planes)
    full = first.calibration.white_level
    stack = np.stack([frame.codes for frame in frames]).astype(np.float64)
    mean = stack.mean(axis=0)
    level = float(np.median(mean))
    if level - min(first.calibration.black_level) > _NOT_DARK * full:
        raise InputError(f"is not dark: its median is {level:.0f} of {full} codes; cover the lens")
    _check_alike(stack[:, planes == number - 1])
    black, error, read, read_error = (np.zeros(number) for _ in range(4))
    defect = np.zeros(first.shape, bool)
    for plane in range(number):
        here = planes == plane
        values = mean[here]
        centre, spread = _clipped(values)
        good = np.abs(values - centre) <= max(_DEFECT * spread, _LEAST_DEFECT)
        defect[here] = ~good
        black[plane] = values[good].mean()
        error[plane] = values[good].std() / np.sqrt(max(good.sum(), 1))
        samples = stack[:, here][:, good]
        levels = samples.mean(axis=1)
        if len(frames) > 1:
            samples -= samples.mean(axis=1, keepdims=True)  # what a whole frame drifts by is no read noise
            variance = float(samples.var(axis=0, ddof=1).sum()) / max(good.sum() - 1, 1)
        else:
            variance = float(samples.var(ddof=1))
        read[plane] = np.sqrt(max(variance - _ROUNDING, 0.0))
        # What whole frames drift by is an error of the black level that samples of one frame do not show, and few frames hardly.
        usual = _USUAL_DRIFT_FRAMES * (_USUAL_DRIFT * np.sqrt(variance)) ** 2
        drift = (((levels - levels.mean()) ** 2).sum() + usual) / (len(frames) - 1 + _USUAL_DRIFT_FRAMES)
        error[plane] = np.hypot(error[plane], np.sqrt(drift / len(frames)))
        if read[plane] < _HIDDEN:  # then the mean of the codes is not that of the samples, however many there are
            error[plane] = np.hypot(error[plane], np.sqrt(_ROUNDING))
        independent = good.sum() * max(len(frames) - 1, 1)
        read_error[plane] = variance / (max(read[plane], _HIDDEN) * np.sqrt(2 * max(independent, 1)))
    _check_light(first, mean, black, np.hypot(read, _ROUNDING**0.5), len(frames))
    defects = tuple((row, column) for row, column in np.argwhere(defect).tolist())
    return DarkResult(len(frames), black, error, read, read_error, defects)


def _check_alike(samples: DoubleArray) -> None:
    """Raise InputError if dark frames clearly differ; samples: of one plane, (frames, samples)."""
    levels, spreads = np.array([_clipped(frame) for frame in samples]).T
    noises = np.sqrt(spreads**2 + _ROUNDING)  # of codes that happen not to change, rounding hides the noise
    for what, values, limit in (
        ("noise", noises, np.sqrt(_UNLIKE) * noises.min()),
        ("level", levels, levels.min() + _DRIFT * max(float(noises.max()), 1.0)),
    ):
        low, high = int(values.argmin()), int(values.argmax())
        if values[high] > limit:
            raise InputError(
                f"dark frames: the {what} of frame {low + 1} is {values[low]:.4g} codes, of frame {high + 1} {values[high]:.4g}: "
                "they have another gain or exposure, or light fell in; take all in the same way"
            )


def _check_light(frame: Mosaic, mean: DoubleArray, black: DoubleArray, noise: DoubleArray, frames: int) -> None:
    """Raise InputError if light has fallen on dark frames: in all of the sensor, or in a part of it.

    frame: one of them; mean: (H, W), of all, codes; black, noise: (C + 1,), of each plane, codes.

    Panchromatic samples collect the light of all channels, so light lifts them above the others, and light has shot noise: the
    planes' variances rise along a line over their levels. Heat lifts all planes alike, and an electronic offset has no noise.
    """
    letters, planes = frame.pattern.planes, frame.pattern.filter_map(frame.shape)
    limit = max(_LEAK * frame.calibration.white_level, _LEAST_LEAK)
    lift = black - black[:-1].min()
    variance = noise**2
    slope = float(np.polyfit(lift, variance, 1)[0]) if np.ptp(lift) > 0 else 0.0
    sure = variance.mean() * np.sqrt(2 / max(float(np.bincount(planes.ravel()).min()) * frames, 1.0))
    agrees = slope * np.ptp(lift) > 4 * sure and float(np.corrcoef(lift, variance)[0, 1]) > _IN_LINE
    if np.ptp(black) > limit and black[-1] - black[:-1].mean() > limit / 2 and agrees:
        levels = ", ".join(f"{letter} {level:.1f}" for letter, level in zip(letters, black, strict=True))
        noises = ", ".join(f"{letter} {each:.2f}" for letter, each in zip(letters, noise, strict=True))
        raise InputError(
            f"dark frames: light fell in: their levels are {levels} codes, with a noise of {noises}: both rise from filter to filter as "
            "they do in light, most in W, which sees all colours; cover lens and viewfinder, and take them in the dark"
        )
    parts = []
    for window in _tiles(planes):
        tile, here = mean[window], planes[window]
        middle = [float(np.median(tile[here == plane])) for plane in range(len(letters))]
        parts.append((middle[-1] - float(np.mean(middle[:-1])), window))
    usual = float(np.median([part for part, _ in parts]))
    most, (rows, columns) = max(parts, key=lambda part: part[0])
    if most - usual > max(limit, _CLIP * float(noise.max()) / np.sqrt(frames * _LEAST_SAMPLES)):
        raise InputError(
            f"dark frames: light fell in around row {(rows.start + rows.stop) // 2}, column {(columns.start + columns.stop) // 2}: W is "
            f"{most - usual:.1f} codes further above the other filters there than elsewhere; cover lens and viewfinder"
        )


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
    first, second = pairs[-1]
    dead, blind = _dead(levels[first] + levels[second], levels[first] - levels[second], planes)
    black = np.array(frames[0].calibration.black_level)
    return FlatResult(len(pairs), black, PlaceSamples.joined(points), dead, blind), unpaired


def noise_of_flats(
    flats: FlatResult, calibration: SensorCalibration, dark: DarkResult | None, black_error: DoubleArray | None = None
) -> NoiseResult:
    """Fit the noise of flat frames.

    calibration: its black and white level are those of the result.
    dark: measurements of dark frames; None = the read noise is the intercept of the fit.
    black_error: (C + 1,), standard error of the black level, codes; None = it is exact.

    Raises InputError if the pairs do not tell how the noise grows with light.
    """
    black = np.array(calibration.black_level)
    points = flats.points.rebased(flats.black, black, calibration.white_level)
    noise = _fitted(points, calibration, dark, black_error, f"{flats.pairs} pair{'s' * (flats.pairs > 1)} of flat frames")
    if fault := _undetermined(noise, calibration):
        raise InputError(
            f"flat frames: {noise.source} {fault}; take two frames of each of several exposures, up to three quarters of full "
            "scale, and dark frames (--dark)"
        )
    return noise


def noise_of_places(
    places: PlaceSamples, calibration: SensorCalibration, dark: DarkResult | None, black_error: DoubleArray | None = None
) -> NoiseResult:
    """Measure noise from the patches of a chart: an upper bound if they have texture. Parameters, errors: see `noise_of_flats`."""
    noise = _fitted(places.chosen(~places.clipped), calibration, dark, black_error, "the chart's patches")
    if fault := _undetermined(noise, calibration):
        raise InputError(f"noise: {noise.source} {fault}; take pairs of flat frames (--flat)")
    return noise


def _fitted(
    points: PlaceSamples, calibration: SensorCalibration, dark: DarkResult | None, black_error: DoubleArray | None, source: str
) -> NoiseResult:
    """Fit a line per plane, after subtracting the variance that rounding to codes adds."""
    span = calibration.white_level - np.array(calibration.black_level)
    points = replace(points, variance=np.maximum(points.variance - _ROUNDING / span**2, 0))
    known = dark if dark is not None and dark.shows_read else None
    lines = []
    for plane, (mean, variance, count) in enumerate(zip(points.mean.T, points.variance.T, points.count.T, strict=True)):
        line = fit_photon_transfer(mean, variance, count, None if known is None else float(known.read[plane] / span[plane]))
        off = 0.0 if black_error is None else float(black_error[plane] / span[plane])
        # Black that is off stretches the levels, and moves the line's intercept.
        line = replace(line, shot_error=float(np.hypot(line.shot_error, line.shot * off)))
        if known is None:
            least = max(line.read, float(np.sqrt(line.shot * off)), 1e-12)
            lines.append(replace(line, read_error=float(np.hypot(line.read_error, line.shot * off / least))))
        else:
            lines.append(replace(line, read_error=float(known.read_error[plane] / span[plane])))
    return NoiseResult(tuple(lines), points, source)


def _undetermined(noise: NoiseResult, calibration: SensorCalibration) -> str | None:
    """Return why this noise is no measurement, None if it is one."""
    span = calibration.white_level - np.array(calibration.black_level)
    seen = noise.points.variance * span**2
    if not seen.size or float(seen.max(axis=0).min()) < _HIDDEN**2:
        return "show less noise than rounding to codes hides"
    if not noise.uncertainty <= _WORST_NOISE:
        part = f"±{100 * noise.uncertainty:.0f} %" if noise.uncertainty < 1 else "±100 % or more"
        return f"tell the noise at full scale only to {part}, and {100 * _WORST_NOISE:.0f} % are allowed"
    return None


def _grouped(points: PlaceSamples) -> PlaceSamples:
    """Return a few groups of places of like brightness, without places that have more than noise (something moved).

    A line fits the groups as well as the places, and camera.json can keep them.
    """
    if not points.mean.size:
        return points
    per_light = points.variance[:, -1] / np.maximum(points.mean[:, -1], 1e-6)
    kept = points.chosen(per_light <= _RESTLESS * np.median(per_light))
    rows = []
    for group in np.array_split(np.argsort(kept.mean[:, -1]), min(_GROUPS, len(kept.mean))):
        number = kept.count[group]
        free = np.maximum(number - 1, 0)
        mean = (kept.mean[group] * number).sum(axis=0) / number.sum(axis=0)
        variance = (kept.variance[group] * free).sum(axis=0) / np.maximum(free.sum(axis=0), 1)
        rows.append((mean, variance, free.sum(axis=0) + 1, False))
    return PlaceSamples(*(np.array(column) for column in zip(*rows, strict=True)))


def _pair_points(first: DoubleArray, second: DoubleArray, planes: np.ndarray, number: int) -> PlaceSamples:
    """Return mean and half the variance of the difference of two frames, per tile and plane; number: of planes."""
    rows = []
    for window in _tiles(planes):
        here = planes[window]
        mean, variance, count = np.zeros(number), np.zeros(number), np.zeros(number)
        brightest = 0.0
        for plane in range(number):
            a, b = first[window][here == plane], second[window][here == plane]
            difference = a - b
            centre, spread = _clipped(difference)
            good = np.abs(difference - centre) <= _CLIP * max(spread, 1e-12)
            mean[plane] = (a[good].mean() + b[good].mean()) / 2
            variance[plane] = difference[good].var(ddof=1) / 2
            count[plane] = good.sum()
            brightest = max(brightest, float(np.quantile(np.maximum(a, b), 0.99)))
        rows.append((mean, variance, count, brightest >= CLIPPED))
    points = PlaceSamples(*(np.array(column) for column in zip(*rows, strict=True)))
    return points.chosen(~points.clipped)


def _dead(bright: DoubleArray, difference: DoubleArray, planes: np.ndarray) -> tuple[tuple[tuple[int, int], ...], float]:
    """Return (row, column) of pixels with less than half the light of their plane in the same tile, and the part that cannot tell.

    bright, difference: (H, W), sum and difference of two frames; the difference shows the noise of the sum.

    A good pixel must not be as dark by chance, nor a dead one as bright: the limit, half the light, is _DEFECT deviations of the
    noise away from both. Where many pixels are dark it is the light that is uneven.
    """
    found, blind = [], 0
    for window in _tiles(planes):
        tile, here, noise = bright[window], planes[window], difference[window]
        for plane in np.unique(here):
            own = here == plane
            middle = float(np.median(tile[own]))
            low = own & (tile < _DEAD * middle)
            if (1 - _DEAD) * middle < _DEFECT * _clipped(noise[own])[1] or low.sum() > max(_MOST_DEAD * own.sum(), 2):
                blind += int(own.sum())
                continue
            found += [(window[0].start + row, window[1].start + column) for row, column in np.argwhere(low).tolist()]
    return tuple(found), blind / planes.size


def _tiles(planes: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Yield tiles of the frame, as many as possible with enough samples of every plane in each."""
    rarest = int(np.bincount(planes.ravel()).min())
    number = int(np.clip(np.sqrt(rarest / _LEAST_SAMPLES), 1, _TILES))
    rows, columns = (pairwise(np.unique(np.linspace(0, length, number + 1).astype(int)).tolist()) for length in planes.shape)
    for (top, bottom), (left, right) in product(rows, columns):
        yield slice(top, bottom), slice(left, right)


def _clipped(values: DoubleArray) -> tuple[float, float]:
    """Return mean and standard deviation without outliers, which are clipped until nothing changes.

    Do not use the median deviation: it is 0 or 1 for integer codes with little noise.
    """
    kept = values
    centre, spread = float(np.median(kept)), float(kept.std())
    for _ in range(50):
        inside = values[np.abs(values - centre) <= _CLIP * max(spread, 1e-12)]
        if inside.size in (0, kept.size):
            break
        kept = inside
        centre, spread = float(kept.mean()), float(kept.std())
    return centre, spread
