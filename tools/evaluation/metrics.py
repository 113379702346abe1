"""Error of a rendering: PSNR over small patches, as in the paper's section 4, in RGB, luminance and
chrominance.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...shared.arrays import DoubleArray, FloatArray
from ...shared.errors import InputError

PSNR_PATCH = 10  # pixels
BORDER = 15  # pixels left out at each side: the paper's margin against effects of the frame's edge
QUANTILES = (0.10, 0.25, 0.50, 0.75)
# dB: PSNR of equal pixels. JSON has no infinity, and float32 rounding alone gives about 150
CAP = 200.0

Quantiles = tuple[float, float, float, float]


class PatchPsnr(NamedTuple):
    """PSNR of every overlapping patch, dB, float64 (rows, columns) each, at the place of the
    patch's first pixel.
    """

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


def patch_psnr(
    rendered: FloatArray, truth: FloatArray, patch: int = PSNR_PATCH, border: int = BORDER
) -> PatchPsnr:
    """PSNR, 10 log10(1 / MSE), at most CAP, of all patch x patch squares at least `border` pixels
    inside the frame.

    Luminance is the mean of the channels, chrominance is what remains of each, MSE is the mean over
    all pixels and channels of a square.

    rendered, truth: (H, W, N), linear, scene units, neither scaled nor clipped; 1.0 is the peak.
    patch, border: pixels. Raises InputError when the shapes differ, a value is not finite, or no
    patch fits.
    """
    # Windows are summed one by one: differences of running sums would leave 1e-12 in a patch
    # without error.
    planes = []
    for square in _squares(rendered, truth, border, patch):
        columns = sliding_window_view(square, patch, axis=0).sum(axis=-1)
        total = sliding_window_view(columns, patch, axis=1).sum(axis=-1)
        planes.append(_decibels(total / patch**2))
    return PatchPsnr(*planes)


def psnr(rendered: FloatArray, truth: FloatArray, border: int = 0) -> float:
    """RGB PSNR of the whole picture; see `whole_psnr`."""
    return whole_psnr(rendered, truth, border)[0]


def whole_psnr(
    rendered: FloatArray, truth: FloatArray, border: int = 0
) -> tuple[float, float, float]:
    """PSNR of the whole picture without `border` pixels at each side, dB, at most CAP: RGB,
    luminance, chrominance.

    Arguments and errors as in `patch_psnr`.
    """
    squares = _squares(rendered, truth, border, 1)
    rgb, luminance, chrominance = (float(_decibels(square.mean())) for square in squares)
    return rgb, luminance, chrominance


def _squares(
    rendered: FloatArray, truth: FloatArray, border: int, size: int
) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """Squared errors inside the border in RGB, luminance and chrominance, (h, w) each.

    size: of the squares of which at least one has to fit.
    Raises InputError as `patch_psnr` does.
    """
    if rendered.shape != truth.shape or rendered.ndim != 3:
        shapes = f"rendered has shape {rendered.shape}, the truth {truth.shape}"
        raise InputError(f"{shapes}; expected two pictures (rows, columns, channels) alike")
    (rows, columns), least = truth.shape[:2], size + 2 * border
    if min(rows, columns) < least:
        missing = f"no square of {size} x {size} inside a border of {border}"
        remedy = f"at least {least} pixels each way are needed"
        raise InputError(f"a picture of {columns} x {rows} pixels has {missing}; {remedy}")
    error: DoubleArray = rendered.astype(np.float64) - truth
    if not np.isfinite(error).all():
        raise InputError("a value is not finite (NaN or infinite): there is no PSNR")
    error = error[border : rows - border, border : columns - border]
    luminance: DoubleArray = error.mean(axis=2)
    chrominance = error - luminance[..., None]
    return (error**2).mean(axis=2), luminance**2, (chrominance**2).mean(axis=2)


def _decibels(mean_square: DoubleArray | np.float64) -> DoubleArray:
    return -10 * np.log10(np.maximum(mean_square, 10 ** (-CAP / 10)))
