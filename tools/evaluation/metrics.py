"""Error of a rendering: PSNR over small patches, as in the paper's section 4, in RGB, luminance and chrominance."""

from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError

PSNR_PATCH = 10  # pixels
BORDER = 15  # pixels left out at each side: the paper's margin against effects of the frame's edge
QUANTILES = (0.10, 0.25, 0.50, 0.75)
CAP = 200.0  # dB: PSNR of equal pixels. JSON has no infinity, and float32 rounding alone gives about 150


Quantiles = tuple[float, float, float, float]


class PatchPsnr(NamedTuple):
    """PSNR of every overlapping patch, dB, float64 (rows, columns) each, at the place of the patch's first pixel."""

    rgb: DoubleArray
    luminance: DoubleArray
    chrominance: DoubleArray


class Quality(NamedTuple):
    """10 %, 25 %, 50 % and 75 % quantiles of the patches' PSNR, dB, by plane."""

    rgb: Quantiles
    luminance: Quantiles
    chrominance: Quantiles

    @classmethod
    def of(cls, patches: PatchPsnr) -> "Quality":
        """Quantiles of all patches."""
        return cls(*(tuple(np.quantile(plane, QUANTILES).tolist()) for plane in patches))

    @property
    def median(self) -> tuple[float, float, float]:
        """Medians of RGB, luminance and chrominance, the figures that tables quote."""
        return self.rgb[2], self.luminance[2], self.chrominance[2]


def quality(rendered: FloatArray, truth: FloatArray) -> Quality:
    """Quantiles of `patch_psnr`, with the same errors."""
    return Quality.of(patch_psnr(rendered, truth))


def patch_psnr(rendered: FloatArray, truth: FloatArray, patch: int = PSNR_PATCH, border: int = BORDER) -> PatchPsnr:
    """PSNR, 10 log10(1 / MSE), at most CAP, of all patch x patch squares at least `border` pixels inside the frame.

    Luminance is the mean of the channels, chrominance is what remains of each, MSE is the mean over all pixels and channels of
    a square.

    rendered, truth: (H, W, N), linear, scene units, neither scaled nor clipped; 1.0 is the peak.
    patch, border: pixels.
    Raises InputError when the shapes differ, a value is not finite, or no patch fits.
    """
    error = _error(rendered, truth)
    rows, columns = error.shape[0] - 2 * border, error.shape[1] - 2 * border
    if min(rows, columns) < patch:
        raise InputError(
            f"a picture of {error.shape[1]} x {error.shape[0]} pixels has no {patch} x {patch} patch inside a border of {border}; "
            f"at least {patch + 2 * border} pixels each way are needed"
        )
    squares = _squares(error[border : border + rows, border : border + columns])
    return PatchPsnr(*(_decibels(_box_mean(square, patch)) for square in squares))


def psnr(rendered: FloatArray, truth: FloatArray, border: int = 0) -> float:
    """RGB PSNR of the whole picture; see `whole_psnr`."""
    return whole_psnr(rendered, truth, border)[0]


def whole_psnr(rendered: FloatArray, truth: FloatArray, border: int = 0) -> tuple[float, float, float]:
    """PSNR of the whole picture without `border` pixels at each side, dB, at most CAP: RGB, luminance, chrominance.

    Arguments and errors as in `patch_psnr`.
    """
    error = _error(rendered, truth)
    inner = error[border : error.shape[0] - border, border : error.shape[1] - border]
    if inner.size == 0:
        raise InputError(f"a picture of {error.shape[1]} x {error.shape[0]} pixels lies wholly within a border of {border}")
    rgb, luminance, chrominance = (float(_decibels(square.mean())) for square in _squares(inner))
    return rgb, luminance, chrominance


def _squares(error: DoubleArray) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """Squared errors (H, W) in RGB, luminance and chrominance."""
    luminance: DoubleArray = error.mean(axis=2)
    chrominance = error - luminance[..., None]
    return (error**2).mean(axis=2), luminance**2, (chrominance**2).mean(axis=2)


def _error(rendered: FloatArray, truth: FloatArray) -> DoubleArray:
    if rendered.shape != truth.shape or rendered.ndim != 3:
        raise InputError(
            f"rendered has shape {rendered.shape}, the truth {truth.shape}; expected two pictures (rows, columns, channels) alike"
        )
    error: DoubleArray = rendered.astype(np.float64) - truth
    if not np.isfinite(error).all():
        raise InputError("a value is not finite (NaN or infinite): there is no PSNR")
    return error


def _box_mean(values: DoubleArray, size: int) -> DoubleArray:
    """Mean over every size x size square, (H - size + 1, W - size + 1).

    Adds shifted copies: differences of running sums would leave 1e-12 in a patch without error.
    """
    for axis in (0, 1):
        length = values.shape[axis] - size + 1
        total = np.zeros_like(values.take(range(length), axis))
        for shift in range(size):
            total += values[shift : shift + length] if axis == 0 else values[:, shift : shift + length]
        values = total
    return values / size**2


def _decibels(mean_square: DoubleArray | np.float64) -> DoubleArray:
    return -10 * np.log10(np.maximum(mean_square, 10 ** (-CAP / 10)))
