"""One frame of a burst before it is merged."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from shared.arrays import BoolArray, DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..cleaned import Cleaned
from ..numerics.gaussian import gaussian, smoothed
from ..settings import RenderSettings
from ..stages.defects import mend_defects
from ..stages.highlights import clipping_level
from ..stages.luminance import recover_luminance
from ..stages.noise import NoiseSettings, estimate_noise
from .merging import displace
from .motion import Motion

# Pixels: Gaussians whose difference shows detail that a soft frame has lost, and tiles that are compared. Chosen: they tell which
# frames are sharp.
_FINE, _COARSE, _TILE = 0.8, 1.6, 32
CLIPPED = 0.98
"""Share of the sensor's limit from which on light counts as clipped. Chosen."""
DEVIATIONS = 3.0
"""Standard deviations of noise that are tolerated: 0.3 % of Gaussian noise exceed them. Half of it costs 0.2 dB."""
NEIGHBOURHOOD = 1.5
"""Pixels: standard deviation of the Gaussian neighbourhood in which contrast is measured.

Chosen: half of it costs 0.4 dB, twice gains 0.07."""
FILL_ERROR = 0.3
"""Error of filled luminance as a share of that contrast. Chosen: half and twice change moving things by 0.6 dB, in both ways."""
SHARED = 0.3
"""Variance of merged luminance relative to the reference's, from which on the reference counts as alone, up to 1, where it is.

Chosen: half of it costs 0.5 dB, twice gains 0.02."""
TINY = 1e-12
"""Keeps divisions finite."""
# Chosen: only frames that show nothing are refused.
_GONE, _DARK = 0.9, 0.5  # share of clipped pixels; light in units of the noise
_QUIETER = 16.0  # how much less variance than the frames' median a model may state: 16 times the ISO, four stops, explains as much
_ROUNDING = 1 / 12  # variance of rounding, codes squared: that of an even distribution


@dataclass(frozen=True, eq=False)
class View:
    """Luminance as one frame shows it.

    luminance: float32 (H, W), scene units.
    noise: of its samples; None = there is none, or it is unknown.
    limit: scene units from which on it is clipped.
    """

    luminance: FloatArray
    noise: NoiseModel | None = None
    limit: float = np.inf

    def variance(self, light: Any) -> Any:
        """Variance of panchromatic samples that see some light."""
        return self.noise.variance(np.asarray(light)) if self.noise else np.zeros_like(light)

    def detail(self, seen: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Power of fine detail in tiles, and how much of it noise accounts for, (rows, columns) each; 0 where not all is seen."""
        fine = smoothed(self.luminance, _FINE)
        fine -= smoothed(self.luminance, _COARSE)
        whole = tile_means(seen) == 1
        return tile_means(np.square(fine)) * whole, _noise_kept() * tile_means(self.variance(self.luminance)) * whole


@dataclass(frozen=True, eq=False)
class Frame(View):
    """A frame with its defects mended, in its own scene units.

    cleaned: its samples; None = they are not needed any more.
    colours: (block rows, block columns, S), the samples of its whole blocks.
    """

    cleaned: Cleaned | None = field(kw_only=True)
    colours: FloatArray = field(kw_only=True)

    def in_units_of_reference(self, gain: float) -> "Frame":
        """The frame as if it were `gain` times darker, as the reference is."""
        factor, noise = np.float32(gain), self.noise and self.noise.in_units_of(gain)
        return Frame(self.luminance / factor, noise, self.limit / gain, cleaned=None, colours=self.colours / factor)

    @property
    def empty(self) -> str:
        """Why the frame shows nothing; "" if it shows something."""
        if (share := float((self.luminance >= CLIPPED * self.limit).mean())) > _GONE:
            return f"is overexposed: {100 * share:.0f} % of it is clipped"
        level = float(self.luminance.mean(dtype=np.float64))
        if level <= (_DARK * self.noise.sigma(0.0) if self.noise else 0.0):
            return "is black: there is no light beyond noise"
        return ""

    @property
    def usable(self) -> float:
        """Share of its pixels that are neither clipped nor lost in noise, 0 to 1."""
        floor = self.noise.sigma(0.0) if self.noise else 0.0
        return float(((self.luminance < CLIPPED * self.limit) & (self.luminance > floor)).mean())

    @property
    def sharpness(self) -> float:
        """Amplitude of its fine detail beyond noise, relative to its light."""
        power, variance = self.detail(np.ones(self.luminance.shape, bool))
        beyond = float(np.maximum(power - variance, 0).mean())
        return float(beyond**0.5) / max(float(self.luminance.mean(dtype=np.float64)), TINY)


def noise_models(mosaics: Sequence[Mosaic], settings: NoiseSettings) -> list[NoiseModel | None]:
    """The noise of each frame of a burst, scene units of the frame; None = there is none, or it is unknown in all of them.

    A frame without a calibrated model has that of another frame. If none is calibrated, or all state no noise, frames of one
    sensitivity (ISO) share one estimate. No model states so little noise that its frame would take all the weight, nor less than
    rounding to codes makes.
    """
    known = [mosaic.calibration.noise for mosaic in mosaics]
    if settings.estimate and None in known and not any(model and any(model.shot + model.read) for model in known):
        speeds = [mosaic.metadata.iso for mosaic in mosaics]
        alike = {iso: [mosaic for mosaic, its in zip(mosaics, speeds, strict=True) if its == iso] for iso in speeds}
        estimates = {iso: estimate_noise(*group) for iso, group in alike.items()}
        known = [estimates[iso] for iso in speeds]
    other = next((model for model in known if model), None)
    if other is None:
        return known
    models = [model or other for model in known]
    figures = np.array([(model.shot, np.square(model.read)) for model in models])  # (F, 2, planes)
    if not figures.any():  # they state that there is none
        return list(models)
    figures = np.maximum(figures, np.median(figures, axis=0) / _QUIETER)
    rounding = [_ROUNDING * np.square(mosaic.calibration.scale()) for mosaic in mosaics]
    figures[:, 1] = np.maximum(figures[:, 1], rounding)
    return [NoiseModel(tuple(shot), tuple(np.sqrt(read))) for shot, read in figures.tolist()]


def prepared(mosaic: Mosaic, noise: NoiseModel | None, settings: RenderSettings, progress: Progress = SILENT) -> Frame:
    """A frame as it is merged: without shading and defects. noise: see `noise_models`."""
    known = replace(mosaic, calibration=replace(mosaic.calibration, noise=noise and noise.possible()))
    samples = known.in_scene_units()
    bare = replace(samples, calibration=replace(samples.calibration, shading=None))
    frame = mend_defects(Cleaned(bare, limit_of(mosaic), estimated=mosaic.calibration.noise is None), settings.defects)
    light = recover_luminance(frame.mosaic, settings.luminance)
    return Frame(light, frame.noise, frame.clipping, cleaned=frame, colours=frame.sites.of(frame.signal))


def limit_of(mosaic: Mosaic) -> float:
    """The level, scene units, from which on a sample may be saturated; with shading, that of the brightest place of the frame.

    Frames are compared without shading, because a thing must look the same in the middle and in a corner.
    """
    shading = mosaic.calibration.shading
    return clipping_level(mosaic) * (min(float(shading.sketch.min()), 1.0) if shading else 1.0)


def as_arrays(motions: Sequence[Motion], shape: tuple[int, ...]) -> tuple[DoubleArray, DoubleArray, FloatArray]:
    """Motions as the kernels take them."""
    turns, starts = zip(*(motion.affine((shape[0], shape[1])) for motion in motions), strict=True)
    nodes = next((motion.local.shape for motion in motions if motion.local is not None), (1, 1, 2))
    shifts = [motion.local if motion.local is not None else np.zeros(nodes) for motion in motions]
    return np.array(turns), np.array(starts), np.array(shifts, np.float32)


def displaced(plane: FloatArray, motion: Motion) -> FloatArray:
    """A frame's plane (H, W) as the reference would see it; NaN where the frame sees nothing."""
    found = np.empty(plane.shape, np.float32)
    displace(plane, as_arrays([motion], plane.shape), found)
    return found


def tile_means(plane: FloatArray | BoolArray) -> FloatArray:
    """Means of whole tiles of 32 x 32 pixels; of all of a plane that is smaller."""
    size = min(_TILE, *plane.shape)
    rows, columns = (count // size * size for count in plane.shape)
    cut = plane[:rows, :columns].reshape(rows // size, size, columns // size, size)
    return cut.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def _noise_kept() -> np.float32:
    """The share of the variance of white noise that is left in the difference of both Gaussians."""
    fine, coarse = gaussian(_FINE).astype(np.float64), gaussian(_COARSE).astype(np.float64)
    reach = (len(coarse) - len(fine)) // 2
    difference = np.pad(np.outer(fine, fine), reach) - np.outer(coarse, coarse)
    return np.float32(np.square(difference).sum())
