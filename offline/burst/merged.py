"""Luminance of a burst, merged from the panchromatic samples of all frames, and what it is at their colour sites."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shared.arrays import BoolArray, ByteArray, FloatArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.motion import Motion

from ..cleaned import Cleaned
from ..kernels.merging import merge
from ..settings import RenderSettings
from ..whole.denoising import denoise_luminance
from .judging import Kept, as_arrays, displaced

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
    """Merge the frames. kept: the reference first; luminance and agreement of each are taken out."""
    sites, shape = reference.sites, reference.mosaic.shape
    grid, pattern = sites.grid, sites.pattern
    panchromatic = pattern.panchromatic_mask(shape)
    places = np.array([(grid.whole_rows[0] + row, grid.whole_columns[0] + column) for row, column, _ in pattern.sites], np.intp)
    noise = np.array([_panchromatic(each.frame.noise) for each in kept])
    motions = [each.motion for each in kept]
    planes, agreements = np.empty((len(kept), *shape), np.float32), np.empty((len(kept), *shape), np.uint8)
    for number, each in enumerate(kept):
        planes[number], agreements[number] = each.frame.luminance, each.agreement
        kept[number] = each.without_planes()  # one copy of each plane is enough
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
