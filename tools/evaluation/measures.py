"""The kept measurements of one rendering: patch quantiles and histograms (to pool scenes),
whole-image figures, a map of errors.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import DoubleArray, FloatArray
from ...shared.errors import InputError
from ..io.scene import RGB
from .metrics import (
    BORDER,
    CAP,
    QUANTILES,
    SUMS,
    Quality,
    Quantiles,
    colour_kept,
    patch_psnr,
    whole_psnr,
    wrong_hue,
)

PLANES = ("rgb", "luminance", "chrominance")
TITLES = ("RGB", "luminance", "chrominance")
WINDOW, STRIDE = 96, 24  # pixels: the squares among which the gallery chooses
_STEP = 0.002  # dB, width of a bin: the error of pooled quantiles
_LOWEST = -100.0
_BINS = round((CAP - _LOWEST) / _STEP) + 1


class Histogram(NamedTuple):
    """Number of patches by PSNR: bin numbers, ascending, and counts, both int64."""

    bins: NDArray[np.int64]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, decibels: DoubleArray) -> "Histogram":
        """Histogram of PSNR in dB, any shape."""
        places = np.floor((decibels - _LOWEST) / _STEP).clip(0, _BINS - 1).astype(np.int64)
        return cls(*np.unique(places, return_counts=True))

    @classmethod
    def pooled(cls, histograms: Sequence["Histogram"]) -> "Histogram":
        """Histogram of all patches of all histograms together."""
        bins, counts = (np.concatenate(arrays) for arrays in zip(*histograms, strict=True))
        total = np.bincount(bins, counts, _BINS).astype(np.int64)
        bins = np.flatnonzero(total)
        return cls(bins, total[bins])

    def quantiles(self) -> Quantiles:
        """The four QUANTILES, dB, to within a bin."""
        middles = np.minimum(_LOWEST + (self.bins + 0.5) * _STEP, CAP)
        weighted: Any = {"weights": self.counts, "method": "inverted_cdf"}
        lowest, low, middle, high = np.quantile(middles, QUANTILES, **weighted).tolist()
        return lowest, low, middle, high


@dataclass(frozen=True, eq=False)
class Measures:
    """Figures of one rendering.

    Attributes
    ----------
    quality : Quality
        Exact quantiles of its patches.
    psnr : tuple[float, float, float]
        Of the whole picture without its border, dB, one for each of PLANES.
    wrong_hue : float | None
        Share of its pixels that show a wrong hue (see `wrong_hue`), 0 to 1; None where red, green
        and blue are not measured.
    kept : DoubleArray
        What `colour_kept` returns; 0 where red, green and blue are not measured.
    patches : tuple[Histogram, ...]
        Histograms of PSNR, one for each of PLANES.
    errors : FloatArray
        float32, mean squared error over all channels of WINDOW x WINDOW squares; they begin at
        `window_origins`.
    """

    quality: Quality
    psnr: tuple[float, float, float]
    wrong_hue: float | None
    kept: DoubleArray
    patches: tuple[Histogram, ...]
    errors: FloatArray

    @classmethod
    def of(cls, rendered: FloatArray, truth: FloatArray, channels: str = RGB) -> "Measures":
        """Measure a rendering against the truth, both (H, W, N), scene units.

        channels: the N letters of the channels. Raises InputError as `patch_psnr` does.
        """
        maps, share = patch_psnr(rendered, truth), None
        kept = np.zeros(SUMS)
        if set(RGB) <= set(channels):
            places = [channels.index(letter) for letter in RGB]
            colours = rendered[..., places], truth[..., places]
            kept = colour_kept(*colours)
            share = float(wrong_hue(*colours)[BORDER:-BORDER, BORDER:-BORDER].mean())
        whole = whole_psnr(rendered, truth, BORDER)
        patches = tuple(map(Histogram.of, maps))
        errors = np.square(rendered.astype(np.float64) - truth).mean(axis=2)
        return cls(Quality.of(maps), whole, share, kept, patches, _window_means(errors))

    def encode(self) -> bytes:
        """File content for the cache, which `decode` reads."""
        buffer = io.BytesIO()
        arrays: dict[str, Any] = {"quality": self.quality, "kept": self.kept, "errors": self.errors}
        for plane, patches in zip(PLANES, self.patches, strict=True):
            arrays |= {f"{plane}_{name}": array for name, array in patches._asdict().items()}
        # None becomes NaN
        np.savez_compressed(buffer, whole=np.array([*self.psnr, self.wrong_hue], float), **arrays)
        return buffer.getvalue()

    @classmethod
    def decode(cls, data: bytes) -> "Measures":
        """Inverse of `encode`.

        Raises InputError for anything else.
        """
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as stored:
                names = Histogram._fields
                histograms = ([stored[f"{plane}_{name}"] for name in names] for plane in PLANES)
                quality: Any = Quality(*map(tuple, stored["quality"].tolist()))
                *psnr, hue = stored["whole"].tolist()
                patches = tuple(map(Histogram._make, histograms))
                wrong = None if np.isnan(hue) else hue
                return cls(quality, tuple(psnr), wrong, stored["kept"], patches, stored["errors"])
        except Exception as error:  # a damaged archive raises nearly everything
            raise InputError(f"is no result of a measurement ({error})") from None


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
