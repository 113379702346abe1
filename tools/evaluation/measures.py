"""The kept measurements of one rendering: patch quantiles and histograms (to pool scenes), whole-image figures, a map of errors."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError

from .metrics import BORDER, CAP, QUANTILES, Quality, patch_psnr, psnr
from .ssim import ssim

PLANES = ("rgb", "luminance", "chrominance")
TITLES = ("RGB", "luminance", "chrominance")
WINDOW, STRIDE = 96, 24  # pixels: the squares among which the gallery chooses
_STEP = 0.002  # dB, width of a bin: the error of pooled quantiles
_LOWEST = -100.0
_BINS = round((CAP - _LOWEST) / _STEP) + 1
_PARTS = ("bins", "counts")


@dataclass(frozen=True, eq=False)
class Histogram:
    """Number of patches by PSNR: bin numbers, ascending, and counts, both int64."""

    bins: NDArray[np.int64]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, decibels: DoubleArray) -> "Histogram":
        """Histogram of PSNR in dB, any shape."""
        places = np.floor((decibels.ravel() - _LOWEST) / _STEP).clip(0, _BINS - 1).astype(np.int64)
        bins, counts = np.unique(places, return_counts=True)
        return cls(bins, counts.astype(np.int64))

    @classmethod
    def pooled(cls, parts: Sequence["Histogram"]) -> "Histogram":
        """Histogram of all patches of all parts together."""
        total = np.bincount(
            np.concatenate([part.bins for part in parts]), np.concatenate([part.counts for part in parts]), _BINS
        ).astype(np.int64)
        bins = np.flatnonzero(total)
        return cls(bins, total[bins])

    def quantiles(self) -> tuple[float, float, float]:
        """25 %, 50 % and 75 % quantiles, dB, to within a bin."""
        reached = np.cumsum(self.counts)
        wanted = np.array(QUANTILES) * (reached[-1] - 1)
        places = np.searchsorted(reached, wanted, side="right")
        before = reached[places] - self.counts[places]
        within = (wanted - before + 0.5) / self.counts[places]
        low, middle, high = np.minimum(_LOWEST + (self.bins[places] + within) * _STEP, CAP).tolist()
        return low, middle, high


@dataclass(frozen=True, eq=False)
class Measures:
    """Figures of one rendering.

    quality: exact quantiles of its patches.
    psnr, ssim: of the whole picture without its border; PSNR in dB.
    patches: histograms of PSNR, one for each of PLANES.
    errors: float32, mean squared error over all channels of WINDOW x WINDOW squares; they begin at `window_origins`.
    """

    quality: Quality
    psnr: float
    ssim: float
    patches: tuple[Histogram, ...]
    errors: FloatArray

    @classmethod
    def of(cls, rendered: FloatArray, truth: FloatArray) -> "Measures":
        """Measure a rendering against the truth, both (H, W, 3), scene units. Raises InputError as `patch_psnr` does."""
        maps = patch_psnr(rendered, truth)
        return cls(
            Quality.of(maps),
            psnr(rendered, truth, BORDER),
            ssim(rendered, truth, BORDER),
            tuple(Histogram.of(plane) for plane in maps),
            _window_errors(rendered, truth),
        )

    def encode(self) -> bytes:
        """File content for the cache, which `decode` reads."""
        buffer = io.BytesIO()
        parts = {f"{name}_{kind}": getattr(part, kind) for name, part in zip(PLANES, self.patches, strict=True) for kind in _PARTS}
        quality = np.array(self.quality)
        np.savez_compressed(buffer, quality=quality, whole=np.array([self.psnr, self.ssim]), errors=self.errors, **parts)
        return buffer.getvalue()

    @classmethod
    def decode(cls, data: bytes) -> "Measures":
        """Inverse of `encode`. Raises InputError for anything else."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as stored:
                parts = tuple(Histogram(*(stored[f"{name}_{kind}"] for kind in _PARTS)) for name in PLANES)
                quality: Any = [tuple(row) for row in stored["quality"].tolist()]
                whole = stored["whole"].tolist()
                return cls(Quality(*quality), whole[0], whole[1], parts, stored["errors"])
        except Exception as error:  # a damaged archive raises nearly everything
            raise InputError(f"is no result of a measurement ({error})") from None


def window_origins(size: int) -> list[int]:
    """First rows (or columns) of the squares of `Measures.errors` in a frame with `size` of them, every STRIDE pixels.

    If no square fits there is one origin, of a smaller square.
    """
    span = size - 2 * BORDER
    if span <= WINDOW:
        return [BORDER]
    return [*range(BORDER, size - BORDER - WINDOW, STRIDE), size - BORDER - WINDOW]


def _window_errors(rendered: FloatArray, truth: FloatArray) -> FloatArray:
    square = np.square(rendered.astype(np.float64) - truth).mean(axis=2)
    for axis in (0, 1):
        origins = window_origins(square.shape[axis])
        end = square.shape[axis] - BORDER if len(origins) == 1 else 0
        means = [square.take(range(start, end or start + WINDOW), axis).mean(axis=axis) for start in origins]
        square = np.stack(means, axis=axis)
    errors: FloatArray = square.astype(np.float32)
    return errors
