"""Find the copies in a burst, choose its reference, and judge whether each frame fits it, and how
far it agrees at each pixel.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter

from ...shared import BoolArray, ByteArray, FloatArray, Mosaic, NoiseModel
from ...shared.progress import Progress
from ..frame import Frame
from ..numerics.gaussian import gaussian, smoothed
from ..pipeline import mend_frame
from ..settings import RenderSettings
from ..stages.highlights import restore_highlights
from ..stages.luminance import recover_luminance
from ..stages.noise import noise_models
from .agree import Reference, agreement, block_colours, lit_evenly, relight, shaded_alike, unclipped
from .align import CLIPPED, TINY, View, align
from .motion import Motion, displaced

# Chosen: what refuses a frame lies between the frames that tests/offline/burst/test_robustness.py
# keeps and those that it refuses.
_LEAST_AGREEMENT = 0.2  # share of the frame, or of it without what is clipped in either
_LEAST_SHARPNESS = 0.85  # of the reference's detail; noise and aliasing leave 0.98 or more of it
# of what noise accounts for: windows with less detail beyond noise do not show sharpness
_DETAIL = 0.5
# a quarter of the windows brighter or darker by this fraction than the median: a light elsewhere
_UNEVEN = 0.12
_MIXED = 5  # pixels: size of the neighbourhood that clipped light reaches when a frame is displaced
_LIT = 5.0  # standard deviations of the noise, above which a pixel counts when frames are compared
# fraction of clipped pixels; mean luminance in units of noise: beyond, a frame shows nothing, but
# where this fraction of it (stars) is brighter than so many units
_GONE, _DARK = 0.9, 0.5
_STARS, _BRIGHTER = 1e-3, 6.0
# Pixels: Gaussians whose difference shows detail that a soft frame has lost, and windows that are
# compared.
_FINE, _COARSE, _WINDOW = 0.8, 1.6, 32
# Chosen: they decide between frames that would do.
_CANDIDATES = 4  # frames that are tried as the reference, at least; half of them if that is more
# of all pixels: of frames whose usable pixels differ by less, the sharper one is preferred
_ALIKE = 0.02
_BLURRED = 0.7  # of the median sharpness: below it a frame is no reference if another one is
_AS_SHARP = 0.95  # of the greatest sharpness: of such frames the first is taken


@dataclass(frozen=True, eq=False)
class Judged:
    """The verdict on one frame.

    Attributes
    ----------
    reason : str
        Why it is not part of the picture; "" if it is.
    copy_of : int | None
        Index of the frame that it is a copy of; None = of none.
    motion : Motion | None
        How it lies against the reference; None = unknown.
    gain : float
        How many times as bright it is as the reference.
    error : float
        Estimated error of the motion, pixels.
    agreement : float
        Share of the frame that agrees with the reference, 0 to 1.
    sharpness : float
        Amplitude of its fine detail, relative to the reference's at the same places.

    Examples
    --------
    >>> from panchroma.offline.burst import Judged, Motion
    >>> frames = Judged(motion=Motion((2.0, -1.0))), Judged("does not overlap the reference")
    >>> [frame.reason or frame.motion.shift for frame in frames]
    [(2.0, -1.0), 'does not overlap the reference']
    """

    reason: str = ""
    motion: Motion | None = None
    gain: float = 1.0
    error: float = 0.0
    agreement: float = 1.0
    sharpness: float = 1.0
    copy_of: int | None = None

    @property
    def used(self) -> bool:
        """True if the frame is part of the picture."""
        return not self.reason


class Kept(NamedTuple):
    """A frame that is merged.

    Attributes
    ----------
    frame : View
        In units of the reference.
    motion : Motion
        How it lies against the reference.
    agreement : ByteArray
        With the reference at each pixel, 0 to 255, uint8 (H, W).
    """

    frame: View
    motion: Motion
    agreement: ByteArray


class Comparison(NamedTuple):
    """The reference of a burst, and how the other frames compare with it.

    Attributes
    ----------
    reference : int
        Its index.
    cleaned : Frame
        Its samples, defects mended and highlights restored; `lost` where no other frame has
        measured them.
    frames : list[Judged]
        What became of each frame, in the order given.
    kept : list[Kept]
        The reference and the frames that are used.
    """

    reference: int
    cleaned: Frame
    frames: list[Judged]
    kept: list[Kept]


def copies(frames: Sequence[Mosaic], reference: int | None = None) -> dict[int, int]:
    """The index of each frame whose samples are those of another one, and that of the frame which
    stays: the first of them.

    Their noise is the same, and does not fall when they are merged.

    Parameters
    ----------
    frames : Sequence[Mosaic]
        Of any cameras and sizes.
    reference : int | None, optional
        Index of a frame that stays, whatever it is a copy of; None = of any.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline.burst.select import copies
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> one, other = (np.random.default_rng(seed).integers(5000, 6000, (24, 36), np.uint16) for seed
    ...     in (1, 2))
    >>> copies([Mosaic(codes, CfaPattern.bayer(6), SensorCalibration()) for codes in (one, other,
    ...     one.copy())])
    {2: 0}
    """
    originals: dict[object, int] = {}
    original_of = {}
    for number in sorted(range(len(frames)), key=lambda index: index != reference):
        samples = np.ascontiguousarray(frames[number].samples)
        digest = hashlib.sha256(samples.data).digest()
        content = frames[number].pattern, samples.shape, samples.dtype.str, digest
        original_of[number] = originals.setdefault(content, number)
    return {number: original for number, original in original_of.items() if original != number}


def compare_frames(
    shots: Sequence[Mosaic],
    settings: RenderSettings,
    progress: Progress,
    reference: int | None,
    motions: Sequence[Motion | None],
) -> Comparison:
    """Compare all frames with the reference: the one that is named, or the best that most others
    agree with.

    Parameters
    ----------
    motions : Sequence[Motion | None]
        Where the reference's points lie in each frame; None = unknown.
    """
    models = noise_models(shots, settings.noise)
    frames = [view_of(shot, model, settings) for shot, model in zip(shots, models, strict=True)]
    tried = list[Comparison]()
    for number in candidates_of(frames) if reference is None else [reference]:
        progress.stage("aligning", len(frames))
        # Samples are mended again: to keep those of all frames takes more memory than anything else
        # here.
        cleaned = mend_frame(shots[number], models[number], settings)
        cleaned = restore_highlights(cleaned, settings.highlights)
        luminance = recover_luminance(cleaned.mosaic, settings.luminance)
        base = replace(frames[number], luminance=luminance)
        seen = lit_evenly(base, shots[number]), block_colours(base, shots[number])
        compared_with = Reference(shots[number], base, *seen)
        verdicts, kept = list[Judged](), list[Kept]()
        for index, (shot, frame, motion) in enumerate(zip(shots, frames, motions, strict=True)):
            progress.advance()
            own = Judged(motion=Motion()), None
            judged, merged = own if index == number else judge(compared_with, shot, frame, motion)
            verdicts.append(judged)
            kept += [merged] if merged else []
        # The reference counts in full, but where it is clipped and another frame is not.
        nowhere = np.zeros(base.luminance.shape, np.uint8)
        agreed = reduce(np.maximum, (other.agreement for other in kept), nowhere)
        agrees = (255 - np.rint((1 - unclipped(base)) * agreed)).astype(np.uint8)
        if cleaned.lost is not None:
            cleaned = replace(cleaned, lost=np.minimum(cleaned.lost, agrees))
        tried.append(Comparison(number, cleaned, verdicts, [Kept(base, Motion(), agrees), *kept]))
        tried = [max(tried, key=lambda comparison: len(comparison.kept))]
        if 2 * len(tried[0].kept) > len(shots):
            break
    return tried[0]


def judge(
    reference: Reference, shot: Mosaic, frame: View, motion: Motion | None
) -> tuple[Judged, Kept | None]:
    """Return the verdict on a frame, and what is merged of it; None = nothing.

    Parameters
    ----------
    motion : Motion | None
        Against the reference; None = unknown.
    """
    if reason := misfit(shot, reference.shot) or emptiness(frame):
        return Judged(reason, motion), None
    aligned = align(reference.lit_evenly, lit_evenly(frame, shot), motion)
    if isinstance(aligned, str):
        return Judged(aligned), None
    frame = shaded_alike(frame.darker(aligned.gain), shot, reference.shot, aligned.motion)
    frame = relight(frame, reference, aligned.motion)
    moved, own = displaced(frame.luminance, aligned.motion), reference.frame
    visible = np.isfinite(moved) & (moved < frame.limit) & (own.luminance < own.limit)
    visible = minimum_filter(visible, _MIXED)
    seen = View(np.where(visible, moved, own.luminance), frame.noise, frame.limit)
    sharpness, uneven = _sharpness(own, seen, visible), _unevenness(own, seen, visible)
    agrees = agreement(reference, frame, moved, aligned.motion)
    share = float(agrees.mean()) / 255
    unclipped = visible | ~np.isfinite(moved)
    shows = unclipped.mean() > 1 - _GONE
    agreeing = max(share, float(agrees[unclipped].mean()) / 255) if shows else share
    reason = ""
    if sharpness < _LEAST_SHARPNESS:
        detail = f"{100 * sharpness:.0f} % of the reference's detail"
        least = f"at least {100 * _LEAST_SHARPNESS:.0f} % must be there"
        reason = f"is out of focus or shaken: {detail}, {least}"
    elif uneven > _UNEVEN:
        reason = f"is lit differently (a flash?): by {100 * uneven:.0f} % over the frame"
    elif agreeing < _LEAST_AGREEMENT:
        where = "what is not clipped" if shows else "it, clipped for the most part in one of both,"
        reason = f"only {100 * agreeing:.0f} % of {where} agrees with the reference"
    verdict = Judged(reason, aligned.motion, aligned.gain, aligned.error, share, sharpness)
    return verdict, None if reason else Kept(frame, aligned.motion, agrees)


def misfit(frame: Mosaic, reference: Mosaic) -> str:
    """Why two shots are not of one burst; "" if they may be. Codes may differ, as long as the scene
    units are the same.
    """
    if frame.shape != reference.shape:
        sides = "has {1} x {0} pixels, the reference {3} x {2}"
        return sides.format(*frame.shape, *reference.shape)
    if frame.pattern != reference.pattern:
        return "has another filter pattern than the reference"
    own, other = frame.calibration, reference.calibration
    if own.channels != other.channels or not np.allclose(own.gamma, other.gamma, rtol=1e-3):
        differ = "its channels, or their weights (gamma), are not those of the reference"
        return f"was taken with another camera: {differ}"
    return ""


def emptiness(frame: View) -> str:
    """Why a frame shows nothing; "" if it shows something."""
    if (share := float((frame.luminance >= CLIPPED * frame.limit).mean())) > _GONE:
        return f"is overexposed: {100 * share:.0f} % of it is clipped"
    sigma = frame.noise.sigma(0)
    is_dark = frame.luminance.mean(dtype=np.float64) <= _DARK * sigma
    if is_dark and (frame.luminance > _BRIGHTER * sigma).mean() <= _STARS:
        return "is black: there is no light beyond noise"
    return ""


def candidates_of(frames: Sequence[View]) -> list[int]:
    """The frames that may be the reference, the best first: neither clipped nor dark, and sharp; of
    frames that tie, the first.
    """
    usable, sharpness = np.zeros((2, len(frames)))
    for number, frame in enumerate(frames):
        plane = frame.luminance
        usable[number] = ((plane < CLIPPED * frame.limit) & (plane > frame.noise.sigma(0))).mean()
        power, of_noise = _detail(frame, np.ones(frame.luminance.shape, bool))
        amplitude = float(np.maximum(power - of_noise, 0).mean()) ** 0.5
        level = max(float(plane.mean(dtype=np.float64)), frame.noise.sigma(0), TINY)
        sharpness[number] = 0 if emptiness(frame) else amplitude / level
    sharp = sharpness >= _BLURRED * np.median(sharpness)
    left, chosen = np.ones(len(frames), bool), list[int]()
    while left.any() and len(chosen) < max(_CANDIDATES, (len(frames) + 1) // 2):
        good = left & sharp if (left & sharp).any() else left
        good = good & (usable >= usable[good].max() - _ALIKE)
        good = good & (sharpness >= _AS_SHARP * sharpness[good].max())
        chosen.append(int(np.argmax(good)))
        left[chosen[-1]] = False
    return chosen


def _detail(view: View, visible: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Power of fine detail in windows, and how much of it noise accounts for, (rows, columns) each;
    0 where not all is visible.
    """
    fine = smoothed(view.luminance, _FINE) - smoothed(view.luminance, _COARSE)
    whole, coarse = _window_means(visible) == 1, gaussian(_COARSE).astype(np.float64)
    taps = np.pad(gaussian(_FINE).astype(np.float64), (len(coarse) - len(gaussian(_FINE))) // 2)
    # share of white noise that is left
    of_noise = np.float32(np.square(np.outer(taps, taps) - np.outer(coarse, coarse)).sum())
    noise = of_noise * _window_means(view.variance(view.luminance)) * whole
    return _window_means(np.square(fine)) * whole, noise


def _sharpness(reference: View, frame: View, visible: BoolArray) -> float:
    """Amplitude of the frame's fine detail relative to the reference's: the median over windows,
    which count by it.
    """
    (own, own_noise), (other, other_noise) = (_detail(view, visible) for view in (reference, frame))
    clear = own - own_noise > _DETAIL * np.maximum(own_noise, other_noise) + TINY
    if not clear.any():
        return 1.0  # no window shows it
    weights = np.sqrt((own - own_noise)[clear])
    ratio = np.sqrt(np.maximum(other - other_noise, 0)[clear]) / weights
    return float(np.quantile(ratio, 0.5, weights=weights, method="inverted_cdf"))


def _unevenness(reference: View, frame: View, visible: BoolArray) -> float:
    """Difference of the luminance of a quarter of the windows from what the exposure explains, a
    fraction of it.
    """
    planes = visible, reference.luminance, frame.luminance
    share, own, other = (_window_means(plane * visible) for plane in planes)
    lit = (share > 0.5) & (own > _LIT * reference.noise.sigma(0) * share) & (other > 0)
    if not lit.any():
        return 0.0
    ratio = np.log(other[lit] / own[lit])
    return float(np.expm1(np.quantile(np.abs(ratio - np.median(ratio)), 0.75)))


def _window_means(plane: FloatArray | BoolArray) -> FloatArray:
    """Means of whole windows of 32 x 32 pixels; of all of a plane that is smaller."""
    size = min(_WINDOW, *plane.shape)
    rows, columns = (count // size * size for count in plane.shape)
    cut = plane[:rows, :columns].reshape(rows // size, size, columns // size, size)
    return cut.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def view_of(mosaic: Mosaic, noise: NoiseModel | None, settings: RenderSettings) -> View:
    """A frame as it is compared and merged."""
    frame = mend_frame(mosaic, noise, settings)
    luminance = recover_luminance(frame.mosaic, settings.luminance)
    colours, every = frame.sites.of(frame.signal), slice(0, frame.sites.shape[0])
    gains = frame.colour_gains(every, frame.sites.channels).astype(np.float32)
    none = NoiseModel.gaussian(0.0, len(mosaic.pattern.channels) + 1)
    return View(luminance, frame.noise or none, frame.clipping, colours, gains)
