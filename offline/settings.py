"""The settings of each stage, in order of execution, and the presets."""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from shared.errors import InputError

_LARGEST = 32  # pixels: side of a DCT block
_FARTHEST = 16  # pixels: radius of non-local means
_WIDEST = 64  # blocks: radius of pooling


def _require(holds: bool, name: str, value: object, expected: str) -> None:
    if not holds:
        raise InputError(f"settings: {name} is {value}, expected {expected}")


@dataclass(frozen=True)
class DefectSettings:
    """Samples that do not measure light.

    An unlisted panchromatic sample is defective if it lies outside its neighbours' range by more than contrast x local contrast +
    deviations x noise sigma + floor. Colour samples are judged by their blocks, with the same settings.

    listed: replace the samples in the calibration's list of defects.
    contrast: multiple of the local contrast, 0 or more; 0 = look for no unlisted defects.
    deviations: standard deviations of the noise, where it is known, 0 or more.
    floor: scene units, > 0.
    """

    listed: bool = False
    contrast: float = 0.0
    deviations: float = 6.0
    floor: float = 0.02

    def __post_init__(self) -> None:
        _require(self.contrast >= 0, "defects.contrast", self.contrast, "0 or more")
        _require(self.deviations >= 0, "defects.deviations", self.deviations, "0 or more")
        _require(self.floor > 0, "defects.floor", self.floor, "more than 0")


@dataclass(frozen=True)
class HighlightSettings:
    """Panchromatic samples at the sensor's limit.

    restored: take luminance there from the colour samples.
    shoulder: the uppermost fraction of the colour samples' own range, in which they gradually count as clipped, 0 to 1.
    """

    restored: bool = False
    shoulder: float = 0.05

    def __post_init__(self) -> None:
        _require(0 < self.shoulder < 1, "highlights.shoulder", self.shoulder, "between 0 and 1")


@dataclass(frozen=True)
class LuminanceSettings:
    """Hole filling, Eqs. 1-5.

    iterations: 50 in the paper.
    decay: beta, 2^(-1/4) in the paper.
    threshold: shrinkage at the first iteration, scene units (beta^0 = 1 in the paper, whose intensities are scene units too). It is
        larger in frames brighter than 3 scene units: half of what they exceed 1 by.
    """

    iterations: int = 50
    decay: float = 2**-0.25
    threshold: float = 1.0

    def __post_init__(self) -> None:
        _require(self.iterations >= 1, "luminance.iterations", self.iterations, "1 or more")
        _require(0 < self.decay < 1, "luminance.decay", self.decay, "between 0 and 1")
        _require(self.threshold > 0, "luminance.threshold", self.threshold, "more than 0")


@dataclass(frozen=True)
class NoiseSettings:
    """Where the noise model comes from.

    estimate: estimate it from the mosaic where the calibration has none. If not set, unknown noise is treated as none (the paper).
    """

    estimate: bool = False


@dataclass(frozen=True)
class DenoisingSettings:
    """Denoising of luminance; the paper has none.

    strength: how much noise to remove, as a multiple of the noise there is; 0 = none.
    sizes: sides of the DCT blocks, pixels, multiples of 4.
    threshold: threshold of the first pass, in standard deviations of the noise.
    share: weight of non-local means in the result, 0 to 1.
    similarity: how much surroundings may differ in non-local means, in standard deviations of the noise.
    radius: radius of the window of non-local means, pixels.
    """

    strength: float = 0.0
    sizes: tuple[int, ...] = (4, 8, 12)
    threshold: float = 2.5
    share: float = 0.3
    similarity: float = 0.65
    radius: int = 7

    def __post_init__(self) -> None:
        _require(self.strength >= 0, "denoising.strength", self.strength, "0 or more")
        whole = bool(self.sizes) and all(4 <= size <= _LARGEST and size % 4 == 0 for size in self.sizes)
        _require(whole, "denoising.sizes", self.sizes, f"one or more multiples of 4 up to {_LARGEST}")
        _require(self.threshold > 0, "denoising.threshold", self.threshold, "more than 0")
        _require(0 <= self.share <= 1, "denoising.share", self.share, "0 to 1")
        _require(self.similarity > 0, "denoising.similarity", self.similarity, "more than 0")
        _require(1 <= self.radius <= _FARTHEST, "denoising.radius", self.radius, f"1 to {_FARTHEST}")


@dataclass(frozen=True)
class ChromaticitySettings:
    """Block chromaticities, Eqs. 6-9, and the oriented medians after them.

    taps: length of the 1-D medians, odd; 5 in the paper, 1 = no medians.
    repetitions: largest number of repetitions of the medians ("till convergence" in the paper).
    trust: how much detail that the medians removed is returned where blocks add up to their luminance (see `detail`); 0 = none.
    mismatch: variance of the samples of a block that one chromaticity does not explain, relative to that from errors of filled
        luminance, which are solved for together with chromaticity (see `sites`); 0 = Eqs. 8-9 as they are.
    """

    taps: int = 5
    repetitions: int = 20
    trust: float = 0.0
    mismatch: float = 0.0

    def __post_init__(self) -> None:
        _require(self.taps >= 1 and self.taps % 2 == 1, "chromaticity.taps", self.taps, "an odd number")
        _require(self.repetitions >= 0, "chromaticity.repetitions", self.repetitions, "0 or more")
        _require(0 <= self.trust < math.inf, "chromaticity.trust", self.trust, "0 or more")
        _require(0 <= self.mismatch < math.inf, "chromaticity.mismatch", self.mismatch, "0 or more")


class PoolingPass(NamedTuple):
    """One pass of pooling.

    blur: standard deviation of the Gaussian that smooths the chromaticities compared, blocks, 0 or more.
    tolerance: squared difference that chromaticities may have, as a multiple of its variance from noise, > 0.
    radius: radius of the window, blocks.
    """

    blur: float
    tolerance: float
    radius: int


@dataclass(frozen=True)
class PoolingSettings:
    """Averaging of the sums of Eqs. 8-9 over blocks of similar chromaticity; the paper has none.

    passes: one `PoolingPass` each; empty = no pooling.
    light: how much the luminance of blocks may differ: standard deviation of the Gaussian weight of log luminance, > 0.
    doubt: error of filled luminance, as a multiple of its curvature there, 0 or more.
    """

    passes: tuple[PoolingPass, ...] = ()
    light: float = 0.3
    doubt: float = 0.3

    def __post_init__(self) -> None:
        allowed = all(len(each) == 3 and each[0] >= 0 and each[1] > 0 and 1 <= each[2] <= _WIDEST for each in self.passes)
        expected = f"for each pass a blur, 0 or more, a tolerance, more than 0, and a radius, 1 to {_WIDEST}"
        _require(allowed, "pooling.passes", self.passes, expected)
        _require(self.light > 0, "pooling.light", self.light, "more than 0")
        _require(self.doubt >= 0, "pooling.doubt", self.doubt, "0 or more")


@dataclass(frozen=True)
class AffinitySettings:
    """Affinity maps, Eqs. 11-13.

    scales: standard deviations of the derivative filters, pixels (the paper gives none: errata).
    tolerance: residual of conjugate gradients relative to the right-hand side, 0 to 1.
    iterations: largest number of iterations.
    """

    scales: tuple[float, ...] = (0.5, 1.0)
    tolerance: float = 1e-3
    iterations: int = 500

    def __post_init__(self) -> None:
        _require(bool(self.scales) and min(self.scales) > 0, "affinity.scales", self.scales, "one or more positive scales")
        _require(0 < self.tolerance < 1, "affinity.tolerance", self.tolerance, "between 0 and 1")
        _require(self.iterations >= 1, "affinity.iterations", self.iterations, "1 or more")


@dataclass(frozen=True)
class PropagationSettings:
    """Mixing the chromaticities of the four blocks around a pixel, Eqs. 10 and 14.

    softness: a block's weight is alpha (alpha + softness) where the paper has alpha^2. Larger values make gradients of colour
        smoother, and rely less on edges. 0 or more.
    """

    softness: float = 0.0

    def __post_init__(self) -> None:
        _require(0 <= self.softness < math.inf, "propagation.softness", self.softness, "0 or more")


@dataclass(frozen=True)
class RefinementSettings:
    """Non-local averaging of chromaticity, Eqs. 15-16.

    strength: lambda in h = lambda sigma_z, 40 in the paper.
    floor: the least h, scene units, > 0; it makes sigma_z = 0 defined and the average harmless there.
    blur: standard deviation of G in periods (K/8 in the paper).
    repetitions: 0 or more ("multiple times" in the paper).
    """

    strength: float = 40.0
    floor: float = 1e-3
    blur: float = 1 / 8
    repetitions: int = 2

    def __post_init__(self) -> None:
        _require(self.strength >= 0, "refinement.strength", self.strength, "0 or more")
        _require(self.floor > 0, "refinement.floor", self.floor, "more than 0")
        _require(self.blur > 0, "refinement.blur", self.blur, "more than 0")
        _require(self.repetitions >= 0, "refinement.repetitions", self.repetitions, "0 or more")


@dataclass(frozen=True)
class SiteSettings:
    """Errors at the colour sites, where samples say what is missed (see `sites` and `trust`); the paper has none of it.

    corrected: correct luminance once chromaticity is known, and every channel once the picture is; trust no block whose samples do
        not add up to luminance.
    deviations: multiple of the noise variance that is taken off the power of errors, 0 or more.
    agreement: how far the samples of a block may differ from luminance, relative to it, before half of its chromaticity is that of
        its neighbours, > 0.
    """

    corrected: bool = False
    deviations: float = 2.0
    agreement: float = 0.4

    def __post_init__(self) -> None:
        _require(self.deviations >= 0, "sites.deviations", self.deviations, "0 or more")
        _require(self.agreement > 0, "sites.agreement", self.agreement, "more than 0")


@dataclass(frozen=True)
class LearnedSettings:
    """Correction of chromaticity by a network that has seen photographs (see `learned`); the paper has none.

    used: use it where there is one for the pattern.
    """

    used: bool = False


@dataclass(frozen=True)
class RenderSettings:
    """All settings of a render, one part per stage, in order of execution. The presets are `PAPER` and `BEST`.

    >>> from dataclasses import replace
    >>> from offline import BEST, PAPER
    >>> sharp = replace(BEST, denoising=replace(BEST.denoising, strength=0.5))
    >>> sharp.denoising.strength, PAPER.luminance.iterations
    (0.5, 50)
    """

    noise: NoiseSettings = field(default_factory=NoiseSettings)
    defects: DefectSettings = field(default_factory=DefectSettings)
    highlights: HighlightSettings = field(default_factory=HighlightSettings)
    luminance: LuminanceSettings = field(default_factory=LuminanceSettings)
    denoising: DenoisingSettings = field(default_factory=DenoisingSettings)
    chromaticity: ChromaticitySettings = field(default_factory=ChromaticitySettings)
    pooling: PoolingSettings = field(default_factory=PoolingSettings)
    affinity: AffinitySettings = field(default_factory=AffinitySettings)
    propagation: PropagationSettings = field(default_factory=PropagationSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    sites: SiteSettings = field(default_factory=SiteSettings)
    learned: LearnedSettings = field(default_factory=LearnedSettings)

    @property
    def asks_for_codes(self) -> bool:
        """Whether it matters which samples are saturated.

        If not, `Mosaic.in_scene_units` renders to the same picture, unless the lens has lateral chromatic aberration.
        """
        defects = self.defects.listed or self.defects.contrast > 0
        return defects or self.highlights.restored or self.asks_for_sites

    @property
    def asks_for_sites(self) -> bool:
        """Whether a stage works on the samples at the colour sites after colour has been spread."""
        return self.sites.corrected or self.learned.used


PAPER = RenderSettings()
BEST = RenderSettings(
    noise=NoiseSettings(estimate=True),
    defects=DefectSettings(listed=True, contrast=5.0),
    highlights=HighlightSettings(restored=True),
    luminance=LuminanceSettings(threshold=8.0, iterations=62),  # restored highlights exceed 1: the start is further off
    denoising=DenoisingSettings(strength=1.0),
    chromaticity=ChromaticitySettings(trust=3.0, mismatch=0.5),
    pooling=PoolingSettings(passes=(PoolingPass(0.7, 0.3, 10), PoolingPass(0.4, 0.12, 10), PoolingPass(0.3, 0.05, 20))),
    propagation=PropagationSettings(softness=0.25),
    refinement=RefinementSettings(repetitions=0),  # from chromaticities without noise it would only remove detail
    sites=SiteSettings(corrected=True),
    learned=LearnedSettings(used=True),
)
PRESETS = {"best": BEST, "unlearned": replace(BEST, learned=PAPER.learned), "paper": PAPER}
"""The presets by name; unlearned is best without the network that corrects colour."""
