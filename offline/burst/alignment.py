"""Find how a frame of a hand-held series lies against the reference, from their luminance.

Coarse to fine: phase correlation finds the shift of small copies of both planes. On each larger copy, every tile then says how far
its true place is from where the motion so far puts it (Lucas and Kanade 1981), and how certain that is. The shift and rotation in
which most tiles agree correct the motion, so that moving things do not pull it. Where neighbouring tiles agree on something else
(parallax), the motion gets local shifts.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import FloatArray
from shared.errors import InputError
from shared.motion import Motion

from . import fits
from .frames import View
from .tiles import SPREAD, Level, Tiles, levels, measure

# Chosen on drawn scenes: half and twice change the picture by 0.01 dB at most, or as said. `python -m tests.benchmarks.alignment`
# measures on photographs.
_CORRELATED = 128  # pixels: the longer side of the planes that are correlated, or less
_PEAKS, _APART = 3, 3  # how many shifts are tried, and pixels by which they differ
_FARTHEST = 0.2  # fraction of a side: the largest shift that is looked for
_TILE, _COARSE_TILE = 32, 16  # pixels of a level: on the last level of a search, on those before (0.8, 0.0 dB with parallax)
_ROUNDS, _STILL = 8, 1e-2  # corrections on each level, until one is smaller than this, pixels of the level
_LOCAL_LEVELS, _LOCAL_ROUNDS = 2, 2  # the finest levels, and measurements on each, from which local shifts come
_LEAST_AGREEMENT = 0.3  # another scene agrees by less
_MOST_ERROR = 0.5  # pixels


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
    planes = reference.luminance, frame.luminance
    if planes[0].shape != planes[1].shape:
        sizes = ["{1} x {0}".format(*plane.shape) for plane in planes[::-1]]
        raise InputError(f"{sizes[0]} pixels, expected {sizes[1]} like the reference")
    pyramid = levels(_unclipped(reference), _unclipped(frame))
    first = next((number for number, level in enumerate(pyramid) if max(level.frame.shape) <= _CORRELATED), len(pyramid) - 1)
    coarse, fine = pyramid[first:][::-1], pyramid[: max(first, 1)][::-1]
    tried = [_refined(coarse, Motion(shift), _brightness(coarse[-1])) for shift in _shifts(coarse[-1])]
    motion, tiles, _ = max(tried, key=lambda each: _agreement(coarse[-1], each[1], reference, frame))
    motion, tiles, error = _refined(fine, motion, tiles.gain)
    agreement = _agreement(pyramid[0], tiles, reference, frame)
    if not error <= _MOST_ERROR:
        raise InputError(f"cannot be aligned to {_MOST_ERROR} pixels: too little texture, or another scene")
    motion, tiles = _with_local_shifts(pyramid[:_LOCAL_LEVELS], motion, tiles)
    agreement = max(agreement, _agreement(pyramid[0], tiles, reference, frame))
    if agreement < _LEAST_AGREEMENT:
        share = f"{100 * agreement:.0f} % of the picture agrees with the reference, at least {100 * _LEAST_AGREEMENT:.0f} % must"
        raise InputError(f"another scene, or too little texture: {share}")
    return Alignment(motion, tiles.gain, error, agreement)


def _unclipped(view: View) -> FloatArray:
    """Luminance with NaN at its clipped pixels."""
    return np.where(view.luminance < view.limit, view.luminance, np.float32(np.nan)) if view.limit < np.inf else view.luminance


def _shifts(level: Level) -> Iterator[tuple[float, float]]:
    """The most probable shifts by phase correlation (Kuglin and Hines 1975), pixels of the frame."""
    shape = level.frame.shape
    window = np.outer(*(np.hanning(size + 2)[1:-1] for size in shape))
    planes = [np.nan_to_num(plane - np.nanmean(plane)) if np.isfinite(plane).any() else 0 * window for plane in level[2:]]
    spectra = [np.fft.rfft2(plane * window) for plane in planes]
    cross = np.conj(spectra[0]) * spectra[1]
    cross /= np.maximum(np.abs(cross), 1e-3 * np.abs(cross).mean() + np.finfo(np.float64).tiny)
    y, x = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])
    surface = np.fft.irfft2(cross * np.exp(-2 * np.pi**2 * (y**2 + x**2)), shape)  # a Gaussian of one pixel
    rows, columns = (np.rint(np.fft.fftfreq(size) * size) for size in shape)
    surface[np.abs(rows) > _FARTHEST * shape[0]] = -np.inf
    surface[:, np.abs(columns) > _FARTHEST * shape[1]] = -np.inf
    yield 0.0, 0.0  # a large thing that moves may have the highest peaks
    for _ in range(_PEAKS):
        row, column = np.unravel_index(np.argmax(surface), shape)
        yield float(rows[row] * level.scale), float(columns[column] * level.scale)
        surface[np.ix_(np.abs(rows - rows[row]) <= _APART, np.abs(columns - columns[column]) <= _APART)] = -np.inf


def _brightness(level: Level) -> float:
    """About how many times as bright as the reference the frame is."""
    both = np.isfinite(level.reference + level.frame)
    means = [float(plane[both].mean()) if both.any() else 0.0 for plane in level[2:]]
    return means[1] / means[0] if min(means) > 0 else 1.0


def _nodes(level: Level, tile: int) -> tuple[int, int]:
    rows, columns = (max(round(size / (tile * level.scale)) + 1, 2) for size in level.shape)
    return rows, columns


def _refined(pyramid: list[Level], motion: Motion, gain: float) -> tuple[Motion, Tiles, float]:
    """The motion corrected on one level after the other; the last measurement, and the estimated error in pixels."""
    for level in pyramid:
        nodes = _nodes(level, _TILE if level is pyramid[-1] else _COARSE_TILE)
        for _ in range(_ROUNDS):
            tiles = measure(level, nodes, motion, gain)
            step, gain = fits.rigid(tiles, level.affine(motion)[0]), tiles.gain
            down, across = (level.scale * step.shift).tolist()
            motion = replace(motion, shift=(motion.shift[0] + down, motion.shift[1] + across), angle=motion.angle + step.angle)
            if np.hypot(*step.shift) + abs(step.angle) * np.hypot(*level.frame.shape) / 2 < _STILL:
                break
    return motion, tiles, level.scale * step.error


def _with_local_shifts(pyramid: list[Level], motion: Motion, tiles: Tiles) -> tuple[Motion, Tiles]:
    """The motion with local shifts, where there are any, and the last measurement."""
    nodes = _nodes(pyramid[0], _TILE)
    shifts = np.zeros((*nodes, 2))
    for level in pyramid[::-1]:
        for _ in range(_LOCAL_ROUNDS):
            tiles = measure(level, nodes, motion, tiles.gain, shifts)
            shifts = level.scale * fits.local(tiles, shifts / level.scale)
        if not shifts.any():
            break  # the finer levels would not find any either
    if not shifts.any():
        return motion, tiles
    return replace(motion, local=shifts.astype(np.float32)), measure(pyramid[0], nodes, motion, tiles.gain, shifts)


def _agreement(level: Level, tiles: Tiles, reference: View, frame: View) -> float:
    """The share of the reference's texture, beyond noise, that the frame shows too. Where there is little, it counts less."""
    variance = reference.variance(tiles.light), frame.variance(tiles.light * tiles.gain) / tiles.gain**2
    smooth = tiles.pixels / (SPREAD * level.scale**2)
    texture = np.maximum(tiles.texture - smooth * variance[0], 0)
    differs = np.maximum(tiles.rest - smooth * (variance[0] + variance[1]), 0)
    share = np.clip(1 - differs / np.maximum(texture, np.finfo(np.float32).tiny), 0, 1)
    contrast = np.sqrt(texture / np.maximum(tiles.pixels, 1))
    weights = tiles.pixels * contrast / (contrast + max(float(contrast.mean()), np.finfo(np.float32).tiny))
    return float((weights * share).sum() / max(weights.sum(), np.finfo(np.float32).tiny))
