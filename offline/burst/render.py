"""A burst on one page: frames -> motions -> merged luminance and displaced colour samples -> RGB.

Every frame lies somewhere else, by the tremor of a hand, so its colour sites do too: together they see colour where one frame has
none. Luminance is merged first. Then the reference is rendered as ever, from the merged luminance, and with the samples of all
frames in the sums of its blocks. At the end the samples of all frames correct the picture, each at its own place.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.mosaic import Mosaic
from shared.motion import Motion
from shared.progress import SILENT, Progress

from ..kernels.merging import displace, merge
from ..kernels.mixing import colour
from ..kernels.spreading import HALO, TILE, TOLERANCE, spread_samples, tiles_of
from ..render import Measured, Others, coloured, finish
from ..settings import BEST, RenderSettings
from ..solvers import report
from ..tiling import Part, windows
from ..units import check_finite, in_scene_units, own_unit
from ..units import scaled as in_unit
from ..whole.denoising import denoise_luminance
from .comparing import Comparison, compared, relit_sites
from .copies import copies
from .frames import Frame, noise_models, scaled
from .judging import Judged, as_arrays
from .samples import ColourSamples

_NOTHING = np.empty((0, 0), np.float32)
_SHARED = 0.4  # relative variance of merged luminance, from which on luminance at the colour sites is in doubt
_SOME_ALONE = 0.1  # of the logarithm of the noise that merging took off, from which on a pixel is denoised as one of one frame
# With less, where noise is as strong as light, single precision cannot solve the system. At sigma 0.1 it is 5 times as much.
_LEAST_FADING = 1e-7
_SMOOTHNESS, _FADING, _EDGE = 0.15, 0.01, 0.03


@dataclass(frozen=True, eq=False)
class MergedBurst:
    """A burst whose frames have been merged.

    reference: index of the frame that the picture shows.
    frames: what became of each frame, in the order given.
    shares: float32 (H, W), variance of the noise of the merged luminance, relative to the reference's: 1 where it is alone.
    mosaic: the reference, in units of 2^exponent scene units. measured, samples: what `render_burst_bands` needs, likewise.
    lost: where no frame tells what the light was, uint8 (H, W), see `Progress.lost`; None = nowhere.
    """

    reference: int
    frames: tuple[Judged, ...]
    shares: FloatArray
    mosaic: Mosaic
    measured: Measured
    samples: ColourSamples
    exponent: int
    lost: ByteArray | None


def merge_burst(
    frames: Sequence[Mosaic],
    settings: RenderSettings = BEST,
    progress: Progress = SILENT,
    *,
    reference: int | None = None,
    motions: Sequence[Motion] | None = None,
) -> MergedBurst:
    """Align and merge the frames of a burst.

    frames: of one camera; those that do not fit the reference are left out (`Judged.reason`).
    reference: index of the frame that the picture shall show, 0 or more; None = the best of those that most others agree with.
    motions: how each frame lies against the reference, which has to be named, where that is known; otherwise it is measured.
    Raises InputError when there is no frame, when frames and motions differ in number, and when the reference is no frame's index.
    """
    if not frames or (motions is not None and len(motions) != len(frames)):
        raise InputError(f"{len(frames)} frames and {len(motions or ())} motions, expected one motion for each frame")
    if reference is None and motions is not None:
        raise InputError("reference is None, expected the index of the frame that the motions start from")
    if reference is not None and reference not in range(len(frames)):
        raise InputError(f"reference is {reference}, expected the index of a frame, 0 to {len(frames) - 1}")
    if copied := copies(frames, reference):
        return _without(copied, frames, settings, progress, reference, motions)
    exponent = own_unit(frames)
    frames = [in_unit(frame, exponent) for frame in frames]
    models = noise_models(frames, settings.noise)
    frames = [_with_noise(frame, model) for frame, model in zip(frames, models, strict=True)]
    found = compared(frames, settings, progress, reference, motions)
    kept, mosaic, cleaned = found.kept, frames[found.reference], found.cleaned
    base, noise = kept[0][0], kept[0][0].noise
    light, weight = np.zeros((2, len(kept), *base.colours.shape), np.float32)
    grid, pattern = mosaic.pattern.grid(mosaic.shape), mosaic.pattern
    merged, shares = np.empty(mosaic.shape, np.float32), np.empty(mosaic.shape, np.float32)
    progress.stage("merging", 1)
    places = np.array([(grid.whole_rows[0] + row, grid.whole_columns[0] + column) for row, column, _ in pattern.sites], np.intp)
    figures = np.array([_figures(frame.noise, gain) for frame, _, gain in kept])
    all_motions, panchromatic = as_arrays([motion for _, motion, _ in kept], mosaic.shape), pattern.panchromatic_mask(mosaic.shape)
    planes, trusts = _stacked(found)
    unseen = 1 - _seen(trusts, panchromatic, all_motions) if pattern.is_scattered else None
    merge(planes, trusts, figures, panchromatic, all_motions, places, pattern.period, merged, shares, light, weight)
    del planes, trusts
    progress.advance()
    luminance = _denoised(merged, shares, cleaned.mosaic, settings)
    colours = _colour_samples(kept, light, weight, mosaic, noise).relit(luminance - merged).where_others(luminance, shares)
    sums = colours.block_sums(grid, len(pattern.channels)) if len(kept) > 1 else None
    if sums is not None:
        cleaned = relit_sites(cleaned, luminance, sums)
    alone = np.maximum(cleaned.sites.of(shares).min(axis=2) - _SHARED, 0) / (1 - _SHARED)
    if unseen is not None:
        alone = np.maximum(alone, cleaned.sites.of(unseen).mean(axis=2))
    # Others measure luminance under the sites too.
    measured = coloured(cleaned, luminance, settings, SILENT, Others(sums, alone.astype(np.float32)))
    colours = colours.relit(measured.luminance - luminance)
    return MergedBurst(found.reference, found.frames, shares, mosaic, measured, colours, exponent, found.lost)


def render_burst_bands(merged: MergedBurst, settings: RenderSettings = BEST, progress: Progress = SILENT) -> Iterator[FloatArray]:
    """Yield the picture from top to bottom, as bands float32 (rows, W, C), scene units, as `render_bands` does.

    Raises ConvergenceError when a solver does not reach its tolerance, and RangeError rather than yield a value that is not finite.
    """
    if merged.lost is not None:
        progress.lost(merged.lost)
    gamma = np.array(merged.mosaic.calibration.gamma, np.float32)
    samples, precision = merged.samples.by_tile(merged.mosaic.shape, gamma)
    prior = _SMOOTHNESS, max(_FADING * precision, _LEAST_FADING), _EDGE
    height, basis = merged.mosaic.shape[0], _basis(len(gamma))
    parts = finish(merged.mosaic, merged.measured, settings, progress)
    for part, rows in windows(parts, height, HALO, TILE, 0):
        shown: Part = part.rows(*rows)
        corrected = np.empty_like(shown.chromaticity)
        tiles = tiles_of(rows, part.luminance.shape[1])
        residuals, used = np.empty(tiles), np.empty(tiles, np.intp)
        picture = part.luminance, part.chromaticity, part.first, rows, height
        spread_samples(*picture, samples, gamma, basis, prior, corrected, residuals, used)
        report(progress, "samples", used, residuals, TOLERANCE)
        band = np.empty_like(corrected)
        colour(corrected, np.ascontiguousarray(shown.luminance), band)  # Eq. 17
        check_finite(band, rows[0])
        yield in_scene_units(band, merged.exponent)


def _without(
    copied: dict[int, int],
    frames: Sequence[Mosaic],
    settings: RenderSettings,
    progress: Progress,
    reference: int | None,
    motions: Sequence[Motion] | None,
) -> MergedBurst:
    """Merge the frames that are no copies, see `copies`."""
    used = [number for number in range(len(frames)) if number not in copied]
    merged = merge_burst(
        [frames[number] for number in used],
        settings,
        progress,
        reference=None if reference is None else used.index(reference),
        motions=motions and [motions[number] for number in used],
    )
    judged = dict(zip(used, merged.frames, strict=True))
    judged |= {
        copy: Judged(False, f"is a copy of frames[{original}]: its samples are the same") for copy, original in copied.items()
    }
    return replace(merged, reference=used[merged.reference], frames=tuple(judged[number] for number in range(len(frames))))


def _with_noise(frame: Mosaic, noise: NoiseModel | None) -> Mosaic:
    """The frame, whose noise is this."""
    return replace(frame, calibration=replace(frame.calibration, noise=noise and noise.possible()))


def _stacked(found: Comparison) -> tuple[FloatArray, ByteArray]:
    """Luminance of the kept frames in units of the reference, and the trust in them, (F, H, W) each; taken out of `found`."""
    planes = np.empty((len(found.kept), *found.trusts[0].shape), np.float32)
    trusts = np.empty(planes.shape, np.uint8)
    for number, (frame, motion, gain) in enumerate(found.kept):
        np.divide(frame.luminance, np.float32(gain), out=planes[number])
        trusts[number] = found.trusts[number]
        found.kept[number] = replace(frame, luminance=_NOTHING), motion, gain  # one copy of each plane is enough
    found.trusts.clear()
    return planes, trusts


def _seen(trusts: ByteArray, panchromatic: BoolArray, motions: tuple[DoubleArray, DoubleArray, FloatArray]) -> FloatArray:
    """How far panchromatic samples of all frames, as far as these are trusted, cover each pixel, 0 to 1, (H, W)."""
    total, there = np.zeros((2, *panchromatic.shape), np.float32)
    for trust, *motion in zip(trusts, *motions, strict=True):
        displace(panchromatic.astype(np.float32), tuple(each[None] for each in motion), 1.0, there)
        total += np.nan_to_num(there) * trust / 255
    covered: FloatArray = total.clip(0, 1)
    return covered


def _figures(noise: NoiseModel | None, gain: float) -> tuple[float, float]:
    known = scaled(noise, gain)
    return (known.shot[-1], known.read[-1] ** 2) if known else (0.0, 0.0)


def _denoised(merged: FloatArray, shares: FloatArray, samples: Mosaic, settings: RenderSettings) -> FloatArray:
    """Luminance denoised by what noise is left: by what most pixels have left, and by all of it where one frame is alone."""
    noise = samples.calibration.noise
    if noise is None or not (noise.shot[-1] or noise.read[-1]) or settings.denoising.strength == 0:
        return merged
    level = -np.log2(shares)
    most = max(float(np.median(level)), 1e-3)
    part = 0.5**most
    less = NoiseModel(tuple(each * part for each in noise.shot), tuple(each * part**0.5 for each in noise.read))
    result, alone = denoise_luminance(merged, _with_noise(samples, less), settings.denoising), 1 - level / most
    if alone.max() > _SOME_ALONE:
        weight = alone.clip(0, 1)
        result += weight * (denoise_luminance(merged, samples, settings.denoising) - result)
    return result


def _colour_samples(
    kept: Sequence[tuple[Frame, Motion, float]], light: FloatArray, weight: FloatArray, mosaic: Mosaic, noise: NoiseModel | None
) -> ColourSamples:
    """The colour samples of all frames that lie in the reference."""
    grid, pattern = mosaic.pattern.grid(mosaic.shape), mosaic.pattern
    sites = np.array(pattern.sites)
    rows = grid.whole_rows[:, None, None] + sites[:, 0] + np.zeros((1, len(grid.whole_columns), 1))
    columns = grid.whole_columns[None, :, None] + sites[:, 1] + np.zeros((len(grid.whole_rows), 1, 1))
    found: list[tuple[Any, ...]] = []
    for number, (frame, motion, gain) in enumerate(kept):
        used = weight[number] > 0
        y, x = motion.back(rows[used], columns[used], mosaic.shape)
        channels = np.broadcast_to(sites[:, 2].astype(np.uint8), used.shape)[used]
        values = frame.colours[used] / np.float32(gain)
        variance = np.zeros_like(values)
        if known := scaled(frame.noise, gain):
            variance = known.variance(values, channels)
        found.append((np.stack([y, x], axis=1), channels, values, light[number][used], variance, weight[number][used]))
    places, channel, values, lights, variances, weights = (np.concatenate(each) for each in zip(*found, strict=True))
    return ColourSamples(places, channel, values, lights, variances, weights, own=len(found[0][0]))


def _basis(channels: int) -> FloatArray:
    """Orthonormal columns that add up to zero, (C, C - 1)."""
    square = np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0]
    return np.ascontiguousarray(square[:, 1:], np.float32)
