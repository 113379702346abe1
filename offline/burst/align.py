"""Motion of a frame of a hand-held series against the reference, found from both, with OpenCV.

Normalised correlation of small copies finds the shift. On each larger copy the enhanced correlation
coefficient (ECC: Evangelidis and Psarakis 2008) finds shift and rotation to a small fraction of a
pixel. Where the frames differ by much of their texture, something moves, and does not count. Where
most of the picture lies elsewhere still (parallax), dense optical flow (DIS: Kroeger et al. 2016)
gives local shifts.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, NamedTuple

import cv2
import numpy as np

from ...shared import BoolArray, FloatArray, NoiseModel
from ...shared.processors import threads
from ..frame import unknown
from ..numerics.gaussian import smoothed
from .motion import Motion, displaced

DEVIATIONS = 3.0
"""Standard deviations of noise that are tolerated: 0.3 % of Gaussian noise exceed them."""
TINY = 1e-12
"""Keeps divisions finite."""
CLIPPED = 0.98
"""Fraction of the sensor's limit from which on a sample counts as clipped. Chosen."""

# Chosen on drawn scenes. `python -m tests.benchmarks.alignment` measures on photographs.
# pixels: standard deviation of the Gaussian that takes away what sampling and filled pixels add to
# texture
_BLUR = 1.2
# pixels whose mean has the variance that white noise has after that blur
_SPREAD = 4 * np.pi * _BLUR**2
# squared gradient of blurred white noise, per variance
_STEEPNESS = (1 - np.exp(-1 / _BLUR**2)) / 2
# pixels: larger planes are halved until they are smaller; shorter side of a frame
_LARGEST, _SMALLEST = 1_500_000, 12
_COPY = 128  # pixels: longer side of the smallest copies
_FARTHEST = 0.2  # fraction of a side: the largest shift that is looked for
_TEXTURE_WIDTH = 4.0  # pixels: standard deviation of the neighbourhood in which texture is measured
# of the variance of noise, in texture
_WIDE = _TEXTURE_WIDTH**2
_KEPT = 1 - 4 * _BLUR**2 / (2 * _BLUR**2 + _WIDE) + _BLUR**2 / (_BLUR**2 + _WIDE)
# squared differences that show that something moves: a share of texture, and times their median
_MOVED, _USUAL = 0.3, 4.0
_ROUNDS = 2  # on each copy, each without what the one before has seen moving
# of ECC: shift and rotation; iterations and change of the coefficient that end it
_MODEL = cv2.MOTION_EUCLIDEAN, (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-5)
# of the mean luminance, added before roots are taken: noise in the dark would decide. Without roots
# errors are twice as large (0.008 instead of 0.005 pixels, 0.037 instead of 0.016 with lamps)
_BLACK = 0.1
# quantile of the reference: what is brighter counts as that, so that lamps do not decide, unless
# the rest shows no texture beyond noise
_LAMPS = 0.99
_CLEAR = 0.98  # share of the neighbourhood that is not clipped where exposure is measured
_ROUNDING = 1e-6  # of the power of luminance: what rounding makes of differences
_STEP = 32  # pixels between nodes of local shifts
_LEAST_SIDE = 16  # pixels, of planes whose flow is measured: with fewer, OpenCV ends the program
_FLOWS = 2  # measurements of local shifts: each adds what the one before has left
_FASTEST = 2.0  # pixels: flow beyond it is that of a moving thing
# pixels: local shifts that are worth it explain the differences that such a shift makes,
_NOTABLE = 0.15
_NOISY = 0.1  # and this share of the differences that they leave
_LOST, _WON = 0.4, 0.7  # share of that which they must explain to be taken at all, and in full
_LEAST_AGREEMENT = 0.3  # another scene agrees by less
_MOST_ERROR = 0.5  # pixels


@dataclass(frozen=True, eq=False)
class View:
    """Luminance as one frame shows it, its defects mended.

    Attributes
    ----------
    luminance : FloatArray
        float32 (H, W), scene units.
    noise : NoiseModel
        Of its samples; figures of 0 where there is none, or it is unknown.
    limit : float
        Scene units from which on it is clipped.
    colours : FloatArray
        (block rows, block columns, S), the samples of its whole blocks; empty where nothing looks
        at them.
    colour_gains : FloatArray | float
        By which these were multiplied to even their shading, as `colours`; it scales their noise.
    """

    luminance: FloatArray
    noise: NoiseModel = NoiseModel.gaussian(0.0, planes=1)  # noqa: RUF009 - frozen
    limit: float = np.inf
    colours: FloatArray = field(default_factory=unknown)
    colour_gains: FloatArray | float = 1.0

    def variance(self, signal: Any) -> Any:
        """Variance of panchromatic samples at a mean signal."""
        return self.noise.variance(np.asarray(signal))

    def darker(self, gain: float) -> "View":
        """Return the frame as if it had been exposed `gain` times less."""
        noise, unit = self.noise.in_units_of(gain), np.float32(gain)
        luminance, limit, colours = self.luminance / unit, self.limit / gain, self.colours / unit
        return View(luminance, noise, limit, colours, self.colour_gains)


class Alignment(NamedTuple):
    """Motion of a frame against the reference.

    Attributes
    ----------
    motion : Motion
        Where the reference's points lie in the frame.
    gain : float
        How many times as bright the frame is as the reference.
    error : float
        Estimated error of the frame's shift, pixels, root mean square.
    agreement : float
        0 to 1, the share of the reference's texture that the frame shows where the motion says.
    """

    motion: Motion
    gain: float = 1.0
    error: float = 0.0
    agreement: float = 1.0


_opencv = Lock()  # has one number of threads for all threads of the program


@contextmanager
def _opencv_threads() -> Iterator[None]:
    """Let OpenCV use `threads()` threads; then it has the number that it had."""
    with _opencv:
        before = cv2.getNumThreads()
        cv2.setNumThreads(threads())
        try:
            yield
        finally:
            cv2.setNumThreads(before)


@_opencv_threads()
def align(reference: View, frame: View, motion: Motion | None = None) -> Alignment | str:
    """Find the motion of a frame, compared with the reference, and how many times as bright it is.

    Parameters
    ----------
    reference, frame : View
        Luminance of every pixel (`recover_luminance`), of one shape. Noise decides only how much
        the two may differ.
    motion : Motion | None, optional
        Where that is known: it stays, and a frame of few pixels counts as as bright as the
        reference. None = unknown.

    Returns
    -------
    Alignment | str
        Why the frame cannot be aligned, if it cannot: few pixels, another scene, or too little
        texture.
    """
    height, width = reference.luminance.shape
    if min(height, width) < _SMALLEST:
        few = f"{width} x {height} pixels are too few to be aligned"
        return Alignment(motion) if motion else few
    gain = _gain(reference, frame)
    copies = list(_copies(reference, frame, gain))[::-1]
    if motion:
        copy = copies[-1]
        return Alignment(motion, gain * _aligned(copy, motion.times(1 / copy.scale)).gain)
    # where a large thing moves, its shift may be the likeliest
    starts = Motion(), Motion(_shift(copies[0]))
    best = max((_refined(copies[0], start) for start in starts), key=lambda fit: fit.agreement)
    for copy in copies[1:]:
        best = _refined(copy, best.motion.times(2))
    scale = copies[-1].scale
    if not best.error * scale <= _MOST_ERROR:
        return f"cannot be aligned to {_MOST_ERROR} pixels: too little texture, or another scene"
    if (local := _local_shifts(copies[-1], best.motion)) is not None:
        shifted = _fit(copies[-1], replace(best.motion, local=local))
        best = shifted if shifted.agreement > best.agreement else best
    if best.agreement < _LEAST_AGREEMENT:
        share = f"{100 * best.agreement:.0f} % of the picture agrees with the reference"
        least = f"at least {100 * _LEAST_AGREEMENT:.0f} % must"
        return f"another scene, or too little texture: {share}, {least}"
    return Alignment(best.motion.times(scale), gain * best.gain, best.error * scale, best.agreement)


class _Copy(NamedTuple):
    """Smaller, smooth copies of both frames, at the exposure of the reference.

    scale: pixels of the frame per pixel. variance: of the noise of both. limit: luminance of what
    is clipped.
    """

    scale: int
    reference: FloatArray
    frame: FloatArray
    variance: float
    limit: float


class _Aligned(NamedTuple):
    """A frame as the reference would see it: luminance, what it is brighter by, and where both show
    the same thing, (H, W).
    """

    moved: FloatArray
    gain: float
    inside: BoolArray
    same: BoolArray


def _gain(reference: View, frame: View) -> float:
    """Exposure ratio of the frame, from a quantile of the luminance that is clipped in neither
    frame.
    """
    share = min(float((view.luminance < view.limit).mean()) for view in (reference, frame)) / 2
    own, other = (float(np.quantile(view.luminance, share)) for view in (reference, frame))
    return other / own if own > 0 and other > 0 else 1.0


def _copies(reference: View, frame: View, gain: float) -> Iterator[_Copy]:
    """Smaller and smaller copies. What is clipped in one is clipped in both."""
    limit = np.float32(min(reference.limit, frame.limit / gain))
    both = reference.luminance, frame.luminance / np.float32(gain)
    planes = [np.minimum(plane, limit) for plane in both]
    level = float(planes[0].mean())
    variance = float(reference.variance(level) + frame.variance(level * gain) / gain**2)
    scale = 1
    while True:
        height, width = planes[0].shape
        is_last = max(height, width) <= _COPY or min(height, width) < 4 * _SMALLEST
        if is_last or planes[0].size <= _LARGEST:
            own, other = (smoothed(plane, _BLUR) for plane in planes)
            yield _Copy(scale, own, other, variance / (_SPREAD * scale**2), float(limit))
        if is_last:
            return
        half = width // 2, height // 2
        even = (plane[: 2 * half[1], : 2 * half[0]] for plane in planes)
        planes = [cv2.resize(plane, half, interpolation=cv2.INTER_AREA) for plane in even]
        scale *= 2


def _shift(copy: _Copy) -> tuple[float, float]:
    """The likeliest shift, pixels of the copies: the middle of the reference is found in the
    frame.
    """
    own, other = (_texture(plane) for plane in (copy.reference, copy.frame))
    down, across = (round(_FARTHEST * size) for size in own.shape)
    middle = own[down : len(own) - down, across : own.shape[1] - across]
    likeness = cv2.matchTemplate(other, middle, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(np.argmax(likeness), likeness.shape)
    return float(row - down), float(column - across)


def _texture(plane: FloatArray) -> FloatArray:
    return plane - smoothed(plane, _TEXTURE_WIDTH)


def _aligned(copy: _Copy, motion: Motion) -> _Aligned:
    moved = displaced(copy.frame, motion)
    inside = np.isfinite(moved)
    shown = (np.where(inside, plane, 0) for plane in (copy.reference, moved))
    own, other = (smoothed(plane, _TEXTURE_WIDTH) for plane in shown)
    unclipped = inside & (np.fmax(copy.reference, moved) < CLIPPED * copy.limit)
    unclipped = smoothed(unclipped.astype(np.float32), _TEXTURE_WIDTH) > _CLEAR
    lit = unclipped & (own > 0) & (other > 0)
    gain = float(np.median(other[lit] / own[lit])) if lit.any() else 1.0
    moved = np.where(inside, moved / np.float32(gain), copy.reference)
    # not where illumination differs
    differs = smoothed(np.square(_texture(moved - copy.reference)), _TEXTURE_WIDTH)
    texture = smoothed(np.square(_texture(copy.reference)), _TEXTURE_WIDTH)
    usual = _MOVED * texture + _USUAL * np.median(differs)
    return _Aligned(moved, gain, inside, inside & (differs < usual))


def _refined(copy: _Copy, motion: Motion) -> Alignment:
    """The shift and rotation, pixels of the copies, by which the roots of their luminance
    correlate most, so that lamps do not decide alone; those given if OpenCV finds no better ones.
    """
    black = np.float32(_BLACK * max(float(copy.reference.mean()), TINY))
    frame, reference = (np.sqrt(plane.clip(0) + black) for plane in (copy.frame, copy.reference))
    for _ in range(_ROUNDS):
        same = _aligned(copy, motion).same.astype(np.uint8)
        start = cv2.invertAffineTransform(_matrix(motion, same.shape)).astype(np.float32)
        try:  # the reference is what is displaced: the mask is its
            _, matrix = cv2.findTransformECC(frame, reference, start, *_MODEL, same, 1)
        except cv2.error:  # too few pixels, or too little texture on this copy
            break
        motion = _motion(cv2.invertAffineTransform(matrix.astype(np.float64)), same.shape)
    return _fit(copy, motion)


def _matrix(motion: Motion, shape: tuple[int, ...]) -> FloatArray:
    """OpenCV's matrix, (2, 3), of columns and rows."""
    turn, start = motion.affine(shape)
    return np.column_stack([turn[::-1, ::-1], start[::-1]]).astype(np.float32)


def _motion(matrix: Any, shape: tuple[int, ...]) -> Motion:
    """The inverse of `_matrix`."""
    middle = (np.array(shape)[::-1] - 1) / 2
    across, down = matrix @ (*middle, 1) - middle
    return Motion((float(down), float(across)), float(np.arctan2(matrix[0, 1], matrix[0, 0])))


def _fit(copy: _Copy, motion: Motion) -> Alignment:
    """Measure how well a motion, in pixels of the copies, fits."""
    aligned = _aligned(copy, motion)
    rest, count = _texture(aligned.moved - copy.reference), max(int(aligned.same.sum()), 1)
    gradients = np.asarray(np.gradient(copy.reference), np.float64)[:, aligned.same]
    left = float(np.square(rest[aligned.same]).sum()) / (_KEPT * count)
    left = left + _ROUNDING * float(np.square(copy.reference).mean()) + TINY
    # Half of the differences' noise is the reference's, and makes gradients of its own: by chance
    # as much as this.
    chance = _STEEPNESS / 2 * left * (count + DEVIATIONS * np.sqrt(_SPREAD * count))
    certainty = np.linalg.eigvalsh(gradients @ gradients.T - chance * np.eye(2)) / (left * _SPREAD)
    error = float(np.sqrt((1 / np.maximum(certainty, TINY)).sum()))
    for most in np.quantile(copy.reference, (_LAMPS, 1)).astype(np.float32):
        own, other = (np.minimum(plane, most) for plane in (copy.reference, aligned.moved))
        wide = [plane - _around(plane, _STEP) for plane in (own, other - own)]
        texture, differs = (float(np.square(plane[aligned.inside]).mean()) for plane in wide)
        texture, differs = max(texture - copy.variance / 2, TINY), max(differs - copy.variance, 0)
        if texture > copy.variance + TINY:
            break
    return Alignment(motion, aligned.gain, error, max(1 - differs / texture, 0))


def _local_shifts(copy: _Copy, motion: Motion) -> FloatArray | None:
    """Local shifts of nodes, (R, C, 2), pixels of the copies; None = most of the picture lies where
    the motion says, or the copies are too small.
    """
    shape = copy.reference.shape
    if min(shape) < _LEAST_SIDE:
        return None
    rigid = _aligned(copy, motion)
    places = [np.linspace(0, size - 1, max(round(size / _STEP) + 1, 2)) for size in shape]
    nodes = np.ix_(*(np.rint(along).astype(np.intp) for along in places))
    local = np.zeros((*np.broadcast(*nodes).shape, 2), np.float32)
    steep = np.square(np.gradient(copy.reference)).sum(axis=0)
    weight = (rigid.inside * steep / (steep + max(float(steep.mean()), TINY))).astype(np.float32)
    dark, bright = np.quantile(copy.reference, (0.005, 0.995))
    scale = 255 / max(bright - dark, TINY)
    optical = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    optical.setUseSpatialPropagation(False)  # it would depend on the number of threads
    moved = rigid.moved
    for _ in range(_FLOWS):
        codes = [(plane - dark) * scale for plane in (copy.reference, moved)]
        first, second = (np.rint(plane).clip(0, 255).astype(np.uint8) for plane in codes)
        flow = optical.calc(first, second, np.zeros((*shape, 2), np.float32))
        flow = np.moveaxis(flow, 2, 0)[::-1]
        counts = weight * (np.square(flow).sum(axis=0) < _FASTEST**2)
        total, *sums = (_around(plane, _STEP)[nodes] for plane in (counts, *(counts * flow)))
        local += np.stack(sums, axis=2) / (total[..., None] + np.float32(1e-3))
        moved = _aligned(copy, replace(motion, local=local)).moved
    apart = (plane - copy.reference for plane in (rigid.moved, moved))
    before, after = (np.square(difference) * rigid.inside for difference in apart)
    worth = _NOISY * after + _NOTABLE**2 * rigid.inside * steep + TINY
    share = _around(before - after, 2 * _STEP)[nodes] / _around(worth, 2 * _STEP)[nodes]
    if np.median(share) < (_LOST + _WON) / 2:
        return None
    return local * np.clip((share - _LOST) / (_WON - _LOST), 0, 1)[..., None].astype(np.float32)


def _around(plane: FloatArray, reach: int) -> FloatArray:
    """Means of the square around each pixel."""
    side = 2 * reach + 1
    return np.asarray(cv2.blur(plane.astype(np.float32), (side, side)), np.float32)
