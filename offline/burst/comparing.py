"""Choose the reference of a burst, and compare all frames with it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import ByteArray
from shared.mosaic import Mosaic
from shared.motion import Motion
from shared.progress import SILENT, Progress

from ..cleaned import Cleaned
from ..render import restored
from ..settings import RenderSettings
from ..whole.luminance import recover_luminance
from .agreement import unclipped
from .block_colours import block_colours
from .frames import Frame, View, noise_models, prepared
from .judging import Judged, Kept, Reference

# Chosen: they decide between frames that would do.
_CANDIDATES = 4  # frames that are tried as the reference
_ALIKE = 0.02  # of all pixels: of frames whose usable pixels differ by less, the sharper one is preferred
_BLURRED = 0.7  # of the median sharpness: below it a frame is no reference if another one is
_AS_SHARP = 0.95  # of the greatest sharpness: of such frames the first is taken


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
