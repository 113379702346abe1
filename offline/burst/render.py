"""A burst on one page: frames -> motions -> merged luminance and displaced colour samples -> RGB.

Every frame lies somewhere else, by the tremor of a hand, so its colour sites do too: together they see colour where one frame has
none. Luminance is merged first. Then the reference is rendered as ever, from the merged luminance, and with the samples of all
frames in the sums of its blocks. At the end the samples of all frames correct the picture, each at its own place.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import BORDER, DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..blocks import block_sites
from ..chromaticity import estimate_chromaticities
from ..defects import mend_defects
from ..denoising import denoise_luminance
from ..highlights import clipping_level, restore_highlights
from ..kernels.merging import displace, merge
from ..kernels.mixing import colour
from ..kernels.spreading import HALO, TILE, spread_samples
from ..luminance import recover_luminance
from ..noise import noise_of
from ..pooling import pool_blocks
from ..render import Measured, finish
from ..settings import BEST, RenderSettings
from ..sites import gathered, settle_luminance, site_samples, unclipped_blocks
from ..tiling import Part, windows
from ..trust import trust_in_blocks, with_trusted_colour
from .agreement import agreement
from .alignment import align
from .motion import Motion
from .samples import ColourSamples

_LEAST_AGREEMENT = 0.2
_LEAST_SHARPNESS = 0.5
_ALONE = 0.97  # relative variance of merged luminance from which on there is one frame only
_SOME_ALONE = 0.1  # of the logarithm of the noise that merging took off, from which on a pixel is denoised as one of one frame
_SMOOTHNESS, _FADING, _EDGE = 0.1, 0.01, 0.03


@dataclass(frozen=True, eq=False)
class Judged:
    """What became of one frame.

    used: whether it is part of the picture.
    reason: why it is not; "" if it is.
    motion: how it lies against the reference; None = unknown.
    gain: how many times as bright it is as the reference.
    error: estimated error of the motion, pixels.
    agreement: share of the frame that agrees with the reference, 0 to 1.
    sharpness: of its finest detail, relative to the reference's.
    """

    used: bool
    reason: str = ""
    motion: Motion | None = None
    gain: float = 1.0
    error: float = 0.0
    agreement: float = 1.0
    sharpness: float = 1.0


@dataclass(frozen=True, eq=False)
class MergedBurst:
    """A burst whose frames have been merged.

    reference: index of the frame that the picture shows.
    frames: what became of each frame, in the order given.
    shares: float32 (H, W), variance of the noise of the merged luminance, relative to the reference's: 1 where it is alone.
    mosaic: the reference. measured, samples: what `render_burst_bands` needs.
    """

    reference: int
    frames: tuple[Judged, ...]
    shares: FloatArray
    mosaic: Mosaic
    measured: Measured
    samples: ColourSamples


@dataclass(frozen=True, eq=False)
class _Frame:
    """One frame before it is merged: defects mended, in its own scene units."""

    luminance: FloatArray
    colours: FloatArray  # (block rows, block columns, S)
    noise: NoiseModel | None
    limit: float
    sharpness: float


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
    reference: index of the frame that the picture shall show; None = the sharpest.
    motions: how each frame lies against the reference, where that is known; otherwise it is measured.
    Raises InputError when there is no frame, or when frames and motions differ in number.
    """
    if not frames or (motions is not None and len(motions) != len(frames)):
        raise InputError(f"{len(frames)} frames and {len(motions or ())} motions, expected one motion for each frame")
    prepared = [_prepared(frame, settings) for frame in frames]
    chosen = reference if reference is not None else int(np.argmax([frame.sharpness for frame in prepared]))
    mosaic = frames[chosen]
    clipping = clipping_level(mosaic)
    samples = mosaic.in_scene_units()
    noise = noise_of(samples, settings.noise)
    samples = mend_defects(samples, clipping, noise, settings.defects)
    trust, unclipped = trust_in_blocks(samples, clipping, noise, settings.sites), unclipped_blocks(samples, clipping)
    samples = restore_highlights(samples, clipping, settings.highlights)
    base = replace(prepared[chosen], luminance=recover_luminance(samples, settings.luminance))
    progress.stage("aligning", len(frames))
    judged, planes, trusts, kept = [], [base.luminance], [np.full(mosaic.shape, 255, np.uint8)], [(base, Motion(), 1.0)]
    for index, frame in enumerate(prepared):
        if index == chosen:
            judged.append(Judged(True, motion=Motion()))
            continue
        found, trusted = _judged(base, frame, None if motions is None else motions[index])
        judged.append(found)
        if found.used and found.motion is not None:
            planes.append(frame.luminance / np.float32(found.gain))
            trusts.append(trusted)
            kept.append((frame, found.motion, found.gain))
        progress.advance()
    del prepared
    grid, pattern = mosaic.pattern.grid(mosaic.shape), mosaic.pattern
    merged, shares = np.empty(mosaic.shape, np.float32), np.empty(mosaic.shape, np.float32)
    light, weight = np.zeros((2, len(kept), *base.colours.shape), np.float32)
    progress.stage("merging", 1)
    places = np.array([(grid.whole_rows[0] + row, grid.whole_columns[0] + column) for row, column, _ in pattern.sites], np.intp)
    figures = np.array([_figures(frame.noise, gain) for frame, _, gain in kept])
    all_motions = _motions([motion for _, motion, _ in kept], mosaic.shape)
    merge(np.stack(planes), np.stack(trusts), figures, pattern.panchromatic_mask(mosaic.shape), all_motions, places, pattern.period, merged, shares, light, weight)
    del planes, trusts
    luminance = _denoised(merged, shares, samples, noise, settings)
    colours = _colour_samples(kept, light, weight, mosaic, noise).relit(luminance - merged)
    extra = colours.block_sums(grid, len(pattern.channels)) if len(kept) > 1 else None
    blocks = estimate_chromaticities(samples, luminance, settings.chromaticity, extra=extra)
    blocks = pool_blocks(blocks, samples, luminance, noise, settings.pooling, extra=extra)
    blocks = with_trusted_colour(blocks, trust, mosaic)
    sites = site_samples(samples, unclipped, luminance, noise)
    alone = gathered(shares, block_sites(pattern, grid)).min(axis=2) > _ALONE
    sites = replace(sites, doubt=sites.doubt * alone)  # luminance of the others is measured under the sites too
    luminance = settle_luminance(luminance, blocks, sites, mosaic.calibration.gamma, settings.sites)
    return MergedBurst(chosen, tuple(judged), shares, mosaic, Measured(luminance, blocks, sites), colours)


def render_burst_bands(
    merged: MergedBurst, settings: RenderSettings = BEST, progress: Progress = SILENT
) -> Iterator[FloatArray]:
    """Yield the picture from top to bottom, as bands float32 (rows, W, C), scene units, as `render_bands` does."""
    gamma = np.array(merged.mosaic.calibration.gamma, np.float32)
    samples, precision = merged.samples.by_tile(merged.mosaic.shape, gamma)
    prior = _SMOOTHNESS, _FADING * precision, _EDGE
    height, basis = merged.mosaic.shape[0], _basis(len(gamma))
    parts = finish(merged.mosaic, merged.measured, settings, progress)
    for part, rows in windows(parts, height, HALO, TILE, 0):
        shown: Part = part.rows(*rows)
        corrected = np.empty_like(shown.chromaticity)
        spread_samples(
            part.luminance, part.chromaticity, part.first, rows, height, samples, gamma, basis, prior, corrected
        )
        band = np.empty_like(corrected)
        colour(corrected, np.ascontiguousarray(shown.luminance), band)  # Eq. 17
        yield band


def _prepared(mosaic: Mosaic, settings: RenderSettings) -> _Frame:
    clipping, samples = clipping_level(mosaic), mosaic.in_scene_units()
    noise = noise_of(samples, settings.noise)
    samples = mend_defects(samples, clipping, noise, settings.defects)
    luminance = recover_luminance(samples, settings.luminance)
    colours = gathered(samples.signal, block_sites(mosaic.pattern, mosaic.pattern.grid(mosaic.shape)))
    return _Frame(luminance, colours, noise, clipping, _sharpness(luminance, noise))


def _sharpness(luminance: FloatArray, noise: NoiseModel | None) -> float:
    """Power of the finest detail beyond noise, relative to the light squared."""
    finest = luminance[1:-1, 1:-1] - (luminance[:-2, 1:-1] + luminance[2:, 1:-1] + luminance[1:-1, :-2] + luminance[1:-1, 2:]) / 4
    level = float(luminance.mean(dtype=np.float64))
    variance = 1.25 * noise.sigma(level) ** 2 if noise else 0.0
    return max(float(np.square(finest).mean(dtype=np.float64)) - variance, 0.0) / max(level, 1e-9) ** 2


def _judged(base: _Frame, frame: _Frame, known: Motion | None) -> tuple[Judged, FloatArray]:
    """What to make of a frame, and how far it agrees with the reference at each pixel."""
    shape = base.luminance.shape
    nothing = np.zeros(0, np.uint8)
    if known is None:
        try:
            found = align(base.luminance, frame.luminance, (base.noise, frame.noise), (base.limit, frame.limit))
        except InputError as error:
            return Judged(False, str(error)), nothing
        motion, gain, error_ = found.motion, found.gain, found.error
    else:
        motion, gain, error_ = known, 1.0, 0.0
    shown = np.empty(shape, np.float32)
    displace(frame.luminance, _motions([motion], shape), 1 / gain, shown)
    trust = agreement(base.luminance, shown, (base.noise, _scaled(frame.noise, gain)), frame.limit / gain)
    share = float(trust.mean()) / 255
    sharpness = (frame.sharpness / base.sharpness) ** 0.5 if base.sharpness > 0 else 1.0
    judged = Judged(True, "", motion, gain, error_, share, sharpness)
    if share < _LEAST_AGREEMENT:
        return replace(judged, used=False, reason=f"only {100 * share:.0f} % of it agrees with the reference"), nothing
    if sharpness < _LEAST_SHARPNESS:
        return replace(judged, used=False, reason=f"is out of focus or shaken: {100 * sharpness:.0f} % of the detail"), nothing
    return judged, trust


def _scaled(noise: NoiseModel | None, gain: float) -> NoiseModel | None:
    """The noise of a frame in units of a reference that is `gain` times darker."""
    return noise and NoiseModel(tuple(each / gain for each in noise.shot), tuple(each / gain for each in noise.read))


def _figures(noise: NoiseModel | None, gain: float) -> tuple[float, float]:
    scaled = _scaled(noise, gain)
    return (scaled.shot[-1], scaled.read[-1] ** 2) if scaled else (0.0, 0.0)


def _motions(motions: Sequence[Motion], shape: tuple[int, ...]) -> tuple[DoubleArray, DoubleArray, FloatArray]:
    """Motions as the kernels take them."""
    turns, starts = zip(*(motion.affine((shape[0], shape[1])) for motion in motions), strict=True)
    nodes = next((motion.local.shape for motion in motions if motion.local is not None), (1, 1, 2))
    shifts = [motion.local if motion.local is not None else np.zeros(nodes) for motion in motions]
    return np.array(turns), np.array(starts), np.array(shifts, np.float32)


def _denoised(
    merged: FloatArray, shares: FloatArray, samples: Mosaic, noise: NoiseModel | None, settings: RenderSettings
) -> FloatArray:
    """Luminance denoised by what noise is left: by what most pixels have left, and by all of it where one frame is alone."""
    if noise is None or not (noise.shot[-1] or noise.read[-1]) or settings.denoising.strength == 0:
        return merged
    level = -np.log2(shares)
    most = max(float(np.median(level)), 1e-3)
    part = 0.5**most
    less = NoiseModel(tuple(each * part for each in noise.shot), tuple(each * part**0.5 for each in noise.read))
    result, alone = denoise_luminance(merged, samples, less, settings.denoising), 1 - level / most
    if alone.max() > _SOME_ALONE:
        weight = alone.clip(0, 1)
        result += weight * (denoise_luminance(merged, samples, noise, settings.denoising) - result)
    return result


def _colour_samples(
    kept: Sequence[tuple[_Frame, Motion, float]], light: FloatArray, weight: FloatArray, mosaic: Mosaic, noise: NoiseModel | None
) -> ColourSamples:
    """The colour samples of all frames that lie in the reference."""
    grid, pattern = mosaic.pattern.grid(mosaic.shape), mosaic.pattern
    sites = np.array(pattern.sites)
    rows = grid.whole_rows[:, None, None] + sites[:, 0] + np.zeros((1, len(grid.whole_columns), 1))
    columns = grid.whole_columns[None, :, None] + sites[:, 1] + np.zeros((len(grid.whole_rows), 1, 1))
    found: list[tuple[FloatArray, ...]] = []
    for number, (frame, motion, gain) in enumerate(kept):
        used = weight[number] > 0
        y, x = motion.back(rows[used], columns[used], mosaic.shape)
        channels = np.broadcast_to(sites[:, 2].astype(np.uint8), used.shape)[used]
        values = frame.colours[used] / np.float32(gain)
        variance = np.zeros_like(values)
        if scaled := _scaled(frame.noise, gain):
            shot, read = (np.array(part, np.float32)[channels] for part in (scaled.shot, scaled.read))
            variance = shot * values.clip(0) + read**2
        found.append((np.stack([y, x], axis=1), channels, values, light[number][used], variance, weight[number][used]))
    places, *rest = (np.concatenate(each) for each in zip(*found, strict=True))
    return ColourSamples(places, *rest, own=len(found[0][0]))


def _basis(channels: int) -> FloatArray:
    """Orthonormal columns that add up to zero, (C, C - 1)."""
    square = np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0]
    return np.ascontiguousarray(square[:, 1:], np.float32)
