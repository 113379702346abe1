"""Luminance from the panchromatic samples of all frames of a burst, each at its own place.

The frames sample one image at places that differ by fractions of a pixel: together they show
more of it than one frame can. It is kept on a grid of half pixels. The start is the mean of the
interpolated frames. Then, in several rounds, what the grid misses of the samples is added around
them (iterated back-projection: Irani and Peleg 1991). Where that is no more than noise, nothing is
changed, so that noise stays averaged and detail gets sharp.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...shared import FloatArray, Mosaic, NoiseModel
from ..frame import Sites
from ..numerics.arrays import Area, Bools2, Bytes3, Doubles2, Floats2, Floats3, Ints2, Scalar
from ..numerics.compile import ONE, ZERO, Chunks, kernel, parallel_kernel
from ..numerics.functions import chunk_at, chunk_count, zeros
from ..numerics.gaussian import gaussian, smooth_rows
from ..numerics.interpolation import interpolated
from ..settings import RenderSettings
from ..stages.denoising import denoise_luminance
from .motion import Motions, displaced, frame_place, reference_place
from .select import Kept

_ROWS, _COLUMNS, _MARGIN = 96, 160, 6  # pixels of a chunk, chosen for speed, and around it
_ITERATIONS = 4  # rounds; chosen
_FILLED = 0.05  # weight of interpolated luminance where a frame has colour sites; chosen
# samples per place of the grid, below which a correction is reduced; chosen
_SPARSE = np.float32(0.05)
# places of the grid: what is spread, and where its power is compared with noise
_NARROW, _WIDE = gaussian(0.5), gaussian(2.0)
_LEAST = np.float32(1e-20)
# relative precision, so that its square is a float: frames 10 stops brighter have less, and one
# without noise too
_MOST_PRECISION = 1e6
# relative variance from which on there is one frame: the rest is rounding
_ALONE = np.float32(0.99999)
# of the logarithm of noise that merging took off, from which a frame is denoised twice; chosen: no
# scene changes
_SOME_ALONE = 0.1


class Frames(NamedTuple):
    """The F frames of a burst for kernels, the reference first.

    Attributes
    ----------
    planes : Floats3
        (F, H, W), luminance of each frame, filled in at the colour sites, in units of the
        reference.
    agreement : Bytes3
        (F, H, W), with the reference at each pixel of the reference, 0 to 255.
    noise : Doubles2
        (F, 2), shot and squared read noise of each plane; all zero: there is no noise.
    panchromatic : Bools2
        (H, W), whether a pixel is.
    motions : Motions
        Where the reference's points lie in each frame.
    """

    planes: Floats3
    agreement: Bytes3
    noise: Doubles2
    panchromatic: Bools2
    motions: Motions


def merge_luminance(kept: Sequence[Kept], sites: Sites) -> tuple[FloatArray, FloatArray]:
    """Luminance of the reference from all frames, (2 H - 1, 2 W - 1), every half pixel, and its
    `noise_ratio`.

    noise_ratio: (H, W), variance of the noise of luminance, relative to the reference's.

    Parameters
    ----------
    kept : Sequence[Kept]
        The reference first.
    sites : Sites
        Of the reference.
    """
    shape, (views, motions, agreement) = sites.grid.frame, zip(*kept, strict=True)
    planes = np.stack([view.luminance for view in views])
    noise = np.array([(view.noise.shot[-1], view.noise.read[-1] ** 2) for view in views])
    panchromatic, places = sites.pattern.panchromatic_mask(shape), Motions.of(motions, shape)
    frames = Frames(planes, np.stack(agreement), noise, panchromatic, places)
    luminance = np.empty((2 * shape[0] - 1, 2 * shape[1] - 1), np.float32)
    noise_ratio = np.empty(shape, np.float32)
    merge(frames, luminance, noise_ratio)
    return luminance, noise_ratio


def uncovered(kept: Sequence[Kept], sites: Sites) -> FloatArray:
    """Degree, 0 to 1, to which no panchromatic sample of a frame that agrees covers each pixel, (H,
    W).
    """
    mask = sites.pattern.panchromatic_mask(sites.grid.frame).astype(np.float32)
    total = np.zeros_like(mask)
    for one in kept:
        total += np.nan_to_num(displaced(mask, one.motion)) * one.agreement / 255
    return 1 - total.clip(0, 1)


def denoised(
    luminance: FloatArray, noise_ratio: FloatArray, samples: Mosaic, settings: RenderSettings
) -> FloatArray:
    """Luminance, denoised by the noise that merging has left in most pixels, and by all of it where
    one frame is alone.
    """
    noise = samples.calibration.noise
    if noise is None or not (noise.shot[-1] or noise.read[-1]) or settings.denoising.strength == 0:
        return luminance
    level = -np.log2(noise_ratio)
    most = max(float(np.median(level)), 1e-3)
    ratio = 0.5**most
    shot, read = np.array(noise.shot) * ratio, np.array(noise.read) * ratio**0.5
    less = NoiseModel(tuple(shot.tolist()), tuple(read.tolist()))
    quieter = replace(samples, calibration=replace(samples.calibration, noise=less.possible()))
    result, alone = denoise_luminance(luminance, quieter, settings.denoising), 1 - level / most
    if alone.max() > _SOME_ALONE:
        single = denoise_luminance(luminance, samples, settings.denoising)
        result += alone.clip(0, 1) * (single - result)
    return result


@parallel_kernel(chunks=lambda frames, *_: chunk_count(frames.planes.shape[1:], (_ROWS, _COLUMNS)))
def merge(chunks: Chunks, frames: Frames, luminance: Floats2, noise_ratio: Floats2) -> None:
    """Merge the frames of a burst.

    Parameters
    ----------
    luminance, noise_ratio : Floats2
        Written, see `merge_luminance`.
    """
    _, height, width = frames.planes.shape
    for chunk in range(chunks[0], chunks[1]):
        own = chunk_at(chunk, (height, width), (_ROWS, _COLUMNS))
        top, bottom = max(own[0] - _MARGIN, 0), min(own[1] + _MARGIN, height)
        left, right = max(own[2] - _MARGIN, 0), min(own[3] + _MARGIN, width)
        area = top, bottom, left, right
        extents = np.empty((len(frames.planes), 4), np.intp)
        fine = _start(frames, area, own, noise_ratio, extents)
        _sharpen(fine, samples_in(frames, area, extents))
        for y in range(2 * own[0], min(2 * own[1], len(luminance))):
            for x in range(2 * own[2], min(2 * own[3], luminance.shape[1])):
                luminance[y, x] = fine[y - 2 * area[0], x - 2 * area[2]]


@kernel
def _start(frames: Frames, area: Area, own: Area, noise_ratio: Floats2, extents: Ints2) -> Floats2:
    """The mean of the interpolated frames on the grid of half pixels of an area; write
    `noise_ratio` in its interior, and `extents`.

    extents: (F, 4), first and end row, first and end column, of each frame's pixels that may lie
    where it agrees in the area.
    """
    rows, columns = area[1] - area[0], area[3] - area[2]
    count, height, width = frames.planes.shape
    mean, totals, spreads = zeros(rows, columns), zeros(rows, columns), zeros(rows, columns)
    for frame in range(count):
        top, bottom, left, right = np.inf, -np.inf, np.inf, -np.inf
        for row in range(rows):
            for column in range(columns):
                y, x = area[0] + row, area[2] + column
                agrees = frames.agreement[frame, y, x]
                if agrees == 0:
                    continue
                to_y, to_x = frame_place(frames.motions, frame, float(y), float(x))
                top, bottom = min(top, to_y), max(bottom, to_y)
                left, right = min(left, to_x), max(right, to_x)
                if not (-0.5 <= to_y < height - 0.5 and -0.5 <= to_x < width - 0.5):
                    continue
                precision = _precision(frames.noise, frame, frames.planes[0, y, x])
                share = (_FILLED + _measured(frames.panchromatic, to_y, to_x)) * agrees / 255.0
                value = interpolated(frames.planes[frame], to_y, to_x)
                mean[row, column] += share * precision * value
                totals[row, column] += share * precision
                spreads[row, column] += share * share * precision
        # A sample lies within half a pixel of a pixel of the reference: within two of its place in
        # the frame, whatever the motion.
        extents[frame, 0], extents[frame, 1] = max(top - 2, 0.0), max(min(bottom + 3, height), 0.0)
        extents[frame, 2], extents[frame, 3] = max(left - 2, 0.0), max(min(right + 3, width), 0.0)
    for row in range(rows):
        for column in range(columns):
            y, x, total = area[0] + row, area[2] + column, totals[row, column]
            mean[row, column] /= total
            if own[0] <= y < own[1] and own[2] <= x < own[3]:
                share = spreads[row, column] / (total * total)
                noise_ratio[y, x] = share if share < _ALONE else ONE
    fine = zeros(2 * rows - 1, 2 * columns - 1)
    for row in range(2 * rows - 1):
        for column in range(2 * columns - 1):
            fine[row, column] = interpolated(mean, 0.5 * row, 0.5 * column)
    return fine


@kernel
def _measured(panchromatic: Bools2, y: float, x: float) -> float:
    """Share of the luminance interpolated at a place of a frame that is measured there, 0 to 1."""
    height, width = panchromatic.shape
    y, x = min(max(y, 0.0), height - 1.0), min(max(x, 0.0), width - 1.0)
    top, left = int(y), int(x)
    bottom, right = min(top + 1, height - 1), min(left + 1, width - 1)
    down, across = y - top, x - left
    upper = (1 - across) * panchromatic[top, left] + across * panchromatic[top, right]
    lower = (1 - across) * panchromatic[bottom, left] + across * panchromatic[bottom, right]
    return (1 - down) * upper + down * lower


@kernel
def _variance(noise: Doubles2, frame: int, signal: Scalar) -> float:
    """Variance of the noise of a frame's panchromatic samples, more than 0."""
    return max(noise[frame, 0] * max(signal, ZERO) + noise[frame, 1], _LEAST)


@kernel
def _precision(noise: Doubles2, frame: int, signal: Scalar) -> float:
    """Precision of a frame's samples relative to the reference's."""
    ratio = _variance(noise, 0, signal) / _variance(noise, frame, signal)
    return min(max(ratio, 1 / _MOST_PRECISION), _MOST_PRECISION)


@kernel
def samples_in(frames: Frames, area: Area, extents: Ints2) -> Floats2:
    """The panchromatic samples that lie in an area: (samples, 5), place on the grid (y, x), value,
    weight, variance.
    """
    count, height, width = frames.planes.shape
    most = number = 0
    for frame in range(count):
        rows = max(extents[frame, 1] - extents[frame, 0], 0)
        most += rows * max(extents[frame, 3] - extents[frame, 2], 0)
    samples = np.empty((most, 5), np.float32)
    for frame in range(count):
        for row in range(extents[frame, 0], extents[frame, 1]):
            for column in range(extents[frame, 2], extents[frame, 3]):
                if not frames.panchromatic[row, column]:
                    continue
                y, x = reference_place(frames.motions, frame, float(row), float(column))
                if not (area[0] <= y <= area[1] - 1 and area[2] <= x <= area[3] - 1):
                    continue
                near = min(int(y + 0.5), height - 1), min(int(x + 0.5), width - 1)
                agrees = frames.agreement[frame, near[0], near[1]]
                if agrees == 0:
                    continue
                value = frames.planes[frame, row, column]
                samples[number, 0] = 2 * (y - area[0])
                samples[number, 1] = 2 * (x - area[2])
                samples[number, 2] = value
                samples[number, 3] = agrees / 255.0 * _precision(frames.noise, frame, value)
                samples[number, 4] = _variance(frames.noise, frame, value)
                number += 1
    return samples[:number]


@kernel
def _sharpen(fine: Floats2, samples: Floats2) -> None:
    """Add what the grid misses of the samples to the places around them, in several rounds."""
    rows, columns = fine.shape
    error, count, power = zeros(rows, columns), zeros(rows, columns), zeros(rows, columns)
    near, wide = zeros(rows, columns), zeros(rows, columns)
    residual_near, power_wide = zeros(rows, columns), zeros(rows, columns)
    for sample in range(len(samples)):
        _splat(count, samples[sample, 0], samples[sample, 1], samples[sample, 3])
    smooth_rows(count, _NARROW, 0, rows, near)
    smooth_rows(count, _WIDE, 0, rows, wide)
    for _ in range(_ITERATIONS):
        error[:] = power[:] = ZERO
        for sample in range(len(samples)):
            y, x, weight = samples[sample, 0], samples[sample, 1], samples[sample, 3]
            residual = samples[sample, 2] - interpolated(fine, y, x)
            _splat(error, y, x, weight * residual)
            _splat(power, y, x, weight * residual * residual / samples[sample, 4])
        smooth_rows(error, _NARROW, 0, rows, residual_near)
        smooth_rows(power, _WIDE, 0, rows, power_wide)
        for row in range(rows):
            for column in range(columns):
                gain = max(ZERO, ONE - wide[row, column] / max(power_wide[row, column], _LEAST))
                samples_near = near[row, column] + _SPARSE
                fine[row, column] += gain * residual_near[row, column] / samples_near


@kernel
def _splat(plane: Floats2, y: Scalar, x: Scalar, value: Scalar) -> None:
    """Add a value to the four places around (y, x)."""
    top, left = int(y), int(x)
    bottom, right = min(top + 1, plane.shape[0] - 1), min(left + 1, plane.shape[1] - 1)
    down, across = y - np.float32(top), x - np.float32(left)
    plane[top, left] += (ONE - down) * (ONE - across) * value
    plane[top, right] += (ONE - down) * across * value
    plane[bottom, left] += down * (ONE - across) * value
    plane[bottom, right] += down * across * value
