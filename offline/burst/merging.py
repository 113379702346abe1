"""Luminance from the panchromatic samples of all frames of a burst, each at its own place.

The frames sample one light field at places that differ by fractions of a pixel: together they show more of it than one frame can.
It is kept on a grid of half pixels. The start is the mean of the interpolated frames. Then, in several rounds, what the
grid misses of the samples is added around them (iterated back-projection: Irani and Peleg 1991). Where that is no more than noise,
nothing is changed, so that noise stays averaged and detail gets sharp.

Where the points of one frame of a burst lie in another: `offline.burst.Motion` inside kernels.
"""

import numpy as np

from ..numerics.arrays import Area, Bools2, Bytes3, Doubles2, Doubles3, Floats2, Floats3, Floats4, Ints2, Scalar
from ..numerics.compile import Pieces, kernel, parallel_kernel
from ..numerics.functions import tile_at, zeros
from ..numerics.gaussian import gaussian, smooth_rows
from ..numerics.interpolation import interpolated
from ..numerics.pieces import tiles
from .motion import ROUNDS

_ROWS, _COLUMNS, _MARGIN = 96, 160, 6  # pixels of a tile, chosen for speed, and around it
_ITERATIONS = 4  # rounds; chosen
_FILLED = 0.05  # weight of interpolated light where a frame has colour sites; chosen
_SPARSE = np.float32(0.05)  # samples per place of the grid, below which a correction is reduced; chosen
_NARROW, _WIDE = gaussian(0.5), gaussian(2.0)  # places of the grid: what is spread, and where its power is compared with noise
_ZERO, _ONE = np.float32(0), np.float32(1)
_MOST = 1e6  # relative precision, so that its square is a float: frames 10 stops brighter have less, and one without noise too
_ALONE = np.float32(0.99999)  # relative variance from which on there is one frame: the rest is rounding

Motions = tuple[Doubles3, Doubles2, Floats4]
"""(turns, starts, shifts) of F frames, (F, 2, 2), (F, 2), (F, node rows, node columns, 2), as `Motion` has them."""


@parallel_kernel(pieces=lambda *given: tiles(given[7].shape, (_ROWS, _COLUMNS)))
def merge(
    pieces: Pieces,
    planes: Floats3,
    agreement: Bytes3,
    noise: Doubles2,
    panchromatic: Bools2,
    motions: Motions,
    sites: Ints2,
    period: int,
    merged: Floats2,
    variance: Floats2,
    light: Floats4,
    weight: Floats4,
) -> None:
    """Merge the frames of a burst.

    planes: (F, H, W), luminance of each frame, filled in at the colour sites, in units of the reference, which is the first.
    agreement: (F, H, W), how far each frame agrees with the reference at each pixel of the reference, 0 to 255.
    noise: (F, 2), shot and squared read noise of each plane; all zero: there is no noise. A plane whose variance is 0 while the
        reference's is not counts as much as a million references.
    panchromatic: (H, W), which pixels are.
    motions: where the reference's points lie in each frame.
    sites: (S, 2), frame row and column of each colour site of the first whole block. period: K.
    merged: (H, W), written: luminance of the reference.
    variance: (H, W), written: variance of the noise of `merged`, relative to the reference's.
    light, weight: (F, block rows, block columns, S), written: luminance where each colour sample of each frame lies in the
        reference, and how far the frame agrees with it there, 0 to 1; 0 beyond it.
    """
    height, width = merged.shape
    for tile in range(pieces[0], pieces[1]):
        core = tile_at(tile, (height, width), (_ROWS, _COLUMNS))
        area = max(core[0] - _MARGIN, 0), min(core[1] + _MARGIN, height), max(core[2] - _MARGIN, 0), min(core[3] + _MARGIN, width)
        fine = _start(planes, agreement, noise, panchromatic, motions, area, core, variance)
        samples = _samples(planes, agreement, noise, panchromatic, motions, area)
        _sharpen(fine, samples, noise[0, 0] + noise[0, 1] > 0)
        for y in range(core[0], core[1]):
            for x in range(core[2], core[3]):
                merged[y, x] = fine[2 * (y - area[0]), 2 * (x - area[2])]
        _light_at_sites(fine, agreement, motions, sites, period, area, core, light, weight)


@parallel_kernel()
def displace(pieces: Pieces, plane: Floats2, motions: Motions, out: Floats2) -> None:
    """A frame as the reference would see it.

    plane: (H, W). motions: one.
    out: (H, W), written; NaN where the frame sees nothing.
    """
    shape, still = (1, plane.shape[0], plane.shape[1]), motions[2].shape[1] < 2
    yy, yx, xy, xx = motions[0][0, 0, 0], motions[0][0, 0, 1], motions[0][0, 1, 0], motions[0][0, 1, 1]
    first_y, first_x = motions[1][0, 0], motions[1][0, 1]
    for y in range(pieces[0], pieces[1]):
        for x in range(plane.shape[1]):
            to_y, to_x = yy * y + yx * x + first_y, xy * y + xx * x + first_x
            if not still:
                to_y, to_x = there(motions, 0, float(y), float(x), shape)
            inside = -0.5 <= to_y < plane.shape[0] - 0.5 and -0.5 <= to_x < plane.shape[1] - 0.5
            out[y, x] = interpolated(plane, to_y, to_x) if inside else np.float32(np.nan)


@kernel
def _start(
    planes: Floats3, agreement: Bytes3, noise: Doubles2, panchromatic: Bools2, motions: Motions,
    area: Area, core: Area, variance: Floats2
) -> Floats2:  # fmt: skip
    """The mean of the interpolated frames on the grid of half pixels of an area; and `variance` in its core."""
    rows, columns = area[1] - area[0], area[3] - area[2]
    mean, totals, spreads = zeros(rows, columns), zeros(rows, columns), zeros(rows, columns)
    for frame in range(len(planes)):
        plane = planes[frame]
        for row in range(rows):
            for column in range(columns):
                y, x = area[0] + row, area[2] + column
                if agreement[frame, y, x] == 0:
                    continue
                to_y, to_x = there(motions, frame, float(y), float(x), planes.shape)
                if not (-0.5 <= to_y < planes.shape[1] - 0.5 and -0.5 <= to_x < planes.shape[2] - 0.5):
                    continue
                precision = _precision(noise, frame, max(planes[0, y, x], _ZERO))
                share = (_FILLED + _measured(panchromatic, to_y, to_x)) * agreement[frame, y, x] / 255.0
                mean[row, column] += share * precision * interpolated(plane, to_y, to_x)
                totals[row, column] += share * precision
                spreads[row, column] += share * share * precision
    for row in range(rows):
        for column in range(columns):
            y, x, total = area[0] + row, area[2] + column, totals[row, column]
            mean[row, column] /= total
            if core[0] <= y < core[1] and core[2] <= x < core[3]:
                share = spreads[row, column] / (total * total)
                variance[y, x] = share if share < _ALONE else _ONE
    fine = zeros(2 * rows - 1, 2 * columns - 1)
    for row in range(2 * rows - 1):
        for column in range(2 * columns - 1):
            fine[row, column] = interpolated(mean, 0.5 * row, 0.5 * column)
    return fine


@kernel
def _precision(noise: Doubles2, frame: int, light: Scalar) -> float:
    """Precision of a frame's samples relative to the reference's."""
    reference = noise[0, 0] * light + noise[0, 1]
    if not reference > 0:
        return 1.0
    precision: float = min(max(reference / (noise[frame, 0] * light + noise[frame, 1]), 1 / _MOST), _MOST)
    return precision


@kernel
def _measured(panchromatic: Bools2, y: float, x: float) -> float:
    """How far light interpolated at a place of a frame is measured there, 0 to 1."""
    y, x = min(max(y, 0.0), panchromatic.shape[0] - 1.001), min(max(x, 0.0), panchromatic.shape[1] - 1.001)
    top, left = int(y), int(x)
    down, across = y - top, x - left
    upper = (1 - across) * panchromatic[top, left] + across * panchromatic[top, left + 1]
    lower = (1 - across) * panchromatic[top + 1, left] + across * panchromatic[top + 1, left + 1]
    light: float = (1 - down) * upper + down * lower
    return light


@kernel
def _samples(planes: Floats3, agreement: Bytes3, noise: Doubles2, panchromatic: Bools2, motions: Motions, area: Area) -> Floats2:
    """The panchromatic samples that lie in an area: (samples, 5), place on the grid (y, x), value, weight, variance."""
    frames, height, width = planes.shape
    most = count = 0
    for frame in range(frames):
        first, last, before, after = bounds(motions, frame, area, planes.shape)
        most += max(last - first, 0) * max(after - before, 0)
    found = np.empty((most, 5), np.float32)
    for frame in range(frames):
        first, last, before, after = bounds(motions, frame, area, planes.shape)
        for row in range(first, last):
            for column in range(before, after):
                if not panchromatic[row, column]:
                    continue
                y, x = back(motions, frame, float(row), float(column), planes.shape)
                if not (area[0] <= y <= area[1] - 1 and area[2] <= x <= area[3] - 1):
                    continue
                agrees = agreement[frame, min(int(y + 0.5), height - 1), min(int(x + 0.5), width - 1)]
                if agrees == 0:
                    continue
                value = planes[frame, row, column]
                found[count, 0], found[count, 1], found[count, 2] = 2 * (y - area[0]), 2 * (x - area[2]), value
                found[count, 3] = agrees / 255.0 * _precision(noise, frame, max(value, _ZERO))
                found[count, 4] = noise[frame, 0] * max(value, _ZERO) + noise[frame, 1]
                count += 1
    return found[:count]


@kernel
def _sharpen(fine: Floats2, samples: Floats2, noisy: bool) -> None:
    """Add what the grid misses of the samples to the places around them, in several rounds."""
    rows, columns = fine.shape
    error, count, power = zeros(rows, columns), zeros(rows, columns), zeros(rows, columns)
    near, wide, missed_near, missed_wide = zeros(rows, columns), zeros(rows, columns), zeros(rows, columns), zeros(rows, columns)
    for sample in range(len(samples)):
        _splat(count, samples[sample, 0], samples[sample, 1], samples[sample, 3])
    smooth_rows(count, _NARROW, 0, rows, near)
    if noisy:
        smooth_rows(count, _WIDE, 0, rows, wide)
    for _ in range(_ITERATIONS):
        for row in range(rows):
            for column in range(columns):
                error[row, column] = power[row, column] = _ZERO
        for sample in range(len(samples)):
            y, x, weight = samples[sample, 0], samples[sample, 1], samples[sample, 3]
            missed = samples[sample, 2] - interpolated(fine, y, x)
            _splat(error, y, x, weight * missed)
            if noisy:
                _splat(power, y, x, weight * missed * missed / max(samples[sample, 4], np.float32(1e-20)))
        smooth_rows(error, _NARROW, 0, rows, missed_near)
        if noisy:
            smooth_rows(power, _WIDE, 0, rows, missed_wide)
        for row in range(rows):
            for column in range(columns):
                gain = _ONE
                if noisy:
                    gain = max(_ZERO, _ONE - wide[row, column] / max(missed_wide[row, column], np.float32(1e-20)))
                fine[row, column] += gain * missed_near[row, column] / (near[row, column] + _SPARSE)


@kernel
def _splat(plane: Floats2, y: Scalar, x: Scalar, value: Scalar) -> None:
    """Add a value to the four places around (y, x)."""
    top, left = min(int(y), plane.shape[0] - 2), min(int(x), plane.shape[1] - 2)
    down, across = y - np.float32(top), x - np.float32(left)
    plane[top, left] += (_ONE - down) * (_ONE - across) * value
    plane[top, left + 1] += (_ONE - down) * across * value
    plane[top + 1, left] += down * (_ONE - across) * value
    plane[top + 1, left + 1] += down * across * value


@kernel
def _light_at_sites(
    fine: Floats2, agreement: Bytes3, motions: Motions, sites: Ints2, period: int,
    area: Area, core: Area, light: Floats4, weight: Floats4
) -> None:  # fmt: skip
    """Luminance at the colour samples that lie in the core of an area, and how far their frames agree there."""
    for frame in range(len(agreement)):
        first, last, before, after = bounds(motions, frame, core, agreement.shape)
        for site in range(len(sites)):
            begin = max(0, -((sites[site, 0] - first) // period)), max(0, -((sites[site, 1] - before) // period))
            for row in range(begin[0], light.shape[1]):
                if sites[site, 0] + row * period >= last:
                    break
                for column in range(begin[1], light.shape[2]):
                    if sites[site, 1] + column * period >= after:
                        break
                    place = float(sites[site, 0] + row * period), float(sites[site, 1] + column * period)
                    y, x = back(motions, frame, place[0], place[1], agreement.shape)
                    near = int(np.floor(y + 0.5)), int(np.floor(x + 0.5))
                    if core[0] <= near[0] < core[1] and core[2] <= near[1] < core[3]:
                        light[frame, row, column, site] = interpolated(fine, 2 * (y - area[0]), 2 * (x - area[2]))
                        weight[frame, row, column, site] = agreement[frame, near[0], near[1]] / 255.0


@kernel
def there(motions: Motions, frame: int, y: float, x: float, shape: tuple[int, int, int]) -> tuple[float, float]:
    """Where a point of the reference lies in a frame."""
    turns, starts, shifts = motions
    down, across = _shift(shifts, frame, y, x, shape)
    return (
        turns[frame, 0, 0] * y + turns[frame, 0, 1] * x + starts[frame, 0] + down,
        turns[frame, 1, 0] * y + turns[frame, 1, 1] * x + starts[frame, 1] + across,
    )


@kernel
def back(motions: Motions, frame: int, y: float, x: float, shape: tuple[int, int, int]) -> tuple[float, float]:
    """Where a point of a frame lies in the reference."""
    turns, starts, shifts = motions
    down, across = y - starts[frame, 0], x - starts[frame, 1]
    at_y = turns[frame, 0, 0] * down + turns[frame, 1, 0] * across
    at_x = turns[frame, 0, 1] * down + turns[frame, 1, 1] * across
    if shifts.shape[1] < 2:
        return at_y, at_x
    for _ in range(ROUNDS):
        local = _shift(shifts, frame, at_y, at_x, shape)
        at_y = turns[frame, 0, 0] * (down - local[0]) + turns[frame, 1, 0] * (across - local[1])
        at_x = turns[frame, 0, 1] * (down - local[0]) + turns[frame, 1, 1] * (across - local[1])
    return at_y, at_x


@kernel
def _shift(shifts: Floats4, frame: int, y: float, x: float, shape: tuple[int, int, int]) -> tuple[float, float]:
    """The local shift at a point of the reference."""
    rows, columns = shifts.shape[1], shifts.shape[2]
    if rows < 2:
        return 0.0, 0.0
    at_y = min(max(y * (rows - 1) / max(shape[1] - 1, 1), 0.0), rows - 1.0)
    at_x = min(max(x * (columns - 1) / max(shape[2] - 1, 1), 0.0), columns - 1.0)
    top, left = min(int(at_y), rows - 2), min(int(at_x), columns - 2)
    down, across = at_y - top, at_x - left
    a, b, c, d = (1 - down) * (1 - across), (1 - down) * across, down * (1 - across), down * across
    return (
        a * shifts[frame, top, left, 0] + b * shifts[frame, top, left + 1, 0]
        + c * shifts[frame, top + 1, left, 0] + d * shifts[frame, top + 1, left + 1, 0],
        a * shifts[frame, top, left, 1] + b * shifts[frame, top, left + 1, 1]
        + c * shifts[frame, top + 1, left, 1] + d * shifts[frame, top + 1, left + 1, 1],
    )  # fmt: skip


@kernel
def bounds(motions: Motions, frame: int, area: Area, shape: tuple[int, int, int]) -> Area:
    """First and end row, first and end column, of a frame's pixels that may lie in an area of the reference."""
    low, high = np.array([1e9, 1e9]), np.array([-1e9, -1e9])
    steps = 8 if motions[2].shape[1] > 1 else 1
    for i in range(steps + 1):
        for j in range(steps + 1):
            if 0 < i < steps and 0 < j < steps:
                continue
            y, x = area[0] - 1 + (area[1] - area[0] + 1) * i / steps, area[2] - 1 + (area[3] - area[2] + 1) * j / steps
            at = there(motions, frame, y, x, shape)
            for axis in range(2):
                low[axis], high[axis] = min(low[axis], at[axis]), max(high[axis], at[axis])
    return (
        max(int(np.floor(low[0])) - 1, 0), min(int(np.ceil(high[0])) + 2, shape[1]),
        max(int(np.floor(low[1])) - 1, 0), min(int(np.ceil(high[1])) + 2, shape[2]),
    )  # fmt: skip
