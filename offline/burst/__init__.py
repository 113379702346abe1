"""A burst on one page: frames -> motions -> merged luminance and displaced colour samples -> RGB.

The tremor of a hand displaces every frame, and its colour sites with it: together they measure
colour where one frame has no sites. Luminance is merged first. Then the reference is rendered like
one frame, from the merged luminance, and with the samples of all frames in the sums of its blocks.
At the end the samples of all frames correct the picture, each at its own place.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...shared import ByteArray, FloatArray, InputError, Mosaic
from ...shared.progress import SILENT, Progress
from ..bands import RowStage
from ..frame import Frame
from ..memory import rendering_memory
from ..pipeline import colour_bands, estimate_colour, row_stages
from ..settings import BEST, RenderSettings
from ..stages.shading import ShadingCorrection
from ..units import check_frames
from .colour import ColourSamples, Spreading, averaged_sites, relit_sites, single_frame_weight
from .merge import denoised, merge_luminance, uncovered
from .motion import Motion, in_frame, in_reference
from .select import Comparison, Judged, compare_frames, copies

__all__ = ["Judged", "MergedBurst", "Motion", "burst_memory", "in_frame", "in_reference"]
__all__ += ["merge_burst", "render_burst_bands"]

# Bytes per pixel, measured at 3 and 12 megapixels and rounded up: of each frame
# (luminance, agreement, colour samples) and besides (what compares one frame with the reference).
_FRAME, _REST = 13.0, 97.0
# bytes, of each colour sample of a frame: where these are scattered they are many, otherwise those
# are in `_FRAME`
_SAMPLE = 130.0


@dataclass(frozen=True, eq=False)
class MergedBurst:
    """A burst whose frames have been merged.

    Attributes
    ----------
    reference : int
        Index of the frame that the picture shows.
    frames : tuple[Judged, ...]
        What became of each frame, in the order given.
    noise_ratio : FloatArray
        float32 (H, W), variance of the noise of the merged luminance, relative to the reference's:
        1 where it is alone.
    measured, samples : Frame, ColourSamples
        What `render_burst_bands` needs.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline.burst import merge_burst
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> codes = np.random.default_rng(0).integers(0, 400, (48, 60), np.uint16)
    >>> mosaic = Mosaic(codes, CfaPattern.bayer(6), SensorCalibration.of_bits(12))
    >>> merged = merge_burst([mosaic, mosaic], reference=0)
    >>> [frame.copy_of for frame in merged.frames], merged.noise_ratio.shape
    ([None, 0], (48, 60))
    """

    reference: int
    frames: tuple[Judged, ...]
    noise_ratio: FloatArray
    measured: Frame
    samples: ColourSamples

    @property
    def lost(self) -> ByteArray | None:
        """Pixels where all frames are clipped, uint8 (H, W), see `offline.frame.Frame`; None =
        nowhere.
        """
        return self.measured.lost


def merge_burst(
    frames: Sequence[Mosaic],
    settings: RenderSettings = BEST,
    progress: Progress = SILENT,
    *,
    reference: int | None = None,
    motions: Sequence[Motion] | None = None,
) -> MergedBurst:
    """Align and merge the frames of a burst.

    Parameters
    ----------
    frames : Sequence[Mosaic]
        Of one camera; those that do not fit the reference are left out (`Judged.reason`).
    reference : int | None, optional
        Index of the frame that the picture shall show, 0 or more; None = the best of those that
        most others agree with.
    motions : Sequence[Motion] | None, optional
        How each frame lies against the reference, which has to be named, where that is known;
        otherwise it is measured. How bright each is, is measured in any case.

    Raises
    ------
    InputError
        When there is no frame, when frames and motions differ in number, when the reference is no
        frame's index, and for samples that are not in scene units.

    Examples
    --------
    A pixel shift: the second frame's sensor was two pixels further down.

    >>> import numpy as np
    >>> from panchroma.offline.burst import Motion, merge_burst, render_burst_bands
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> scene = np.random.default_rng(0).integers(0, 400, (50, 60), np.uint16)
    >>> pattern, calibration = CfaPattern.bayer(6), SensorCalibration.of_bits(12)
    >>> frames = [Mosaic(scene[top : top + 48], pattern, calibration) for top in (0, 2)]
    >>> merged = merge_burst(frames, reference=0, motions=[Motion(), Motion((-2.0, 0.0))])
    >>> np.concatenate(list(render_burst_bands(merged))).shape
    (48, 60, 3)
    """
    if not frames or (motions is not None and len(motions) != len(frames)):
        expected = "expected one motion for each frame"
        raise InputError(f"{len(frames)} frames and {len(motions or ())} motions, {expected}")
    if (reference is not None or motions is not None) and reference not in range(len(frames)):
        expected = f"expected the index of a frame, 0 to {len(frames) - 1}"
        raise InputError(f"reference is {reference}, {expected}")
    copied = copies(frames, reference)
    distinct = [number for number in range(len(frames)) if number not in copied]
    shots = [frames[number] for number in distinct]
    check_frames(shots, settings)
    first = None if reference is None else distinct.index(reference)
    stated = [motions[number] if motions else None for number in distinct]
    comparison = compare_frames(shots, settings, progress, first, stated)
    judged = dict(zip(distinct, comparison.frames, strict=True))
    for copy, original in copied.items():
        reason = f"is a copy of frames[{original}]: its samples are the same"
        judged[copy] = Judged(reason, copy_of=original)
    progress.stage("merging", 1)
    merged = _merged(comparison, settings)
    progress.advance()
    verdicts = tuple(judged[number] for number in range(len(frames)))
    return MergedBurst(distinct[comparison.reference], verdicts, *merged)


def render_burst_bands(
    merged: MergedBurst, settings: RenderSettings = BEST, progress: Progress = SILENT
) -> Iterator[FloatArray]:
    """Yield the picture from top to bottom, as bands float32 (rows, W, C), scene units, as
    `render_bands` does.

    Raises
    ------
    ConvergenceError
        When a solver does not reach its tolerance.
    RangeError
        Rather than yield a value that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline.burst import merge_burst, render_burst_bands
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> codes = np.random.default_rng(0).integers(0, 400, (48, 60), np.uint16)
    >>> mosaic = Mosaic(codes, CfaPattern.bayer(6), SensorCalibration.of_bits(12))
    >>> sum(len(band) for band in render_burst_bands(merge_burst([mosaic])))
    48
    """

    def stages(measured: Frame, settings: RenderSettings) -> list[RowStage]:
        stages = row_stages(measured, settings)
        place = len(stages) - isinstance(stages[-1], ShadingCorrection)  # shading is undone last
        stages.insert(place, Spreading(merged.samples, measured))
        return stages

    return colour_bands(merged.measured, settings, progress, stages)


def burst_memory(frames: int, mosaic: Mosaic, settings: RenderSettings = BEST) -> int:
    """An upper estimate, in bytes, of what merging and rendering a burst needs in addition to the
    program and the mosaics.

    Parameters
    ----------
    frames : int
        Their number.
    mosaic : Mosaic
        One of them.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline.burst import burst_memory
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> mosaic = Mosaic(np.zeros((600, 900), np.uint16), CfaPattern.bayer(6), SensorCalibration())
    >>> 50e6 < burst_memory(8, mosaic) < 300e6
    True
    """
    pixels, pattern = mosaic.shape[0] * mosaic.shape[1], mosaic.pattern
    sites = len(pattern.sites) if pattern.is_scattered else 0
    frame = _FRAME + _SAMPLE * sites / pattern.period**2
    return round(frame * frames * pixels + max(_REST * pixels, rendering_memory(mosaic, settings)))


def _merged(
    comparison: Comparison, settings: RenderSettings
) -> tuple[FloatArray, Frame, ColourSamples]:
    """Merge frames that have been compared: the last three fields of `MergedBurst`."""
    cleaned, kept, sites = comparison.cleaned, comparison.kept, comparison.cleaned.sites
    fine, noise_ratio = merge_luminance(kept, sites)
    plain = np.ascontiguousarray(fine[::2, ::2])
    luminance = denoised(plain, noise_ratio, cleaned.mosaic, settings)
    samples = ColourSamples.of(kept, fine, sites).relit(luminance - plain)
    cleaned = averaged_sites(cleaned, samples)
    gaps = uncovered(kept, sites)
    samples = samples.where_others(luminance, noise_ratio, gaps)
    sums = samples.block_sums(sites) if len(kept) > 1 else None
    if sums is not None:
        cleaned = relit_sites(cleaned, luminance, sums)
    # Where the reference is not alone, others measure luminance under its sites, unless their own
    # sites lie there too: all frames of a tripod share one gap.
    single_frame = single_frame_weight(sites.of(noise_ratio).min(axis=2))
    single_frame = np.maximum(single_frame, sites.of(gaps).mean(axis=2))
    measured = estimate_colour(cleaned, luminance, settings, SILENT, sums, single_frame)
    return noise_ratio, measured, samples.relit(measured.luminance - luminance)
