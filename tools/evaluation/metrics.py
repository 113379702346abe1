"""Error of a rendering: PSNR over small patches, as in the paper's section 4, in RGB, luminance and
chrominance; wrong hues and faded colours, which medians over patches hide; and what is kept of it
(quantiles, histograms to pool scenes, figures of the whole image, a map of errors).
"""

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...shared.arrays import BoolArray, DoubleArray, FloatArray, strips
from ...shared.colorimetry import SRGB_TO_XYZ
from ...shared.errors import InputError
from ...shared.white_balance import shades_of_grey
from ..io.colour import delta_e_2000, xyz_to_lab
from ..io.scene import RGB

PSNR_PATCH = 10  # pixels
BORDER = 15  # pixels left out at each side: the paper's margin against effects of the frame's edge
QUANTILES = (0.10, 0.25, 0.50, 0.75)
MEDIAN = QUANTILES.index(0.50)
# dB: PSNR of equal pixels. JSON has no infinity, and float32 rounding alone gives about 150
CAP = 200.0

PLANES = ("rgb", "luminance", "chrominance")
TITLES = ("RGB", "luminance", "chrominance")


def quality(rendered: FloatArray, truth: FloatArray) -> DoubleArray:
    """The QUANTILES of the patches' PSNR, dB, a row for each of PLANES: see `patch_psnr`, with the
    same errors.
    """
    return _quantiles(patch_psnr(rendered, truth))


def _quantiles(patches: Iterable[DoubleArray]) -> DoubleArray:
    return np.array([np.quantile(plane, QUANTILES) for plane in patches])


def patch_psnr(
    rendered: FloatArray, truth: FloatArray, patch: int = PSNR_PATCH, border: int = BORDER
) -> list[DoubleArray]:
    """PSNR, 10 log10(1 / MSE), at most CAP, of all patch x patch squares at least `border` pixels
    inside the frame: for each of PLANES float64 (rows, columns), at the place of the square's first
    pixel.

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
    return planes


def psnr(rendered: FloatArray, truth: FloatArray, border: int = 0) -> float:
    """RGB PSNR of the whole picture; see `whole_psnr`."""
    return float(whole_psnr(rendered, truth, border)[0])


def whole_psnr(rendered: FloatArray, truth: FloatArray, border: int = 0) -> DoubleArray:
    """PSNR of the whole picture without `border` pixels at each side, dB, at most CAP, one for each
    of PLANES.

    Arguments and errors as in `patch_psnr`.
    """
    return np.array([_decibels(one.mean()) for one in _squares(rendered, truth, border, 1)])


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


WRONG = 10.0  # CIEDE2000: seen at a glance, side by side or not
# Luminance, 1 = white, that this quantile of the truth is shown with.
_BRIGHT, _BRIGHT_SHARE = 0.9, 0.99
_DARKEST = 1e-6  # scene units: a channel without light needs no balance
PLACES = (0.1, 0.25, 0.5, 0.75, 1.0)
"""The quantile of the truth's luminance at which each bin ends."""
_BLUR = 8.0  # pixels: no fine detail is left, and hardly any noise
# Scene units: three standard errors of such a mean at a sigma of 0.03.
_LEAST_COLOUR = 3 * 0.03 / (2 * np.pi**0.5 * _BLUR)
_LEAST_PIXELS = 0.05  # of a bin: fewer with colour say nothing about it
_SQUARE = 48  # pixels: side of the squares whose errors count as independent
SUMS = 7, len(PLACES)
"""Shape of what `colour_kept` returns."""


def wrong_hue(rendered: FloatArray, truth: FloatArray) -> BoolArray:
    """Pixels whose colour is more than WRONG from the truth, in CIEDE2000, as a screen would show
    both; bool (H, W).

    Both are shown alike: the truth's mean is balanced to grey, 99 % of its luminance lies below 0.9
    of white, the channels count as primaries of sRGB, and what is beyond black or white is clipped.

    rendered, truth: (H, W, 3), linear, scene units.
    """
    gain, wrong = _balance(truth), np.empty(truth.shape[:2], bool)
    for rows in strips(len(truth)):  # the formula needs two hundred bytes a pixel
        wrong[rows] = delta_e_2000(_lab(gain * rendered[rows]), _lab(gain * truth[rows])) > WRONG
    return wrong


def colour_kept(rendered: FloatArray, truth: FloatArray) -> DoubleArray:
    """Sums over the pixels of each bin, float64 (7, 5): rendered colour times true colour, r, and
    true colour squared, t; r^2, r t and t^2 of the sums over squares of 48 pixels; the number of
    pixels with colour, and of all.

    Those of several pictures add up; `colour_slopes` has the result. Colour is what remains of the
    channels without their mean, in pictures that are white balanced (shades of grey of the truth)
    and blurred by a Gaussian. Pixels with hardly any colour, and `BORDER` pixels at each side, are
    left out.

    rendered, truth: (H, W, 3), linear, scene units.
    """
    from scipy.ndimage import gaussian_filter

    white = np.maximum(shades_of_grey(truth) or truth.mean(axis=(0, 1), dtype=np.float64), _DARKEST)
    balanced = [picture * (white.mean() / white) for picture in (rendered, truth)]
    inner = (slice(BORDER, -BORDER),) * 2
    blurred = [gaussian_filter(picture, _BLUR, axes=(0, 1))[inner] for picture in balanced]
    luminance = blurred[1].mean(axis=2)
    colours = [picture - picture.mean(axis=2, keepdims=True) for picture in blurred]
    coloured = np.square(colours[1]).mean(axis=2) > _LEAST_COLOUR**2
    place = np.searchsorted(np.quantile(luminance, PLACES[:-1]), luminance)
    down, across = (np.arange(size) // _SQUARE for size in place.shape)
    square = down[:, None] * (across[-1] + 1) + across
    products = [(colour * colours[1]).sum(axis=2) * coloured for colour in colours]
    bins, length = (square * len(PLACES) + place).ravel(), (square[-1, -1] + 1) * len(PLACES)
    planes = (*products, coloured, np.ones(place.shape))
    sums = [np.bincount(bins, plane.ravel(), length) for plane in planes]
    r, t, count, whole = np.reshape(sums, (len(sums), -1, len(PLACES)))
    return np.stack([plane.sum(axis=0) for plane in (r, t, r * r, r * t, t * t, count, whole)])


def colour_slopes(sums: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Slope of the rendered colour on the true one in each bin, and its standard error, float64
    (5,); NaN where less than 5 % of the pixels have colour, or where nothing is known of an error.

    1 is right, 0 is grey. The error is that of a ratio of sums over independent squares.

    sums: what `colour_kept` returns, also of several pictures.
    """
    *products, coloured, pixels = sums
    known = coloured >= np.maximum(_LEAST_PIXELS * pixels, 1)
    rendered, true, square, product, energy = np.where(known, products, np.nan)
    slope, number = rendered / true, true**2 / energy  # of squares, as if all had as much colour
    variance = np.maximum(square - 2 * slope * product + slope**2 * energy, 0) / true**2
    return slope, np.sqrt(variance * number / np.where(number > 1.5, number - 1, np.nan))


def _balance(truth: FloatArray) -> DoubleArray:
    """Gains of the channels, (3,), with which `wrong_hue` shows pictures."""
    mean = np.maximum(truth.mean(axis=(0, 1), dtype=np.float64), _DARKEST)
    gain = mean.mean() / mean  # white balance
    luminance = truth @ (gain * SRGB_TO_XYZ[1])
    return gain * _BRIGHT / max(float(np.quantile(luminance, _BRIGHT_SHARE)), _DARKEST)


def _lab(balanced: DoubleArray) -> DoubleArray:
    """CIELAB of balanced linear sRGB, (..., 3); what is beyond black or white is clipped."""
    return xyz_to_lab(np.clip(balanced, 0.0, 1.0) @ np.array(SRGB_TO_XYZ).T)


WINDOW, STRIDE = 96, 24  # pixels: the squares among which the gallery chooses
_STEP = 0.002  # dB, width of a bin: the error of pooled quantiles
_LOWEST = -100.0
_BINS = round((CAP - _LOWEST) / _STEP) + 1


def histogram(decibels: DoubleArray) -> NDArray[np.int64]:
    """Number of patches by PSNR in dB, int64 (2, n): the bins that have any, ascending, and their
    counts.
    """
    places = np.floor((decibels - _LOWEST) / _STEP).clip(0, _BINS - 1).astype(np.int64)
    return np.stack(np.unique(places, return_counts=True))


def pooled_quantiles(histograms: Sequence[NDArray[np.int64]]) -> DoubleArray:
    """The four QUANTILES of all patches of these histograms together, dB, to within a bin."""
    bins, counts = np.concatenate(histograms, axis=1)
    total = np.bincount(bins, counts)
    bins = np.flatnonzero(total)
    middles = np.minimum(_LOWEST + (bins + 0.5) * _STEP, CAP)
    return np.quantile(middles, QUANTILES, weights=total[bins], method="inverted_cdf")


@dataclass(frozen=True, eq=False)
class Measures:
    """Figures of one rendering, each an array.

    Attributes
    ----------
    quality : DoubleArray
        Exact QUANTILES of its patches, dB, a row for each of PLANES.
    psnr : DoubleArray
        Of the whole picture without its border, dB, one for each of PLANES.
    wrong_hue : DoubleArray
        Share of its pixels that show a wrong hue (see `wrong_hue`), 0 to 1; NaN where red, green
        and blue are not measured.
    kept : DoubleArray
        What `colour_kept` returns; 0 where red, green and blue are not measured.
    rgb, luminance, chrominance : NDArray[np.int64]
        What `histogram` returns of the patches.
    errors : FloatArray
        float32, mean squared error over all channels of WINDOW x WINDOW squares; they begin at
        `window_origins`.
    """

    quality: DoubleArray
    psnr: DoubleArray
    wrong_hue: DoubleArray
    kept: DoubleArray
    rgb: NDArray[np.int64]
    luminance: NDArray[np.int64]
    chrominance: NDArray[np.int64]
    errors: FloatArray

    @classmethod
    def of(cls, rendered: FloatArray, truth: FloatArray, channels: str = RGB) -> "Measures":
        """Measure a rendering against the truth, both (H, W, N), scene units.

        channels: the N letters of the channels. Raises InputError as `patch_psnr` does.
        """
        patches, kept, hue = patch_psnr(rendered, truth), np.zeros(SUMS), np.nan
        if set(RGB) <= set(channels):
            places = [channels.index(letter) for letter in RGB]
            colours = rendered[..., places], truth[..., places]
            kept = colour_kept(*colours)
            hue = wrong_hue(*colours)[BORDER:-BORDER, BORDER:-BORDER].mean()
        errors = np.square(rendered.astype(np.float64) - truth).mean(axis=2)
        figures = _quantiles(patches), whole_psnr(rendered, truth, BORDER), np.array(hue), kept
        rgb, luminance, chrominance = map(histogram, patches)
        return cls(*figures, rgb, luminance, chrominance, _window_means(errors))

    def encode(self) -> bytes:
        """File content for the cache, which `decode` reads."""
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **vars(self))
        return buffer.getvalue()

    @classmethod
    def decode(cls, data: bytes) -> "Measures":
        """Inverse of `encode`. Raises nearly everything for a damaged archive."""
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            return cls(**stored)


def window_origins(size: int) -> list[int]:
    """First rows (or columns) of the squares of `Measures.errors` in a frame with `size` of them,
    every STRIDE pixels.

    If no square fits there is one origin, of a smaller square.
    """
    last = size - BORDER - WINDOW
    return [*range(BORDER, last, STRIDE), last] if last > BORDER else [BORDER]


def _window_means(plane: DoubleArray) -> FloatArray:
    """Means of a plane (H, W) over the squares."""
    plane = plane[BORDER:-BORDER, BORDER:-BORDER]
    for axis in (0, 1):
        origins = window_origins(plane.shape[axis] + 2 * BORDER)
        lines = np.moveaxis(plane, axis, 0)
        means = [lines[start - BORDER :][:WINDOW].mean(axis=0) for start in origins]
        plane = np.stack(means, axis=axis)
    return plane.astype(np.float32)
