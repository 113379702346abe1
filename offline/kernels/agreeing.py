"""How far two planes differ in units of what is tolerated: the arithmetic between the means that `burst.agreement` takes."""

import numpy as np

from shared.arrays import FloatArray

from .compile import kernel, parallel_kernel, prange
from .lanes import Scalar

NEAR, MOVED = 7, 6
"""How many planes `products` makes for each of two means: the weight first."""
_NONE, _ONE, _HALF, _QUARTER = np.float32(0), np.float32(1), np.float32(0.5), np.float32(0.25)
_TINY = np.float32(1e-12)
_PIXEL = np.float32(0.003)  # of the light, squared: a gradient that says nothing

Model = tuple[float, float, float, float]
"""Shot and squared read noise of the reference, and of the frame."""


@parallel_kernel("f4[:, ::1], f4[:, ::1], f4[:, ::1], f4[:, :, ::1], f4[:, :, ::1]")
def products(reference: FloatArray, frame: FloatArray, weight: FloatArray, near: FloatArray, moved: FloatArray) -> None:
    """What is to be averaged around each pixel.

    reference, frame, weight: (rows, W).
    near: (7, rows, W), written: 1, r, f, r^2, f^2, f - r, (f - r)^2, each times the weight.
    moved: (6, rows, W), written: 1, gy gy, gy gx, gx gx, gy (f - r), gx (f - r), alike; g is the gradient of the mean of both.
    """
    rows, width = reference.shape
    for row in prange(rows):
        above, below = max(row - 1, 0), min(row + 1, rows - 1)
        per_row = _HALF / np.float32(max(below - above, 1))
        for column in range(width):
            before, after = max(column - 1, 0), min(column + 1, width - 1)
            r, f, w = reference[row, column], frame[row, column], weight[row, column]
            apart = f - r
            down = per_row * (reference[below, column] + frame[below, column] - reference[above, column] - frame[above, column])
            across = (_HALF / np.float32(max(after - before, 1))) * (
                reference[row, after] + frame[row, after] - reference[row, before] - frame[row, before]
            )
            near[0, row, column], near[1, row, column], near[2, row, column] = w, w * r, w * f
            near[3, row, column], near[4, row, column] = w * r * r, w * f * f
            near[5, row, column], near[6, row, column] = w * apart, w * apart * apart
            moved[0, row, column], moved[1, row, column], moved[2, row, column] = w, w * down * down, w * down * across
            moved[3, row, column], moved[4, row, column] = w * across * across, w * down * apart
            moved[5, row, column] = w * across * apart


@parallel_kernel(
    "f4[:, ::1], f4[:, ::1], f4[:, ::1], f4[:, :, ::1], (f8, f8, f8, f8), (f8, f8, f8, f8, f8, f8, f8), f4[:, :, ::1], f4[:, ::1]"
)
def compare_near(
    reference: FloatArray,
    frame: FloatArray,
    weight: FloatArray,
    near: FloatArray,
    noise: Model,
    limits: tuple[float, float, float, float, float, float, float],
    wide: FloatArray,
    found: FloatArray,
) -> None:
    """Judge means and texture, and prepare what is averaged over a wide neighbourhood.

    near: the averages of `products`.
    limits: tolerated shares of contrast (of means, of texture) and of light; factors of the noise of a mean, of the noise in the
        power of differences, and of single differences that are noise; and the standard deviations at which differences are capped.
    wide: (3, rows, W), written: 1, capped difference, contrast, each times the weight.
    found: (rows, W), written: squared difference in units of what is tolerated.
    """
    mean_share, texture, light_share = np.float32(limits[0]), np.float32(limits[1]), np.float32(limits[2])
    of_mean, of_power, of_one, most = np.float32(limits[3]), np.float32(limits[4]), np.float32(limits[5]), np.float32(limits[6])
    for row in prange(reference.shape[0]):
        for column in range(reference.shape[1]):
            r, f, w = reference[row, column], frame[row, column], weight[row, column]
            own, other = _variances(r, f, noise)
            both = own + other
            share = _ONE / near[0, row, column]
            light, shown = near[1, row, column] * share, near[2, row, column] * share
            contrast = min(near[3, row, column] * share - light * light - own, near[4, row, column] * share - shown * shown - other)
            contrast = max(contrast, _NONE)
            mean = near[5, row, column] * share
            even = light_share * light * light_share * light
            tolerated = mean_share * contrast + even
            apart = mean * mean / (tolerated + of_mean * both + _TINY)
            rest = max(near[6, row, column] * share - of_power * both, _NONE)
            rough = rest / (texture * contrast + np.float32(4) * even + of_one * both + _TINY)
            found[row, column] = max(apart, rough)
            cap = most * np.sqrt(both + tolerated)
            wide[0, row, column] = w
            wide[1, row, column] = w * min(max(f - r, -cap), cap)
            wide[2, row, column] = w * contrast


@parallel_kernel(
    "f4[:, ::1], f4[:, ::1], f4[:, :, ::1], f4[:, :, ::1], f4[:, :, ::1], (f8, f8, f8, f8), (f8, f8, f8, f8, f8), f4[:, ::1]"
)
def compare_far(
    reference: FloatArray,
    frame: FloatArray,
    near: FloatArray,
    wide: FloatArray,
    moved: FloatArray,
    noise: Model,
    limits: tuple[float, float, float, float, float],
    found: FloatArray,
) -> None:
    """Judge many small differences of one sign, and differences that a shift by a part of a pixel explains.

    near, wide, moved: averages.
    limits: tolerated shares of contrast and of light; the factor of the noise of a wide mean; the squared shift that is tolerated,
        pixels; and the factor of the noise of `moved`.
    found: (rows, W), what `compare_near` found; raised.
    """
    far, light_share, of_wide = np.float32(limits[0]), np.float32(limits[1]), np.float32(limits[2])
    shift, of_moved = np.float32(limits[3]), np.float32(limits[4])
    for row in prange(reference.shape[0]):
        for column in range(reference.shape[1]):
            own, other = _variances(reference[row, column], frame[row, column], noise)
            both = own + other
            light = near[1, row, column] / near[0, row, column]
            even = light_share * light * light_share * light
            share = _ONE / wide[0, row, column]
            mean, contrast = wide[1, row, column] * share, wide[2, row, column] * share
            most = max(found[row, column], mean * mean / (far * contrast + even + of_wide * both + _TINY))
            share = _ONE / moved[0, row, column]
            least = _QUARTER * both + _PIXEL * light * _PIXEL * light + _TINY  # the first is what noise makes of a gradient
            dd = max(moved[1, row, column] * share - _QUARTER * both, _NONE) + least
            aa = max(moved[3, row, column] * share - _QUARTER * both, _NONE) + least
            da, d, a = moved[2, row, column] * share, moved[4, row, column] * share, moved[5, row, column] * share
            explained = aa * d * d - np.float32(2) * da * d * a + dd * a * a
            explained /= max(dd * aa - da * da, np.float32(1e-3) * dd * aa)
            found[row, column] = max(most, explained / (shift * (dd + aa) + even + of_moved * both + _TINY))


@kernel
def _variances(r: Scalar, f: Scalar, noise: Model) -> tuple[Scalar, Scalar]:
    """Variance of the noise of both."""
    own = np.float32(noise[0]) * max(r, _NONE) + np.float32(noise[1])
    return own, np.float32(noise[2]) * max(f, _NONE) + np.float32(noise[3])
