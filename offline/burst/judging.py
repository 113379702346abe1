"""What to make of each frame of a burst: whether it fits the reference at all, and where."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.errors import InputError
from shared.mosaic import Mosaic
from shared.motion import Motion

from ..kernels.merging import displace
from .agreement import agreement, sure
from .alignment import REMEDY, align
from .colour_doubts import BlockColours, colour_doubts, on_pixels
from .frames import Frame, detail, scaled, tiles
from .tiles import weighted_median

_LEAST_AGREEMENT = 0.2
_LEAST_SHARPNESS = 0.85
_DETAIL = 0.5  # of what noise accounts for: tiles with less detail beyond that say nothing of sharpness
_UNEVEN = 0.12  # a quarter of the tiles brighter or darker by this share than the middle: light from elsewhere
_LIT = 5.0  # standard deviations of the noise, above which the light of a pixel says something of that
_STRIP = 256
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Judged:
    """What became of one frame.

    used: whether it is part of the picture.
    reason: why it is not; "" if it is.
    motion: how it lies against the reference; None = unknown.
    gain: how many times as bright it is as the reference.
    error: estimated error of the motion, pixels.
    agreement: share of the frame that agrees with the reference, 0 to 1.
    sharpness: amplitude of its fine detail, relative to the reference's at the same places.
    """

    used: bool
    reason: str = ""
    motion: Motion | None = None
    gain: float = 1.0
    error: float = 0.0
    agreement: float = 1.0
    sharpness: float = 1.0


def misfit(frame: Mosaic, reference: Mosaic) -> str:
    """Why two shots are not of one burst; "" if they may be. Codes may differ, as long as the scene units are the same."""
    if frame.shape != reference.shape:
        sizes = ["{1} x {0}".format(*each.shape) for each in (frame, reference)]
        return f"has {sizes[0]} pixels, the reference {sizes[1]}"
    if frame.pattern != reference.pattern:
        return "has another filter pattern than the reference"
    own, other = frame.calibration, reference.calibration
    if own.channels != other.channels or not np.allclose(own.gamma, other.gamma, rtol=1e-3):
        return "was taken with another camera: its channels, or their weights (gamma), are not those of the reference"
    return ""


def judged(base: Frame, colours: BlockColours, frame: Frame, mosaic: Mosaic, known: Motion | None) -> tuple[Judged, ByteArray]:
    """What to make of a frame, and how far it agrees with the reference at each pixel, 0 to 255, uint8 (H, W).

    base: the reference, and the colours of its blocks. mosaic: it, too. known: the motion, where it is known.
    """
    shape, nothing = mosaic.shape, np.zeros(0, np.uint8)
    if reason := frame.empty:
        return Judged(False, reason), nothing
    if known is None:
        try:
            found = align(base.luminance, frame.luminance, (base.noise, frame.noise), (base.limit, frame.limit))
        except InputError as error:
            return Judged(False, str(error).removesuffix(f"; {REMEDY}")), nothing  # that is what becomes of it
        result = Judged(True, "", found.motion, found.gain, found.error)
    else:
        result = Judged(True, "", known)
    motion, gain = result.motion or Motion(), result.gain
    noise, limits = (base.noise, scaled(frame.noise, gain)), (base.limit, frame.limit / gain)
    shown, measured = np.empty((2, *shape), np.float32)
    displace(frame.luminance, as_arrays([motion], shape), 1 / gain, shown)
    mask = mosaic.pattern.panchromatic_mask(shape).astype(np.float32)
    displace(mask, as_arrays([motion], shape), 1.0, measured)
    measured = np.square(np.nan_to_num(measured).clip(0, 1)) * mask
    seen = np.isfinite(shown) & (shown < limits[1]) & (base.luminance < limits[0])
    shown_light = np.where(seen, shown, base.luminance)
    result = replace(result, sharpness=_sharpness((base.luminance, shown_light), noise, seen))
    if result.sharpness < _LEAST_SHARPNESS:
        share = f"{100 * result.sharpness:.0f} % of the reference's detail, at least {100 * _LEAST_SHARPNESS:.0f} % must be there"
        return replace(result, used=False, reason=f"is out of focus or shaken: {share}"), nothing
    if (uneven := _unevenness(base, shown_light, seen)) > _UNEVEN:
        return replace(result, used=False, reason=f"is lit differently (a flash?): by {100 * uneven:.0f} % over the frame"), nothing
    trust = agreement(base.luminance, shown, measured, noise, limits)
    doubts = colour_doubts(colours, frame, motion, gain, mosaic)
    for top in range(0, shape[0], _STRIP):
        rows = slice(top, min(top + _STRIP, shape[0]))
        trust[rows] = np.rint(trust[rows] * sure(on_pixels(doubts, motion, mosaic, rows)))
    result = replace(result, agreement=float(trust.mean()) / 255)
    if result.agreement < _LEAST_AGREEMENT:
        return replace(result, used=False, reason=f"only {100 * result.agreement:.0f} % of it agrees with the reference"), nothing
    return result, trust


def as_arrays(motions: Sequence[Motion], shape: tuple[int, ...]) -> tuple[DoubleArray, DoubleArray, FloatArray]:
    """Motions as the kernels take them."""
    turns, starts = zip(*(motion.affine((shape[0], shape[1])) for motion in motions), strict=True)
    nodes = next((motion.local.shape for motion in motions if motion.local is not None), (1, 1, 2))
    shifts = [motion.local if motion.local is not None else np.zeros(nodes) for motion in motions]
    return np.array(turns), np.array(starts), np.array(shifts, np.float32)


def _sharpness(planes: tuple[FloatArray, FloatArray], noise: tuple[NoiseModel | None, NoiseModel | None], seen: BoolArray) -> float:
    """Amplitude of the frame's fine detail relative to the reference's: the median over tiles, which count by it."""
    (own, own_noise), (other, other_noise) = (detail(plane, model, seen) for plane, model in zip(planes, noise, strict=True))
    clear = own - own_noise > _DETAIL * np.maximum(own_noise, other_noise) + _TINY
    if not clear.any():
        return 1.0  # nothing tells
    ratio = np.sqrt(np.maximum(other - other_noise, 0)[clear] / (own - own_noise)[clear])
    return weighted_median(ratio, np.sqrt((own - own_noise)[clear]))


def _unevenness(base: Frame, frame: FloatArray, seen: BoolArray) -> float:
    """How far the light of a quarter of the tiles differs from what the exposure explains, a share of it."""
    floor = _LIT * base.noise.sigma(0.0) if base.noise else 0.0
    share, own, other = tiles(seen), tiles(base.luminance * seen), tiles(frame * seen)
    lit = (share > 0.5) & (own > floor * share) & (other > 0)
    if not lit.any():
        return 0.0
    ratio = np.log(other[lit] / own[lit])
    return float(np.expm1(np.quantile(np.abs(ratio - np.median(ratio)), 0.75)))
