"""A burst on one page: frames -> motions -> merged luminance and displaced colour samples -> RGB.

The tremor of a hand displaces every frame, and its colour sites with it: together they measure colour where one frame has no sites.
Luminance is merged first. Then the reference is rendered like one frame, from the merged luminance, and with the samples of all
frames in the sums of its blocks. At the end the samples of all frames correct the picture, each at its own place.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from shared.arrays import BoolArray, ByteArray, FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..cleaned import Cleaned
from ..measured import Measured
from ..parts import RowStage
from ..render import Others, colour_bands, coloured, row_stages, settled
from ..settings import BEST, RenderSettings
from ..stages.denoising import denoise_luminance
from ..units import check_frames
from .colour import ColourSamples, Spreading, alone_of, relit_sites
from .frames import as_arrays, displaced
from .merging import merge
from .motion import Motion
from .selection import Comparison, Judged, Kept, compared, copies


@dataclass(frozen=True, eq=False)
class MergedBurst:
    """A burst whose frames have been merged.

    reference: index of the frame that the picture shows.
    frames: what became of each frame, in the order given.
    shares: float32 (H, W), variance of the noise of the merged luminance, relative to the reference's: 1 where it is alone.
    measured, samples: what `render_burst_bands` needs.
    """

    reference: int
    frames: tuple[Judged, ...]
    shares: FloatArray
    measured: Measured
    samples: ColourSamples

    @property
    def lost(self) -> ByteArray | None:
        """Where all frames are clipped, uint8 (H, W), see `offline.cleaned.Cleaned`; None = nowhere."""
        return self.measured.lost


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
    Raises InputError when there is no frame, when frames and motions differ in number, when the reference is no frame's index, and
    for samples that are not in scene units.
    """
    if not frames or (motions is not None and len(motions) != len(frames)):
        raise InputError(f"{len(frames)} frames and {len(motions or ())} motions, expected one motion for each frame")
    if reference is None and motions is not None:
        raise InputError("reference is None, expected the index of the frame that the motions start from")
    if reference is not None and reference not in range(len(frames)):
        raise InputError(f"reference is {reference}, expected the index of a frame, 0 to {len(frames) - 1}")
    copied = copies(frames, reference)
    distinct = [number for number in range(len(frames)) if number not in copied]
    shots = [frames[number] for number in distinct]
    check_frames(shots)
    first = None if reference is None else distinct.index(reference)
    found = compared(shots, settings, progress, first, motions and [motions[number] for number in distinct])
    measured, samples, shares = _measured(found, settings, progress)
    judged = dict(zip(distinct, found.frames, strict=True))
    for copy, original in copied.items():
        judged[copy] = Judged(f"is a copy of frames[{original}]: its samples are the same", copy_of=original)
    in_order = tuple(judged[number] for number in range(len(frames)))
    measured = replace(measured, lost=found.lost)
    return MergedBurst(distinct[found.reference], in_order, shares, measured, samples)


def render_burst_bands(merged: MergedBurst, settings: RenderSettings = BEST, progress: Progress = SILENT) -> Iterator[FloatArray]:
    """Yield the picture from top to bottom, as bands float32 (rows, W, C), scene units, as `render_bands` does.

    Raises ConvergenceError when a solver does not reach its tolerance, and RangeError rather than yield a value that is not finite.
    """

    def stages(measured: Measured, settings: RenderSettings, progress: Progress) -> list[RowStage]:
        return [*row_stages(measured, settings, progress), Spreading(merged.samples, measured, progress)]

    return colour_bands(merged.measured, settings, progress, stages)


def _measured(found: Comparison, settings: RenderSettings, progress: Progress) -> tuple[Measured, ColourSamples, FloatArray]:
    """What is known of the whole reference, the colour samples of all frames, and `MergedBurst.shares`."""
    cleaned, sites = found.cleaned, found.cleaned.sites
    progress.stage("merging", 1)
    merged = merged_luminance(found.kept, cleaned)
    progress.advance()
    luminance = denoised(merged, cleaned.mosaic, settings)
    samples = ColourSamples.of(found.kept, merged.light, merged.weight, sites)
    samples = samples.relit(luminance - merged.luminance).where_others(luminance, merged.shares)
    sums = samples.block_sums(sites) if len(found.kept) > 1 else None
    if sums is not None:
        cleaned = relit_sites(cleaned, luminance, sums)
    alone = alone_of(sites.of(merged.shares).min(axis=2))
    if merged.unseen is not None:
        alone = np.maximum(alone, sites.of(merged.unseen).mean(axis=2))
    # Where the reference is not alone, others measure luminance under its sites.
    others = Others(sums, alone.astype(np.float32))
    measured = settled(coloured(cleaned, luminance, settings, SILENT, others), settings)
    return measured, samples.relit(measured.luminance - luminance), merged.shares


_SOME_ALONE = 0.1  # of the logarithm of noise that merging took off, from which a frame is denoised twice; chosen: no scene changes


class MergedLuminance(NamedTuple):
    """What `merge` found.

    luminance: of the reference, float32 (H, W).
    shares: variance of its noise relative to the reference's, float32 (H, W).
    light, weight: (F, block rows, block columns, S), luminance at each colour sample of each frame, and how far that frame agrees
        with the reference there, 0 to 1; 0 beyond the reference.
    unseen: how far no panchromatic sample covers a pixel, 0 to 1, (H, W); None where colour sites form blocks.
    """

    luminance: FloatArray
    shares: FloatArray
    light: FloatArray
    weight: FloatArray
    unseen: FloatArray | None


def merged_luminance(kept: list[Kept], reference: Cleaned) -> MergedLuminance:
    """Merge the frames. kept: the reference first."""
    sites, shape = reference.sites, reference.mosaic.shape
    grid, pattern = sites.grid, sites.pattern
    panchromatic = pattern.panchromatic_mask(shape)
    places = np.array([(grid.whole_rows[0] + row, grid.whole_columns[0] + column) for row, column, _ in pattern.sites], np.intp)
    noise = np.array([_panchromatic(each.frame.noise) for each in kept])
    motions = [each.motion for each in kept]
    planes, agreements = np.stack([each.frame.luminance for each in kept]), np.stack([each.agreement for each in kept])
    unseen = _unseen(agreements, panchromatic, motions) if pattern.is_scattered else None
    merged, shares = np.empty(shape, np.float32), np.empty(shape, np.float32)
    light, weight = np.zeros((2, len(kept), *kept[0].frame.colours.shape), np.float32)
    where = as_arrays(motions, shape)
    merge(planes, agreements, noise, panchromatic, where, places, pattern.period, merged, shares, light, weight)
    return MergedLuminance(merged, shares, light, weight, unseen)


def denoised(merged: MergedLuminance, samples: Mosaic, settings: RenderSettings) -> FloatArray:
    """Luminance, denoised by the noise that merging has left in most pixels, and by all of it where one frame is alone."""
    noise = samples.calibration.noise
    if noise is None or not (noise.shot[-1] or noise.read[-1]) or settings.denoising.strength == 0:
        return merged.luminance
    level = -np.log2(merged.shares)
    most = max(float(np.median(level)), 1e-3)
    part = 0.5**most
    less = NoiseModel(tuple(each * part for each in noise.shot), tuple(each * part**0.5 for each in noise.read))
    quieter = replace(samples, calibration=replace(samples.calibration, noise=less))
    result, alone = denoise_luminance(merged.luminance, quieter, settings.denoising), 1 - level / most
    if alone.max() > _SOME_ALONE:
        weight = alone.clip(0, 1)
        result += weight * (denoise_luminance(merged.luminance, samples, settings.denoising) - result)
    return result


def _unseen(agreements: ByteArray, panchromatic: BoolArray, motions: list[Motion]) -> FloatArray:
    """How far panchromatic samples of all frames, as far as these agree with the reference, do not cover each pixel, 0 to 1."""
    total = np.zeros(panchromatic.shape, np.float32)
    for agrees, motion in zip(agreements, motions, strict=True):
        total += np.nan_to_num(displaced(panchromatic.astype(np.float32), motion)) * agrees / 255
    return 1 - total.clip(0, 1)


def _panchromatic(noise: NoiseModel | None) -> tuple[float, float]:
    """Shot and squared read noise of panchromatic samples."""
    return (noise.shot[-1], noise.read[-1] ** 2) if noise else (0.0, 0.0)
