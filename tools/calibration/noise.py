"""Noise, black level and defects per filter colour, from dark frames and pairs of flat frames (EMVA Standard 1288, release 4)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from shared import Mosaic, NoiseModel
from shared.arrays import DoubleArray
from shared.errors import InputError

from .photon_transfer import PhotonTransfer, fit_photon_transfer
from .samples import CLIPPED, PlaceSamples, levels_of

_ROUNDING = 1 / 12  # code^2, the variance that rounding to whole codes adds (Sheppard's correction)
_CLIP = 5.0  # standard deviations kept when a spread is measured
_DEFECT = 5.5  # standard deviations of the averaged dark frame: 4e-8 of good pixels lie beyond
_DEAD = 0.5  # of the median of its plane nearby, in a flat frame
_NOT_DARK = 0.1  # of full scale above black
_ALIKE = 0.03  # relative: flats of one exposure
_TILES = 12  # per side, at most: flats are never quite even, so means and variances are taken in tiles
_LEAST_SAMPLES = 40  # of the rarest plane in a tile, about


@dataclass(frozen=True, eq=False)
class DarkResult:
    """Of N dark frames. black: codes per plane, and black_error; read: standard deviation per plane, codes, rounding taken out."""

    frames: int
    black: DoubleArray
    black_error: DoubleArray
    read: DoubleArray
    defects: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class NoiseResult:
    """Photon transfer per plane (the channels, then panchromatic), in parts of full scale, with the points behind the lines."""

    lines: tuple[PhotonTransfer, ...]
    points: PlaceSamples
    source: str

    def model(self, full_scale: float) -> NoiseModel:
        """In scene units, `full_scale` of them at the white level: shot scales with it, read too (variance with its square)."""
        return NoiseModel(
            tuple(full_scale * line.shot for line in self.lines), tuple(full_scale * line.read for line in self.lines)
        )


def measure_dark(frames: Sequence[Mosaic]) -> DarkResult:
    """Black level and read noise per filter colour, and the pixels that are not black.

    frames: at least one, all alike. Raises InputError when they are not dark.
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
    black, error, read = np.zeros(number), np.zeros(number), np.zeros(number)
    defect = np.zeros(first.shape, bool)
    for plane in range(number):
        here = planes == plane
        values = mean[here]
        centre, spread = _clipped(values)
        good = np.abs(values - centre) <= max(_DEFECT * spread, 0.5 / len(frames))
        defect[here] = ~good
        black[plane] = values[good].mean()
        error[plane] = spread / np.sqrt(max(good.sum(), 1))
        samples = stack[:, here][:, good]
        variance = float(samples.var(axis=0, ddof=1).mean() if len(frames) > 1 else samples.var(ddof=1))
        read[plane] = np.sqrt(max(variance - _ROUNDING, 0.0))
    rows, columns = np.nonzero(defect)
    return DarkResult(len(frames), black, error, read, tuple(zip(rows.tolist(), columns.tolist(), strict=True)))


def measure_flats(frames: Sequence[Mosaic], read: DoubleArray | None) -> tuple[NoiseResult, list[tuple[int, int]], list[int]]:
    """Photon transfer from pairs of equal flat frames: half the variance of their difference is noise alone, without fixed pattern.

    read: per plane, parts of full scale, known from dark frames; or None: the intercept.
    Returns the result, the pixels that are dead in the brightest pair, and the indices of frames that found no partner.
    Raises InputError when there is no pair.
    """
    planes = frames[0].pattern.filter_map(frames[0].shape)
    white = len(frames[0].pattern.planes) - 1
    levels = [levels_of(frame).astype(np.float64) for frame in frames]
    brightness = [float(np.median(level[planes == white])) for level in levels]
    order = sorted((index for index in range(len(frames)) if 0 < brightness[index] < CLIPPED), key=lambda index: brightness[index])
    pairs, alone = [], [index for index in range(len(frames)) if index not in order]
    while order:
        first = order.pop(0)
        if order and brightness[order[0]] <= brightness[first] * (1 + _ALIKE):
            pairs.append((first, order.pop(0)))
        else:
            alone.append(first)
    if not pairs:
        raise InputError(
            "flat frames: no two have the same exposure without being clipped; take two of each, at several exposures up to three "
            "quarters of full scale"
        )
    points = PlaceSamples.joined([_pair_points(levels[first], levels[second], planes, white + 1) for first, second in pairs])
    result = _fitted(points, frames[0], read, f"{len(pairs)} pairs of flat frames")
    first, second = pairs[-1]
    return result, _dead(levels[first] + levels[second], planes), alone


def noise_of_places(places: PlaceSamples, mosaic: Mosaic, read: DoubleArray | None) -> NoiseResult:
    """Photon transfer from the patches of a chart: an upper bound where they have texture. Arguments as above."""
    return _fitted(places.chosen(~places.clipped), mosaic, read, "the chart's patches")


def _fitted(points: PlaceSamples, mosaic: Mosaic, read: DoubleArray | None, source: str) -> NoiseResult:
    """A line per plane, after taking out the variance that rounding to codes adds."""
    calibration = mosaic.calibration
    rounding = _ROUNDING / (calibration.white_level - np.array(calibration.black_level)) ** 2
    points = replace(points, variance=np.maximum(points.variance - rounding, 0))
    lines = tuple(
        fit_photon_transfer(
            points.mean[:, plane], points.variance[:, plane], points.count[:, plane], None if read is None else float(read[plane])
        )
        for plane in range(points.mean.shape[1])
    )
    return NoiseResult(lines, points, source)


def _pair_points(first: DoubleArray, second: DoubleArray, planes: np.ndarray, number: int) -> PlaceSamples:
    """Mean, and half the variance of the difference, of each plane in tiles."""
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
        middle = ((window[0].start + window[0].stop) / 2, (window[1].start + window[1].stop) / 2)
        rows.append((mean, variance, count, brightest >= CLIPPED, middle))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    points = PlaceSamples(*columns)
    return points.chosen(~points.clipped)


def _dead(bright: DoubleArray, planes: np.ndarray) -> list[tuple[int, int]]:
    """Pixels with less than half the light of their plane around them."""
    found = []
    for window in _tiles(planes):
        tile, here = bright[window], planes[window]
        for plane in np.unique(here):
            low = (here == plane) & (tile < _DEAD * np.median(tile[here == plane]))
            found += [(window[0].start + row, window[1].start + column) for row, column in np.argwhere(low).tolist()]
    return found


def _tiles(planes: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """The frame in tiles, as many as leave enough samples of every plane in each."""
    rarest = int(np.bincount(planes.ravel()).min())
    number = int(np.clip(np.sqrt(rarest / _LEAST_SAMPLES), 1, _TILES))
    for top, bottom in _cuts(planes.shape[0], number):
        for left, right in _cuts(planes.shape[1], number):
            yield slice(top, bottom), slice(left, right)


def _cuts(length: int, number: int) -> list[tuple[int, int]]:
    edges = np.linspace(0, length, number + 1).astype(int).tolist()
    return [(start, stop) for start, stop in pairwise(edges) if stop > start]


def _clipped(values: DoubleArray) -> tuple[float, float]:
    """Mean and standard deviation without outliers, by clipping until nothing changes.

    Not the median deviation: whole codes a fraction of one apart have none.
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
