"""The kept measurements of one rendering: patch quantiles and histograms (to pool scenes), whole-image figures, a map of errors."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError
from tools.scenes.scene import RGB

from .colour_kept import PLACES, colour_kept
from .coverage import BINS, KINDS, PARTS, WITHIN, coverage, foretold, histograms
from .hue import wrong_hue
from .metrics import BORDER, CAP, QUANTILES, Quality, Quantiles, patch_psnr, whole_psnr
from .one_hue import uneven_hue
from .ssim import ssim

PLANES = ("rgb", "luminance", "chrominance")
TITLES = ("RGB", "luminance", "chrominance")
WINDOW, STRIDE = 96, 24  # pixels: the squares among which the gallery chooses
_STEP = 0.002  # dB, width of a bin: the error of pooled quantiles
_LOWEST = -100.0
_BINS = round((CAP - _LOWEST) / _STEP) + 1
_PARTS, _KEPT = ("bins", "counts"), ("kept", "covered", "doubts")


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

    def quantiles(self) -> Quantiles:
        """The four QUANTILES, dB, to within a bin."""
        reached = np.cumsum(self.counts)
        wanted = np.array(QUANTILES) * (reached[-1] - 1)
        places = np.searchsorted(reached, wanted, side="right")
        before = reached[places] - self.counts[places]
        within = (wanted - before + 0.5) / self.counts[places]
        lowest, low, middle, high = np.minimum(_LOWEST + (self.bins[places] + within) * _STEP, CAP).tolist()
        return lowest, low, middle, high


@dataclass(frozen=True, eq=False)
class Measures:
    """Figures of one rendering.

    quality: exact quantiles of its patches.
    psnr: of the whole picture without its border, dB, one for each of PLANES.
    ssim: of the same.
    wrong_hue: share of its pixels that show a wrong hue (see `wrong_hue`), 0 to 1; None where red, green and blue are not measured.
    uneven_hue: share of those whose hue is not that of their object (see `uneven_hue`), likewise.
    kept: what `colour_kept` returns; 0 where red, green and blue are not measured.
    covered: what `coverage` returns; 0 where the picture does not state how far it may be off.
    doubts: likewise the `histograms` of how far pixels may be off, of right and of wrong hue.
    patches: histograms of PSNR, one for each of PLANES.
    errors: float32, mean squared error over all channels of WINDOW x WINDOW squares; they begin at `window_origins`.
    hues: float32, share of pixels of wrong hue of the same squares; 0 where there is no `wrong_hue`.
    """

    quality: Quality
    psnr: tuple[float, float, float]
    ssim: float
    wrong_hue: float | None
    uneven_hue: float | None
    kept: DoubleArray
    covered: DoubleArray
    doubts: DoubleArray
    patches: tuple[Histogram, ...]
    errors: FloatArray
    hues: FloatArray

    @classmethod
    def of(cls, rendered: FloatArray, truth: FloatArray, channels: str = RGB) -> "Measures":
        """Measure a rendering against the truth, both (H, W, N), scene units. Raises InputError as `patch_psnr` does.

        rendered: may have what it states behind its channels, (H, W, N + 1 + N), see `offline.Rendering.uncertainty`.
        channels: the N letters of the channels.
        """
        rendered, stated = rendered[..., : truth.shape[-1]], rendered[..., truth.shape[-1] :]
        maps = patch_psnr(rendered, truth)
        places = [channels.index(letter) for letter in RGB if letter in channels]
        visible, known = len(places) == len(RGB), stated.shape[-1] > 0
        shown, inner = (rendered[..., places], truth[..., places]), (slice(BORDER, -BORDER),) * 2
        wrong = wrong_hue(*shown) if visible else np.zeros(truth.shape[:2], bool)
        return cls(
            Quality.of(maps),
            whole_psnr(rendered, truth, BORDER),
            ssim(rendered, truth, BORDER),
            float(wrong[inner].mean()) if visible else None,
            float(uneven_hue(*shown)[inner].mean()) if visible else None,
            colour_kept(*shown) if visible else np.zeros((2, len(PLACES))),
            coverage(rendered, truth, stated) if known else np.zeros((len(PARTS), len(KINDS), len(WITHIN) + 1)),
            histograms(foretold(*shown, stated[..., [0, *(1 + place for place in places)]])[inner], wrong[inner])
            if known and visible
            else np.zeros((2, BINS)),
            tuple(Histogram.of(plane) for plane in maps),
            _window_means(np.square(rendered.astype(np.float64) - truth).mean(axis=2)),
            _window_means(wrong.astype(np.float64)),
        )

    def encode(self) -> bytes:
        """File content for the cache, which `decode` reads."""
        buffer = io.BytesIO()
        parts = {f"{name}_{kind}": getattr(part, kind) for name, part in zip(PLANES, self.patches, strict=True) for kind in _PARTS}
        hues = self.wrong_hue, self.uneven_hue
        whole = np.array([*self.psnr, self.ssim, *(np.nan if each is None else each for each in hues)])
        planes: dict[str, Any] = {name: getattr(self, name) for name in (*_KEPT, "errors", "hues")}
        np.savez_compressed(buffer, quality=np.array(self.quality), whole=whole, **planes, **parts)
        return buffer.getvalue()

    @classmethod
    def decode(cls, data: bytes) -> "Measures":
        """Inverse of `encode`. Raises InputError for anything else."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as stored:
                parts = tuple(Histogram(*(stored[f"{name}_{kind}"] for kind in _PARTS)) for name in PLANES)
                quality: Any = [tuple(row) for row in stored["quality"].tolist()]
                *psnr, ssim_, wrong, uneven = stored["whole"].tolist()
                wrong, uneven = (None if np.isnan(each) else each for each in (wrong, uneven))
                kept, covered, doubts, errors, hues = (stored[name] for name in (*_KEPT, "errors", "hues"))
                whole = Quality(*quality), (psnr[0], psnr[1], psnr[2]), ssim_, wrong, uneven
                return cls(*whole, kept, covered, doubts, parts, errors, hues)
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


def _window_means(plane: DoubleArray) -> FloatArray:
    """Means of a plane (H, W) over the squares."""
    for axis in (0, 1):
        origins = window_origins(plane.shape[axis])
        end = plane.shape[axis] - BORDER if len(origins) == 1 else 0
        means = [plane.take(range(start, end or start + WINDOW), axis).mean(axis=axis) for start in origins]
        plane = np.stack(means, axis=axis)
    return plane.astype(np.float32)
