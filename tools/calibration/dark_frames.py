"""Black level, read noise and hot pixels per filter colour, from dark frames; whether light fell in
(EMVA Standard 1288).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ...shared import DoubleArray, IndexArray, InputError, Mosaic
from . import places

# in steps between codes, squared: the variance that rounding adds (Sheppard's correction)
ROUNDING = 1 / 12
# steps: rounding distorts a smaller standard deviation, whatever is subtracted for it (EMVA 1288
# asks for as much)
HIDDEN = 0.5
DEFECT = 5.5  # standard deviations in the averaged dark frame: 4e-8 of good pixels are beyond
_LEAST_DEFECT = 1.5  # steps: rounding alone moves good pixels by one
_NOT_DARK = 0.1  # of full scale above black
# times the variance of another dark frame: one has another gain or exposure, or is no measurement
# at all
_UNLIKE = 4.0
# standard deviations (and steps) that black may move between dark frames, as with temperature
_DRIFT = 3.0
# Of the read noise: drift expected before any is seen, and its weight in frames.
_USUAL_DRIFT, _USUAL_DRIFT_FRAMES = 0.02, 2
# Of the range of codes, and steps: black levels of the planes that differ by less are those of
# electronics.
_LEAK, _LEAST_LEAK = 1 / 2048, 1.5
_CUT = 1e-3  # of the samples: so many that read 0 were cut off there
# Of the read noise, and standard errors: black levels of the sites of one plane that differ by more
# show as a pattern in shadows.
_SITES, _SURE_SITES = 0.5, 5.0
# Correlation of levels and variances of the planes, from which on both rise together.
_IN_LINE = 0.9


@dataclass(frozen=True, eq=False)
class DarkResult:
    """Measurements of dark frames, per plane (the C channels, then panchromatic), in codes.

    Attributes
    ----------
    frames : int
        Their number.
    black : DoubleArray
        (C + 1,), black level.
    black_error : DoubleArray
        (C + 1,), its standard error.
    read : DoubleArray
        (C + 1,), read noise as a standard deviation, without the effect of rounding to codes.
    read_error : DoubleArray
        (C + 1,), its standard error.
    defects : tuple[tuple[int, int], ...]
        (row, column) of pixels that are not black.
    rows : float
        Variance that the panchromatic samples of a row have in common, codes^2; of one frame, with
        its fixed pattern.
    step : int
        Between codes.
    sites : float
        How far the black level of one site of the tile is from that of its plane, at most, codes;
        0 = by no more than noise hides.
    """

    frames: int
    black: DoubleArray
    black_error: DoubleArray
    read: DoubleArray
    read_error: DoubleArray
    defects: tuple[tuple[int, int], ...]
    rows: float = 0.0
    step: int = 1
    sites: float = 0.0

    @property
    def shows_read(self) -> bool:
        """True if the codes are fine enough to show the read noise."""
        return bool((self.read >= HIDDEN * self.step).all())

    @property
    def words(self) -> str:
        """Black level, read noise and defects, for people."""
        read, black = "too small for these codes", places.figures(self.black)
        if self.shows_read:
            read = f"{places.figures(self.read)} codes"
        return f"black level {black} codes, read noise {read}, {len(self.defects)} defects"


def check_dark(frame: Mosaic) -> None:
    """Raise InputError if a frame that is given as dark is not."""
    level = float(np.median(places.levels_of(frame)))
    if level > _NOT_DARK:
        found = f"its median is {100 * level:.0f} % of full scale"
        raise InputError(f"is not dark: {found}; cover the lens")


def measure_dark(frames: Sequence[Mosaic], names: Sequence[str] = ()) -> DarkResult:
    """Measure black level and read noise per filter colour, and find the pixels that are not black.

    frames: one or more, with the same exposure, each after `check_dark`. names: of their files.
    Raises InputError if light fell in, or if they clearly differ in noise or level.
    """
    first = frames[0]
    planes = places.planes_of(first, defects=True)  # which are found anew
    number = len(first.pattern.planes)
    codes = np.stack([frame.codes for frame in frames])
    step, stack = places.code_step(codes), codes.astype(np.float64)
    mean, rounding, hidden = stack.mean(axis=0), ROUNDING * step**2, HIDDEN * step
    _check_alike(stack[:, planes == number - 1], names, step)
    black, error, read, read_error = (np.zeros(number) for _ in range(4))
    common = variance = 0.0
    defect = np.zeros(first.shape, bool)
    for plane in range(number):
        here = planes == plane
        values = mean[here]
        centre, spread = places.clipped_moments(values)
        good = np.abs(values - centre) <= max(DEFECT * spread, _LEAST_DEFECT * step)
        defect[here] = ~good
        black[plane] = values[good].mean()
        error[plane] = values[good].std() / np.sqrt(max(good.sum(), 1))
        samples = stack[:, here][:, good]
        levels = samples.mean(axis=1, keepdims=True)
        variance = float(samples.var(ddof=1))
        if len(frames) > 1:
            # The common drift of a frame is no read noise.
            variance = float((samples - levels).var(axis=0, ddof=1).sum())
            variance /= max(good.sum() - 1, 1)
        read[plane] = np.sqrt(max(variance - rounding, 0.0))
        if read[plane] >= hidden and (cut := float((samples == 0).mean())) > _CUT:
            raise InputError(
                f"dark frames: {100 * cut:.2g} % of the samples of {first.pattern.planes[plane]} "
                "read 0: the sensor cuts off noise below black, so they show neither black level "
                "nor read noise; raise its black level (offset), or leave them out"
            )
        # What whole frames drift by is an error of the black level that samples of one frame do not
        # show, and few frames hardly.
        usual = _USUAL_DRIFT_FRAMES * _USUAL_DRIFT**2 * variance
        squares = ((levels - levels.mean()) ** 2).sum() + usual
        drift = squares / (len(frames) - 1 + _USUAL_DRIFT_FRAMES)
        error[plane] = np.hypot(error[plane], np.sqrt(drift / len(frames)))
        # Then the mean of the codes is not that of the samples, however many there are.
        if read[plane] < hidden:
            error[plane] = np.hypot(error[plane], np.sqrt(rounding))
        common = _in_common(samples, row := np.nonzero(here)[0][good])
        alike = 1 + (np.bincount(row).max() - 1) * common**2  # samples that count as one
        independent = good.sum() * max(len(frames) - 1, 1) / alike
        read_error[plane] = variance / (max(read[plane], hidden) * np.sqrt(2 * max(independent, 1)))
    defects = tuple((row, column) for row, column in np.argwhere(defect).tolist())
    offsets = np.where(defect, 0.0, mean - black[planes])
    least = _SITES * max(float(read.max()), hidden)
    sites = _site_offset(offsets, first.pattern.period, least)
    measured = black, error, read, read_error, defects, common * variance, step, sites
    result = DarkResult(len(frames), *measured)
    _check_light(first, mean, result)
    return result


def _site_offset(offsets: DoubleArray, period: int, least: float) -> float:
    """Return the largest mean of a site of the tile, codes; 0 if it is below `least`, or chance.

    offsets: (H, W), of averaged dark frames from the black levels of their planes.
    """
    largest = 0.0
    for row, column in product(range(period), repeat=2):
        site = offsets[row::period, column::period]
        # Rows and columns have noise in common.
        chances = (site.mean(axis=1 - axis).std() / site.shape[axis] ** 0.5 for axis in (0, 1))
        if abs(site.mean()) > max(least, _SURE_SITES * max(chances)):
            largest = max(largest, abs(float(site.mean())))
    return largest


def _in_common(samples: DoubleArray, rows: IndexArray) -> float:
    """Return the share of the noise's variance that samples of a row have in common.

    samples: (frames, N); rows: (N,), of each.
    """
    noise = samples - samples.mean(axis=1, keepdims=True)
    noise -= noise.mean(axis=0) * (len(noise) > 1)  # fixed pattern
    number, variance = np.bincount(rows), float(noise.var())
    sums = np.array([np.bincount(rows, of_frame) for of_frame in noise])
    pairs = float((number * (number - 1)).sum()) * len(noise)
    common = float((sums**2).sum() - noise.size * variance) / max(pairs * variance, 1e-12)
    return max(common, 0.0)


def _check_alike(samples: DoubleArray, names: Sequence[str], step: int) -> None:
    """Raise InputError if dark frames clearly differ; samples: of one plane, (frames, samples).
    step: between codes.
    """
    levels, spreads = np.array([places.clipped_moments(frame) for frame in samples]).T
    # Of codes that happen not to change, rounding hides the noise.
    noises = np.sqrt(spreads**2 + ROUNDING * step**2)
    most_noise = np.sqrt(_UNLIKE) * noises.min()
    most_level = levels.min() + _DRIFT * max(float(noises.max()), float(step))
    for what, values, limit in (("noise", noises, most_noise), ("level", levels, most_level)):
        low, high = int(values.argmin()), int(values.argmax())
        if values[high] > limit:
            names = names or [f"frame {number + 1}" for number in range(len(samples))]
            both = f"{names[low]} is {values[low]:.4g} codes, of {names[high]} {values[high]:.4g}"
            fault = f"the {what} of {both}: they have another gain or exposure, or light fell in"
            raise InputError(f"dark frames: {fault}; take all in the same way")


def _check_light(frame: Mosaic, mean: DoubleArray, dark: DarkResult) -> None:
    """Raise InputError if light has fallen on dark frames: in all of the sensor, or in some of
    it.

    frame: one of them; mean: (H, W), of all, codes; dark: what they show.

    Panchromatic samples collect the light of all channels, so light lifts them above the others,
    and light has shot noise: the planes' variances rise along a line over their levels. Heat lifts
    all planes alike, and an electronic offset has no noise.
    """
    letters, planes = frame.pattern.planes, places.planes_of(frame, defects=True)
    black, noise = dark.black, np.hypot(dark.read, (ROUNDING * dark.step**2) ** 0.5)
    limit = max(_LEAK * frame.calibration.white_level, _LEAST_LEAK * dark.step)
    lift = black - black[:-1].min()
    variance = noise**2
    slope = float(np.polyfit(lift, variance, 1)[0]) if np.ptp(lift) > 0 else 0.0
    samples = max(float(np.bincount(planes.ravel()).min()) * dark.frames, 1.0)
    sure = variance.mean() * np.sqrt(2 / samples)
    agrees = slope * np.ptp(lift) > 4 * sure and float(np.corrcoef(lift, variance)[0, 1]) > _IN_LINE
    if np.ptp(black) > limit and black[-1] - black[:-1].mean() > limit / 2 and agrees:
        levels = ", ".join(map("{} {:.1f}".format, letters, black))
        noises = ", ".join(map("{} {:.2f}".format, letters, noise))
        found = f"light fell in: their levels are {levels} codes, with a noise of {noises}"
        why = "as they do in light, most in W, which sees all colours"
        remedy = "cover lens and viewfinder, and take them in the dark"
        raise InputError(f"dark frames: {found}: both rise from filter to filter {why}; {remedy}")
    lifts = []
    for window in places.windows(planes):
        signal, here = mean[window], planes[window]
        middle = [float(np.median(signal[here == plane])) for plane in range(len(letters))]
        lifts.append((middle[-1] - float(np.mean(middle[:-1])), window))
    usual = float(np.median([above for above, _ in lifts]))
    most, (rows, columns) = max(lifts, key=lambda window: window[0])
    clip = places.CLIP * float(noise.max())
    if most - usual > max(limit, clip / np.sqrt(dark.frames * places.LEAST_SAMPLES)):
        place = f"row {(rows.start + rows.stop) // 2}, column {(columns.start + columns.stop) // 2}"
        above = f"W is {most - usual:.1f} codes further above the other filters there"
        fault = f"light fell in around {place}: {above} than elsewhere"
        raise InputError(f"dark frames: {fault}; cover lens and viewfinder")
