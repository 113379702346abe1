"""Means and variances of the mosaic's samples in places such as patches. They are measured values:
nothing is reconstructed.

Levels are parts of full scale: (code - black) / (white - black). Full scale is the same for all
planes, so Eq. 7 has the same gamma for levels as for scene units. That is why gamma can be measured
without knowing full scale in scene units.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from ...shared import BoolArray, ByteArray, DoubleArray, FloatArray, IndexArray, Mosaic
from ...shared.arrays import CodeArray

CLIPPED = 0.985  # of full scale: above it some of the noise would be cut off
CLIP = 5.0  # standard deviations: samples beyond are left out when a deviation is measured
LEAST_SAMPLES = 40  # samples of the rarest plane in a window, about
# per side, at most: flat frames are never quite even, so means and variances are measured in
# windows
_PLACES_ACROSS = 12
_TAIL = 0.01  # share of the darkest, and of the brightest samples, which may be defects
FEW = 9  # samples: fewer do not tell their own deviation
NO_PLANE = 255  # of a defective sample, see `planes_of`
# Samples end below the white level where this share of them has the highest code, many times as
# many as so many lower codes, and more than a few; a drawn scene without noise has few codes.
_ENDED, _MORE, _BELOW, _CODES, _FEWEST = 1e-3, 10, 8, 64, 20


Pixels = tuple[IndexArray, IndexArray]
"""Rows and columns of the pixels of a place."""
Named = tuple[str, Mosaic]
"""A frame after its name."""


@dataclass(frozen=True, eq=False)
class PlaceSamples:
    """Statistics of N places, per plane (the C channels, then panchromatic), in parts of full
    scale.

    Attributes
    ----------
    mean : DoubleArray
        (N, C + 1), level at the centre of the place.
    variance : DoubleArray
        (N, C + 1), of a single sample about the place's shading.
    count : DoubleArray
        (N, C + 1), number of samples.
    clipped : BoolArray
        (N,), whether samples are at the white level that do not stand out from the others.
    where : DoubleArray
        (N, 2), row and column from the middle of the frame, in halves of its diagonal.
    dimming : DoubleArray | float
        (N, C), how much more than panchromatic levels those of a channel fall off there, as a share
        of what known shading leaves of them: its gain of panchromatic samples over the channel's,
        minus 1.
    """

    mean: DoubleArray
    variance: DoubleArray
    count: DoubleArray
    clipped: BoolArray
    where: DoubleArray
    dimming: DoubleArray | float = 0.0

    @property
    def exposed(self) -> BoolArray:
        """The places that have samples of all planes and are not clipped, (N,)."""
        return ~self.clipped & (self.count.min(axis=1) >= 1)

    def joined(self, other: "PlaceSamples", which: BoolArray) -> "PlaceSamples":
        """Return these places and some of `other` after them; which: (N,), of `other`."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return PlaceSamples(*(np.concatenate([ours, theirs[which]]) for ours, theirs in pairs))


def levels_of(mosaic: Mosaic) -> FloatArray:
    """Return the samples in parts of full scale, without shading, float32 (H, W)."""
    return mosaic.signal / np.float32(mosaic.calibration.full_scale)


def without_shading(mosaic: Mosaic) -> Mosaic:
    """Return a frame that does not state the shading of its lens."""
    return replace(mosaic, calibration=replace(mosaic.calibration, shading=None))


def figures(values: Sequence[float] | DoubleArray) -> str:
    """Return numbers as text, with four digits each."""
    return " ".join(f"{value:.4g}" for value in values)


def robust_deviation(residuals: DoubleArray) -> float:
    """Return the standard deviation of residuals about 0 from their median absolute value; outliers
    hardly change it.
    """
    return 1.4826 * float(np.median(np.abs(residuals)))  # 1.4826: for a Gaussian


def code_step(codes: CodeArray) -> int:
    """Return the step between the usual codes: more than 1 where a sensor's were shifted to more
    bits; 1 of one or two codes, which do not tell it.
    """
    share = np.bincount(codes.ravel()) / codes.size
    up_to = share.cumsum()
    used = np.flatnonzero((share > 0) & (up_to > _TAIL) & (up_to - share < 1 - _TAIL))
    return int(np.gcd.reduce(np.diff(used))) if len(used) > 2 else 1


def planes_of(mosaic: Mosaic, *, defects: bool = False) -> ByteArray:
    """Return the plane of each sample, uint8 (H, W), as `CfaPattern.filter_map`; a channel without
    filters has every second panchromatic pixel of a row, because it is read by their electronics.

    defects: whether defects that the calibration lists count; otherwise their plane is `NO_PLANE`.
    """
    pattern = mosaic.pattern
    planes = pattern.filter_map(mosaic.shape)
    if pattern.derived is not None:
        clear = planes == len(pattern.channels)
        planes[clear & (clear.cumsum(axis=1, dtype=np.uint8) % 2 == 1)] = pattern.derived
    if not defects:
        planes[listed_defects(mosaic)] = NO_PLANE
    return planes


def plateau(mosaic: Mosaic) -> tuple[int, float]:
    """Return the highest code that more than a few samples have, and their share if samples end
    there below the white level; 0 if they do not. Noise alone makes the highest codes rare.
    """
    codes = mosaic.codes[planes_of(mosaic) != NO_PLANE]
    counts = np.bincount(codes)
    usual = np.flatnonzero(counts > _FEWEST)  # hot pixels may have higher ones
    end = int(usual[-1]) if usual.size else 0
    black, white = mosaic.calibration.black_level[-1], mosaic.calibration.white_level
    if not black < end < white or np.count_nonzero(counts) < _CODES:
        return end, 0.0
    near = counts[max(end - _BELOW * code_step(codes), 0) : end]
    share = float(counts[end] / counts.sum())
    return end, share if share > _ENDED and counts[end] > _MORE * near.sum() else 0.0


def listed_defects(mosaic: Mosaic) -> Pixels:
    """Return the pixels in the calibration's list of defects that lie in the frame."""
    places = np.array(mosaic.calibration.defects, np.intp).reshape(-1, 2)
    rows, columns = places[(places < mosaic.shape).all(axis=1)].T
    return rows, columns


def inliers(residuals: DoubleArray, least: float) -> BoolArray:
    """Mark residuals about 0 that do not stand out: dust, glints and defects do.

    least: deviation that all may have; few codes have no median deviation.
    """
    return np.abs(residuals) <= CLIP * max(robust_deviation(residuals), least)


def patch_samples(mosaic: Mosaic, patches: Sequence[Pixels]) -> PlaceSamples:
    """Return the statistics of the patches of a chart.

    The light may fall off across a patch, equally for all filters: a linear surface is fitted to
    the panchromatic samples, which are many, and all samples are divided by it, so that samples at
    different sites can be compared. Defects that are listed, and samples that stand out, are left
    out.
    """
    levels, number = levels_of(mosaic).astype(np.float64), len(mosaic.pattern.planes)
    planes, calibration = planes_of(mosaic), mosaic.calibration
    # What saturates is what the sensor reads.
    clipped = levels_of(without_shading(mosaic)) >= CLIPPED
    code = 1 / (calibration.white_level - calibration.black_level[-1])
    moments, at_white = [], []
    for pixels in patches:
        moment, kept = _moments(pixels, levels[pixels], planes[pixels], number, code)
        moments.append(moment)
        at_white.append((clipped[pixels] & kept).any())
    mean, variance, count = np.moveaxis(np.array(moments), 1, 0)
    middles = np.array([(rows.mean(), columns.mean()) for rows, columns in patches])
    last, dimming = np.array(mosaic.shape) - 1, np.zeros((len(mean), number - 1))
    where = 2 * (middles - last / 2) / np.hypot(*last)
    if shading := calibration.shading:
        at = tuple(middles.astype(int).T)
        gains = [shading.of_plane(mosaic.shape, plane)[at] for plane in range(number)]
        dimming = np.stack([gains[-1] / gain - 1.0 for gain in gains[:-1]], axis=1)
    return PlaceSamples(mean, variance, count, np.array(at_white), where, dimming)


def _moments(
    pixels: Pixels, values: DoubleArray, plane: ByteArray, number: int, code: float
) -> tuple[DoubleArray, BoolArray]:
    """Return mean, variance and count per plane, (3, number), and the samples that count; code:
    the level of one.
    """
    design = np.stack([np.ones(values.size), *(axis - axis.mean() for axis in pixels)], axis=1)
    kept = plane == number - 1
    kept[kept] = inliers(values[kept] - np.median(values[kept]), code)
    fitted, *_ = np.linalg.lstsq(design[kept], values[kept], rcond=None)
    shading = np.ones(values.size)
    if fitted[0] > 0:
        shading = np.clip(design @ fitted / fitted[0], 0.5, 2.0)
    spread = robust_deviation((values - fitted[0] * shading)[kept])
    moments = np.zeros((3, number))
    for index in range(number):
        here = np.flatnonzero(plane == index)
        if here.size > 2:  # of two nobody knows the one that stands out
            middle = float(np.median(values[here] / shading[here]))
            # Few samples tell their spread less well than the panchromatic ones, by photon noise.
            least = spread * max(middle / max(fitted[0], code), 1) ** 0.5 * (here.size < FEW)
            here = here[inliers(values[here] - middle * shading[here], max(code, least))]
        kept[plane == index] = False
        kept[here] = True
        if here.size:
            mean = values[here].sum() / shading[here].sum()  # maximum likelihood for photons
            squares = ((values[here] - mean * shading[here]) ** 2).sum()
            moments[:, index] = mean, squares / max(here.size - 1, 1), here.size
    return moments, kept


def windows(planes: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Yield windows of the frame, as many as possible with enough samples of every plane."""
    rarest = int(np.bincount(planes[planes != NO_PLANE]).min())
    number = int(np.clip(np.sqrt(rarest / LEAST_SAMPLES), 1, _PLACES_ACROSS))
    yield from cut_windows(planes.shape, (number, number))


def cut_windows(shape: tuple[int, ...], numbers: tuple[int, ...]) -> Iterator[tuple[slice, slice]]:
    """Yield the windows that cut a frame into rows and columns of them.

    numbers: of windows along each axis.
    """
    axes = zip(shape, numbers, strict=True)
    cuts = (np.unique(np.linspace(0, size, count + 1).astype(int)).tolist() for size, count in axes)
    for (top, bottom), (left, right) in product(*map(pairwise, cuts)):
        yield slice(top, bottom), slice(left, right)


def clipped_moments(values: DoubleArray) -> tuple[float, float]:
    """Return mean and standard deviation without outliers, which are clipped until nothing changes.

    Do not use the median deviation: it is 0 or 1 for integer codes with little noise.
    """
    from scipy.stats import sigmaclip  # scipy.stats takes a second to load

    kept = sigmaclip(values, CLIP, CLIP).clipped
    if not kept.size:  # all are equal, but for the rounding of their mean
        kept = values
    return float(kept.mean()), float(kept.std())
