"""All frames of a burst compared with one of them, and which one that is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import ByteArray, FloatArray
from shared.mosaic import Mosaic
from shared.motion import Motion
from shared.progress import SILENT, Progress

from ..blocks import BlockSums
from ..cleaned import Cleaned, unclipped_blocks
from ..render import restored
from ..settings import RenderSettings
from ..whole.luminance import recover_luminance
from .agreement import unclipped
from .colour_doubts import block_colours
from .frames import Frame, mended, prepared
from .judging import Judged, judged, misfit

_CANDIDATES = 3  # frames that are tried as the reference
_ALIKE = 0.02  # of all pixels: frames whose usable ones differ by less are told apart by their sharpness
_BLURRED = 0.7  # of the median sharpness: below it a frame is no reference if another one is
_AS_SHARP = 0.95  # of the greatest sharpness: of such frames the first is taken
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Comparison:
    """A reference, and what the other frames are to it.

    reference: its index.
    cleaned: it, defects mended and highlights restored.
    frames: what became of each frame, in the order given.
    kept: the reference and the frames that are used, each with its motion and gain.
    trusts: how far each of these agrees with the reference, 0 to 255, uint8 (H, W) each.
    lost: where the reference has lost light that no other frame has seen, uint8 (H, W), see `Progress.lost`; None = nowhere.
    """

    reference: int
    cleaned: Cleaned
    frames: tuple[Judged, ...]
    kept: list[tuple[Frame, Motion, float]]
    trusts: list[ByteArray]
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
    frames = [prepared(shot, settings, progress) for shot in shots]
    found: list[Comparison] = []
    for candidate in _candidates(frames) if reference is None else [reference]:
        found.append(_with(candidate, shots, frames, settings, progress, motions))
        if 2 * len(found[-1].kept) > len(shots):
            break
    return max(found, key=lambda each: len(each.kept))


def _candidates(frames: Sequence[Frame]) -> list[int]:
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
    reference = shots[number]
    cleaned = restored(mended(reference, settings, progress), settings, SILENT)
    base = replace(frames[number], luminance=recover_luminance(cleaned.mosaic, settings.luminance))
    colours = block_colours(base, reference, 1.0)
    everything: list[Judged] = []
    kept, trusts = [(base, Motion(), 1.0)], [np.full(reference.shape, 255, np.uint8)]
    progress.stage("aligning", len(frames))
    for index, frame in enumerate(frames):
        progress.advance()
        if index == number:
            everything.append(Judged(True, motion=Motion()))
            continue
        if reason := misfit(shots[index], reference):
            everything.append(Judged(False, reason))
            continue
        result, agrees = judged(base, colours, frame, reference, None if motions is None else motions[index])
        everything.append(result)
        if result.used and result.motion is not None:
            kept.append((frame, result.motion, result.gain))
            trusts.append(agrees)
    trusts[0] = _own_trust(base, trusts)
    lost = None if cleaned.lost is None else np.minimum(cleaned.lost, trusts[0])
    return Comparison(number, cleaned, tuple(everything), kept, trusts, lost)


def _own_trust(base: Frame, trusts: list[ByteArray]) -> ByteArray:
    """The trust in the reference: all, but where it is clipped and another frame is not."""
    if len(trusts) == 1 or not np.isfinite(base.limit):
        return trusts[0]
    gone, others = 1 - unclipped(base.luminance, base.limit), trusts[1]
    for each in trusts[2:]:
        others = np.maximum(others, each)
    own: ByteArray = (255 - np.rint(gone * others)).astype(np.uint8)
    return own


def relit_sites(frame: Cleaned, luminance: FloatArray, sums: BlockSums) -> Cleaned:
    """The reference with saturated colour samples replaced by what other frames saw around their blocks.

    luminance: merged, (H, W). sums: of the other frames (`ColourSamples.block_sums`).
    """
    if unclipped_blocks(frame).all():
        return frame
    signal = frame.signal.copy()
    for channel, place in zip(frame.sites.channels, frame.sites.places, strict=True):
        power, product = sums.weight[..., channel], sums.product[..., channel]
        known = (power > _TINY) & (signal[place] >= frame.clipping)
        share = product / np.where(known, power, 1)
        signal[place] = np.where(known, share * luminance[place], signal[place])
    return frame.with_samples(signal)
