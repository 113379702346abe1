"""Find the copies in a burst, choose its reference, and judge whether each frame fits it, and how far it agrees at each pixel."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import BoolArray, ByteArray, FloatArray
from shared.errors import InputError
from shared.mosaic import Mosaic
from shared.progress import SILENT, Progress

from ..cleaned import Cleaned
from ..render import restored
from ..settings import RenderSettings
from ..stages.luminance import recover_luminance
from .agreement import BlockColours, agreement, agreement_of, block_colours, colour_change, on_pixels, unclipped
from .alignment import align
from .frames import TINY, Frame, View, displaced, noise_models, prepared, tile_means
from .motion import Motion

# Chosen: what refuses a frame lies between the frames that tests/offline/burst/test_robustness.py keeps and those that it refuses.
_LEAST_AGREEMENT = 0.2  # share of the frame
_LEAST_SHARPNESS = 0.85  # of the reference's detail; noise and aliasing leave 0.98 or more of it
_DETAIL = 0.5  # of what noise accounts for: tiles with less detail beyond noise do not show sharpness
_UNEVEN = 0.12  # a quarter of the tiles brighter or darker by this share than the middle: light from elsewhere
_LIT = 5.0  # standard deviations of the noise, above which a pixel counts when light is compared
_STRIP = 256
# Chosen: they decide between frames that would do.
_CANDIDATES = 4  # frames that are tried as the reference
_ALIKE = 0.02  # of all pixels: of frames whose usable pixels differ by less, the sharper one is preferred
_BLURRED = 0.7  # of the median sharpness: below it a frame is no reference if another one is
_AS_SHARP = 0.95  # of the greatest sharpness: of such frames the first is taken


@dataclass(frozen=True, eq=False)
class Judged:
    """What became of one frame.

    reason: why it is not part of the picture; "" if it is.
    copy_of: index of the frame that it is a copy of; None = of none.
    motion: how it lies against the reference; None = unknown.
    gain: how many times as bright it is as the reference.
    error: estimated error of the motion, pixels.
    agreement: share of the frame that agrees with the reference, 0 to 1.
    sharpness: amplitude of its fine detail, relative to the reference's at the same places.
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
        """Whether it is part of the picture."""
        return not self.reason


@dataclass(frozen=True, eq=False)
class Kept:
    """A frame that is merged.

    frame: in units of the reference. motion: how it lies against the reference.
    agreement: with the reference at each pixel, 0 to 255, uint8 (H, W).
    """

    frame: Frame
    motion: Motion
    agreement: ByteArray


@dataclass(frozen=True, eq=False)
class Reference:
    """The frame that others are compared with.

    colours: of its blocks.
    """

    shot: Mosaic
    frame: Frame
    colours: BlockColours

    def judge(self, shot: Mosaic, frame: Frame, motion: Motion | None) -> tuple[Judged, Kept | None]:
        """What to make of a frame, and what is merged of it; None = nothing. motion: how it lies against this one, where known."""
        if reason := misfit(shot, self.shot) or frame.empty:
            return Judged(reason, motion), None
        judged = Judged(motion=motion)
        if motion is None:
            try:
                aligned = align(self.frame, frame)
            except InputError as error:
                return Judged(str(error)), None
            motion, judged = aligned.motion, Judged(motion=aligned.motion, gain=aligned.gain, error=aligned.error)
        frame = frame.in_units_of_reference(judged.gain)
        light = displaced(frame.luminance, motion)
        seen = np.isfinite(light) & (light < frame.limit) & (self.frame.luminance < self.frame.limit)
        both = View(np.where(seen, light, self.frame.luminance), frame.noise, frame.limit)
        judged = replace(judged, sharpness=_sharpness(self.frame, both, seen))
        if judged.sharpness < _LEAST_SHARPNESS:
            share = f"{100 * judged.sharpness:.0f} % of the reference's detail, at least {100 * _LEAST_SHARPNESS:.0f} %"
            return replace(judged, reason=f"is out of focus or shaken: {share} must be there"), None
        if (uneven := _unevenness(self.frame, both, seen)) > _UNEVEN:
            return replace(judged, reason=f"is lit differently (a flash?): by {100 * uneven:.0f} % over the frame"), None
        agrees = self._agreement(frame, light, motion)
        judged = replace(judged, agreement=float(agrees.mean()) / 255)
        if judged.agreement < _LEAST_AGREEMENT:
            return replace(judged, reason=f"only {100 * judged.agreement:.0f} % of it agrees with the reference"), None
        return judged, Kept(frame, motion, agrees)

    def _agreement(self, frame: Frame, light: FloatArray, motion: Motion) -> ByteArray:
        """Return how far a frame agrees, by luminance and by the colours of its blocks. light: as the reference would see it."""
        mask = self.shot.pattern.panchromatic_mask(light.shape).astype(np.float32)
        measured = np.square(np.nan_to_num(displaced(mask, motion)).clip(0, 1)) * mask
        agrees = agreement(self.frame, View(light, frame.noise, frame.limit), measured)
        deviation = colour_change(self.colours, frame, motion, self.shot)
        for top in range(0, len(light), _STRIP):
            rows = slice(top, min(top + _STRIP, len(light)))
            agrees[rows] = np.rint(agrees[rows] * agreement_of(on_pixels(deviation, motion, self.shot, rows)))
        return agrees


def copies(frames: Sequence[Mosaic], reference: int | None = None) -> dict[int, int]:
    """The index of each frame whose samples are those of another one, and that of the frame which stays: the first of them.

    Their noise is the same, and does not fall when they are merged.

    frames: of any cameras and sizes. reference: index of a frame that stays, whatever it is a copy of; None = of any.

    >>> import numpy as np
    >>> from offline.burst import copies
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> one, other = (np.random.default_rng(seed).integers(5000, 6000, (24, 36), np.uint16) for seed in (1, 2))
    >>> copies([Mosaic(codes, CfaPattern.bayer(6), SensorCalibration()) for codes in (one, other, one.copy())])
    {2: 0}
    """
    copied: dict[int, int] = {}
    originals: dict[object, int] = {}
    for number in sorted(range(len(frames)), key=lambda index: index != reference):
        samples, pattern = np.ascontiguousarray(frames[number].samples), frames[number].pattern
        content = pattern, samples.shape, samples.dtype.str, hashlib.sha256(samples.data).digest()
        original = originals.setdefault(content, number)
        if original != number:
            copied[number] = original
    return copied


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


def _sharpness(reference: View, frame: View, seen: BoolArray) -> float:
    """Amplitude of the frame's fine detail relative to the reference's: the median over tiles, which count by it."""
    (own, own_noise), (other, other_noise) = (view.detail(seen) for view in (reference, frame))
    clear = own - own_noise > _DETAIL * np.maximum(own_noise, other_noise) + TINY
    if not clear.any():
        return 1.0  # no tile shows it
    ratio = np.sqrt(np.maximum(other - other_noise, 0)[clear] / (own - own_noise)[clear])
    weights = np.sqrt((own - own_noise)[clear])
    return float(np.quantile(ratio, 0.5, weights=weights, method="inverted_cdf"))


def _unevenness(reference: View, frame: View, seen: BoolArray) -> float:
    """How far the light of a quarter of the tiles differs from what the exposure explains, a share of it."""
    floor = _LIT * reference.noise.sigma(0.0) if reference.noise else 0.0
    share, own, other = tile_means(seen), tile_means(reference.luminance * seen), tile_means(frame.luminance * seen)
    lit = (share > 0.5) & (own > floor * share) & (other > 0)
    if not lit.any():
        return 0.0
    ratio = np.log(other[lit] / own[lit])
    return float(np.expm1(np.quantile(np.abs(ratio - np.median(ratio)), 0.75)))


@dataclass(frozen=True, eq=False)
class Comparison:
    """The reference of a burst, and how the other frames compare with it.

    reference: its index.
    cleaned: its samples, defects mended and highlights restored.
    frames: what became of each frame, in the order given.
    kept: the reference and the frames that are used.
    lost: where the reference has lost light that no other frame has seen, uint8 (H, W), see `Cleaned`; None = nowhere.
    """

    reference: int
    cleaned: Cleaned
    frames: list[Judged]
    kept: list[Kept]
    lost: ByteArray | None


def compared(
    shots: Sequence[Mosaic],
    settings: RenderSettings,
    progress: Progress,
    reference: int | None,
    motions: Sequence[Motion] | None,
) -> Comparison:
    """Compare all frames with the reference: the one that is named, or the best that most others agree with.

    motions: where the reference's points lie in each frame, if that is known.
    """
    models = noise_models(shots, settings.noise)
    frames = [prepared(shot, model, settings, progress) for shot, model in zip(shots, models, strict=True)]
    candidates = candidates_of(frames) if reference is None else [reference]
    frames = [frame if number in candidates else replace(frame, cleaned=None) for number, frame in enumerate(frames)]
    found: list[Comparison] = []
    for candidate in candidates:
        progress.stage("aligning", len(frames))
        found.append(_with(candidate, shots, frames, settings, progress, motions))
        if 2 * len(found[-1].kept) > len(shots):
            break
    return max(found, key=lambda each: len(each.kept))


def candidates_of(frames: Sequence[Frame]) -> list[int]:
    """The frames that may be the reference, the best first: neither clipped nor dark, and sharp; of frames that tie, the first."""
    sharpness = np.array([0.0 if frame.empty else frame.sharpness for frame in frames])
    usable = np.array([frame.usable for frame in frames])
    sharp = sharpness >= _BLURRED * np.median(sharpness)
    left, chosen = np.ones(len(frames), bool), list[int]()
    while left.any() and len(chosen) < _CANDIDATES:
        good = left & sharp if (left & sharp).any() else left
        good = good & (usable >= usable[good].max() - _ALIKE)
        good = good & (sharpness >= _AS_SHARP * sharpness[good].max())
        chosen.append(int(np.argmax(good)))
        left[chosen[-1]] = False
    return chosen


def _with(
    number: int,
    shots: Sequence[Mosaic],
    frames: Sequence[Frame],
    settings: RenderSettings,
    progress: Progress,
    motions: Sequence[Motion] | None,
) -> Comparison:
    """Compare all frames with one of them."""
    frame = frames[number]
    if frame.cleaned is None:
        raise RuntimeError("the samples of this frame are not kept")
    cleaned = restored(frame.cleaned, settings, SILENT)
    base = replace(frame, luminance=recover_luminance(cleaned.mosaic, settings.luminance), cleaned=None)
    reference = Reference(shots[number], base, block_colours(base, shots[number]))
    everything: list[Judged] = []
    kept = [Kept(base, Motion(), np.full(shots[number].shape, 255, np.uint8))]
    for index, (shot, other) in enumerate(zip(shots, frames, strict=True)):
        progress.advance()
        if index == number:
            everything.append(Judged(motion=Motion()))
            continue
        judged, merged = reference.judge(shot, other, motions[index] if motions else None)
        everything.append(judged)
        kept += [merged] if merged else []
    own = _own_agreement(base, [each.agreement for each in kept])
    kept[0] = replace(kept[0], agreement=own)
    lost = None if cleaned.lost is None else np.minimum(cleaned.lost, own)
    return Comparison(number, cleaned, everything, kept, lost)


def _own_agreement(base: View, agreements: list[ByteArray]) -> ByteArray:
    """How far the reference counts: in full, but where it is clipped and another frame is not. agreements: its own first."""
    if len(agreements) == 1 or not np.isfinite(base.limit):
        return agreements[0]
    others = agreements[1]
    for each in agreements[2:]:
        others = np.maximum(others, each)
    return (255 - np.rint((1 - unclipped(base)) * others)).astype(np.uint8)
