"""One frame of a burst before it is merged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import BoolArray, FloatArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..cleaned import Cleaned
from ..gaussian import gaussian
from ..kernels.smoothing import smooth
from ..render import registered
from ..settings import NoiseSettings, RenderSettings
from ..whole.defects import mend_defects
from ..whole.highlights import clipping_level
from ..whole.luminance import recover_luminance
from ..whole.noise import estimate_noise

_FINE, _COARSE = 0.8, 1.6  # pixels: Gaussians whose difference shows detail that a soft frame has lost
_KEPT = 0.0568  # of the variance of white noise, after that difference
_TILE = 32  # pixels
_CLIPPED = 0.98  # of the limit
_GONE, _DARK = 0.9, 0.5  # share of clipped pixels; light in units of the noise
_QUIETER = 16.0  # how much less variance than the frames' median a model may state: 16 times the ISO, four stops, explains as much
_ROUNDING = 1 / 12  # variance of rounding, codes squared
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame with its defects mended, in its own scene units.

    luminance: (H, W).
    colours: (block rows, block columns, S), the samples of its whole blocks.
    noise: None = there is none, or it is unknown.
    limit: from which on a sample is clipped.
    """

    luminance: FloatArray
    colours: FloatArray
    noise: NoiseModel | None
    limit: float

    @property
    def empty(self) -> str:
        """Why nothing is seen in it; "" if something is."""
        if (share := float((self.luminance >= _CLIPPED * self.limit).mean())) > _GONE:
            return f"is overexposed: {100 * share:.0f} % of it is clipped"
        level = float(self.luminance.mean(dtype=np.float64))
        if level <= (_DARK * self.noise.sigma(0.0) if self.noise else 0.0):
            return "is black: there is no light beyond noise"
        return ""

    @property
    def usable(self) -> float:
        """Share of its pixels that are neither clipped nor lost in noise, 0 to 1."""
        floor = self.noise.sigma(0.0) if self.noise else 0.0
        return float(((self.luminance < _CLIPPED * self.limit) & (self.luminance > floor)).mean())

    @property
    def sharpness(self) -> float:
        """Amplitude of its fine detail beyond noise, relative to its light."""
        power, variance = detail(self.luminance, self.noise, np.ones(self.luminance.shape, bool))
        beyond = float(np.maximum(power - variance, 0).mean())
        return float(beyond**0.5) / max(float(self.luminance.mean(dtype=np.float64)), _TINY)


def noise_models(mosaics: Sequence[Mosaic], settings: NoiseSettings) -> list[NoiseModel | None]:
    """The noise of each frame of a burst, scene units of the frame; None = there is none, or it is unknown in all of them.

    A frame without a calibrated model has that of another frame. Where none is calibrated, or only as free of noise, frames of one
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


def mended(mosaic: Mosaic, settings: RenderSettings, progress: Progress = SILENT) -> Cleaned:
    """A frame without aberration, shading and defects. Its calibration holds its noise, see `noise_models`."""
    samples = registered(mosaic, settings, progress).in_scene_units()
    bare = replace(samples, calibration=replace(samples.calibration, shading=None))
    return mend_defects(Cleaned(bare, limit_of(mosaic)), settings.defects)


def prepared(mosaic: Mosaic, settings: RenderSettings, progress: Progress = SILENT) -> Frame:
    """A frame as it is merged."""
    frame = mended(mosaic, settings, progress)
    light = recover_luminance(frame.mosaic, settings.luminance)
    return Frame(light, frame.sites.of(frame.signal), frame.noise, frame.clipping)


def limit_of(mosaic: Mosaic) -> float:
    """Scene units from which on a sample may be saturated. With shading that is as the brightest place of the frame has it.

    Frames are compared without shading, because what moves from the middle to a corner shall look alike.
    """
    shading = mosaic.calibration.shading
    return clipping_level(mosaic) * (min(float(shading.sketch.min()), 1.0) if shading else 1.0)


def scaled(noise: NoiseModel | None, gain: float) -> NoiseModel | None:
    """The noise of a frame in units of a reference that is `gain` times darker."""
    return noise and noise.in_units_of(gain)


def variance(light: FloatArray, noise: NoiseModel | None) -> FloatArray | np.float32:
    """Variance of panchromatic samples that see some light."""
    return np.float32(0) if noise is None else noise.variance(light)


def smoothed(plane: FloatArray, sigma: float) -> FloatArray:
    """A plane convolved with a Gaussian of `sigma` pixels, mirrored at the border; float32 (H, W)."""
    found = np.empty(plane.shape, np.float32)
    smooth(np.ascontiguousarray(plane, np.float32), gaussian(sigma), found)
    return found


def detail(light: FloatArray, noise: NoiseModel | None, seen: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Power of the fine detail in tiles, and how much of it noise accounts for, (rows, columns) each; 0 where not all is seen."""
    fine = smoothed(light, _FINE)
    fine -= smoothed(light, _COARSE)
    whole = tiles(seen) == 1
    return tiles(np.square(fine)) * whole, _KEPT * tiles(variance(light, noise) + np.zeros_like(light)) * whole


def tiles(plane: FloatArray | BoolArray) -> FloatArray:
    """Means of whole tiles; of all of a plane that is smaller."""
    size = min(_TILE, *plane.shape)
    rows, columns = (count // size * size for count in plane.shape)
    cut = plane[:rows, :columns].reshape(rows // size, size, columns // size, size)
    means: FloatArray = cut.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)
    return means
