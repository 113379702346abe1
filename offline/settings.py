"""The settings of each stage, in order of execution, and the presets."""

import math
from dataclasses import dataclass, field

from shared.errors import InputError

_LARGEST = 32  # pixels of a DCT block
_FARTHEST = 16  # pixels that non-local means look in every direction
_WIDEST = 64  # blocks that pooling looks in every direction


def _require(holds: bool, name: str, value: object, expected: str) -> None:
    if not holds:
        raise InputError(f"settings: {name} is {value}, expected {expected}")


@dataclass(frozen=True)
class DefectSettings:
    """Samples that do not measure light.

    listed: replace those of the calibration's list. contrast: how many times the local contrast a sample has to stand out to be
    taken for defective unlisted, 0 = none is; deviations: and how many standard deviations of the noise, where it is known;
    floor: and at least so much, scene units.
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

    restored: take luminance there from the colour samples; shoulder: the uppermost part of these samples' own range, in which what
    they say of colour fades.
    """

    restored: bool = False
    shoulder: float = 0.05

    def __post_init__(self) -> None:
        _require(0 < self.shoulder < 1, "highlights.shoulder", self.shoulder, "between 0 and 1")


@dataclass(frozen=True)
class LuminanceSettings:
    """Hole filling, Eqs. 1-5.

    iterations: 50 in the paper; decay: beta, 2^(-1/4) in the paper; threshold: the shrinkage at the first iteration, scene units
    (beta^0 = 1 in the paper, whose intensities are scene units too).
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
    """Where the noise is known from.

    estimate: from the mosaic itself where the calibration does not say; otherwise unknown noise is taken for none, as in the paper.
    """

    estimate: bool = False


@dataclass(frozen=True)
class DenoisingSettings:
    """Denoising of luminance; the paper has none.

    strength: noise taken away, as a multiple of the noise there is; 0: none. sizes: of the DCT blocks, pixels, multiples of 4;
    threshold: of the first pass, in standard deviations of the noise. share: of non-local means in the result, 0 to 1; similarity:
    how far apart surroundings may be in them, in standard deviations; radius: of their window, pixels.
    """

    strength: float = 0.0
    sizes: tuple[int, ...] = (4, 8, 12)
    threshold: float = 2.6
    share: float = 0.35
    similarity: float = 0.5
    radius: int = 8

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

    taps: length of the 1-D medians, 5 in the paper, 1 = none; repetitions: at most so many ("till convergence" in the paper).
    trust: in blocks that add up to their luminance; the more, the more detail that the medians took is given back. 0 = none.
    """

    taps: int = 5
    repetitions: int = 20
    trust: float = 0.0

    def __post_init__(self) -> None:
        _require(self.taps >= 1 and self.taps % 2 == 1, "chromaticity.taps", self.taps, "an odd number")
        _require(self.repetitions >= 0, "chromaticity.repetitions", self.repetitions, "0 or more")
        _require(0 <= self.trust < math.inf, "chromaticity.trust", self.trust, "0 or more")


@dataclass(frozen=True)
class PoolingSettings:
    """Averaging of the sums of Eqs. 8-9 over blocks of like chromaticity; the paper has none.

    passes: of each the standard deviation of the Gaussian that smooths the chromaticities compared, in blocks; how far apart they
    may be, as a multiple of the variance of their difference; and the radius of the window, in blocks. None: no pooling. light:
    how far apart in luminance, standard deviation of its natural logarithm. doubt: error of filled luminance, as a multiple of its
    curvature there.
    """

    passes: tuple[tuple[float, float, int], ...] = ()
    light: float = 0.3
    doubt: float = 0.3

    def __post_init__(self) -> None:
        allowed = all(len(each) == 3 and each[0] >= 0 and each[1] > 0 and 1 <= each[2] <= _WIDEST for each in self.passes)
        expected = f"threes of a blur, 0 or more, a tolerance, more than 0, and a radius, 1 to {_WIDEST}"
        _require(allowed, "pooling.passes", self.passes, expected)
        _require(self.light > 0, "pooling.light", self.light, "more than 0")
        _require(self.doubt >= 0, "pooling.doubt", self.doubt, "0 or more")


@dataclass(frozen=True)
class AffinitySettings:
    """Affinity maps, Eqs. 11-13.

    scales: standard deviations of the derivative filters, pixels (the paper gives none: errata). tolerance: of the
    conjugate-gradient solver, residual relative to the right-hand side; iterations: at most so many.
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

    softness: alpha (alpha + softness) is what a block weighs, where the paper has alpha^2: more of it mixes evenly shaded colours
    more evenly, and has less faith in edges.
    """

    softness: float = 0.0

    def __post_init__(self) -> None:
        _require(0 <= self.softness < math.inf, "propagation.softness", self.softness, "0 or more")


@dataclass(frozen=True)
class RefinementSettings:
    """Non-local averaging of chromaticity, Eqs. 15-16.

    strength: lambda of h = lambda sigma_z, 40 in the paper; floor: the least h, scene units, which keeps sigma_z = 0 defined and
    the average harmless; blur: standard deviation of G in periods (K/8 in the paper); repetitions: "multiple times" in the paper.
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
class RenderSettings:
    """All settings of a render, one part per stage."""

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


PAPER = RenderSettings()
BEST = RenderSettings(
    noise=NoiseSettings(estimate=True),
    defects=DefectSettings(listed=True, contrast=5.0),
    highlights=HighlightSettings(restored=True),
    luminance=LuminanceSettings(threshold=8.0, iterations=62),  # restored highlights are brighter than 1: the start is further off
    denoising=DenoisingSettings(strength=1.0),
    chromaticity=ChromaticitySettings(trust=3.0),
    pooling=PoolingSettings(passes=((0.7, 0.3, 10), (0.4, 0.12, 10), (0.3, 0.05, 20))),
    propagation=PropagationSettings(softness=0.25),
    refinement=RefinementSettings(repetitions=0),  # of chromaticities that have no noise left it takes detail alone
)
