"""The settings of each stage, in order of execution, and the presets."""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from .stage_settings import (
    ALL_TRUSTED,
    NO_LINES,
    NOT_SETTLED,
    OFF,
    LineSettings,
    SettlingSettings,
    StageSettings,
    Switch,
    TrustSettings,
    require,
)

# Accepted at most, for time and memory: side of a DCT block and radius of non-local means, pixels; radius of pooling, blocks.
_LARGEST, _FARTHEST, _WIDEST = 32, 16, 64


@dataclass(frozen=True)
class DefectSettings(StageSettings):
    """Samples that do not measure light.

    An unlisted panchromatic sample is defective if it lies outside its neighbours' range by more than contrast x local contrast +
    deviations x noise sigma + floor x mean panchromatic sample. Colour samples are judged by their blocks, with the same settings.

    listed: replace the samples in the calibration's list of defects.
    contrast: multiple of the local contrast, 0 or more; 0 = look for no unlisted defects.
    deviations, floor: multiples of the noise, where it is known, 0 or more; and of the mean panchromatic sample, > 0.
    """

    kernels = "find_outliers", "mend_panchromatic", "surroundings"

    listed: bool = False
    contrast: float = 0.0
    deviations: float = 6.0
    floor: float = 0.04

    def __post_init__(self) -> None:
        require(self.contrast >= 0, "defects.contrast", self.contrast, "0 or more")
        require(self.deviations >= 0, "defects.deviations", self.deviations, "0 or more")
        require(self.floor > 0, "defects.floor", self.floor, "more than 0")

    @property
    def used(self) -> bool:
        """Whether the stage changes anything."""
        return self.listed or self.contrast > 0


@dataclass(frozen=True)
class HighlightSettings(StageSettings):
    """Panchromatic samples at the sensor's limit.

    restored: take luminance there from the colour samples.
    shoulder: the uppermost fraction of the colour samples' own range, in which they gradually count as clipped, 0 to 1.
    """

    kernels = "surroundings", "raise_clipped", "interpolate"

    restored: bool = False
    shoulder: float = 0.05

    def __post_init__(self) -> None:
        require(0 < self.shoulder < 1, "highlights.shoulder", self.shoulder, "between 0 and 1")

    @property
    def used(self) -> bool:
        """Whether the stage changes anything."""
        return self.restored


@dataclass(frozen=True)
class LuminanceSettings(StageSettings):
    """Hole filling, Eqs. 1-5.

    iterations: 50 in the paper.
    decay: beta, 2^(-1/4) in the paper.
    threshold: shrinkage at the first iteration, scene units (beta^0 = 1 in the paper, whose intensities are scene units too). It is
        larger in frames brighter than 3 scene units: half of what they exceed 1 by.
    relative: the threshold is a multiple of the brightest sample instead, so that the picture does not depend on the exposure.
    learned: a network that has seen photographs corrects what is filled in under blocks of 2 x 2 pixels (`whole.filling`).
    """

    kernels = "fill_blocks", "shrink_margins"

    iterations: int = 50
    decay: float = 2**-0.25
    threshold: float = 1.0
    relative: bool = False
    learned: bool = False

    def __post_init__(self) -> None:
        require(self.iterations >= 1, "luminance.iterations", self.iterations, "1 or more")
        require(0 < self.decay < 1, "luminance.decay", self.decay, "between 0 and 1")
        require(self.threshold > 0, "luminance.threshold", self.threshold, "more than 0")


@dataclass(frozen=True)
class NoiseSettings(StageSettings):
    """Where the noise model comes from.

    estimate: estimate it from the mosaic where the calibration has none. Otherwise unknown noise is treated as none (the paper).
    """

    estimate: bool = False


@dataclass(frozen=True)
class DenoisingSettings(StageSettings):
    """Denoising of luminance; the paper has none.

    strength: how much noise to remove, as a multiple of the noise there is; 0 = none.
    sizes: sides of the DCT blocks, pixels, multiples of 4.
    threshold: threshold of the first pass, in standard deviations of the noise.
    share: weight of non-local means in the result, 0 to 1.
    similarity: how much surroundings may differ in non-local means, in standard deviations of the noise.
    radius: radius of the window of non-local means, pixels.
    """

    kernels = "denoise", "average_similar"

    strength: float = 0.0
    sizes: tuple[int, ...] = (4, 8, 12)
    threshold: float = 2.5
    share: float = 0.3
    similarity: float = 0.65
    radius: int = 7

    def __post_init__(self) -> None:
        require(self.strength >= 0, "denoising.strength", self.strength, "0 or more")
        whole = bool(self.sizes) and all(4 <= size <= _LARGEST and size % 4 == 0 for size in self.sizes)
        require(whole, "denoising.sizes", self.sizes, f"one or more multiples of 4 up to {_LARGEST}")
        require(self.threshold > 0, "denoising.threshold", self.threshold, "more than 0")
        require(0 <= self.share <= 1, "denoising.share", self.share, "0 to 1")
        require(self.similarity > 0, "denoising.similarity", self.similarity, "more than 0")
        require(1 <= self.radius <= _FARTHEST, "denoising.radius", self.radius, f"1 to {_FARTHEST}")

    @property
    def used(self) -> bool:
        """Whether the stage changes anything."""
        return self.strength > 0


@dataclass(frozen=True)
class ChromaticitySettings(StageSettings):
    """Block chromaticities, Eqs. 6-9, and the oriented medians after them.

    taps: length of the 1-D medians, odd; 5 in the paper, 1 = no medians.
    repetitions: largest number of repetitions of the medians ("till convergence" in the paper).
    detail_gain: how much detail that the medians removed is returned where blocks add up to their luminance (see `detail`);
        0 = none.
    mismatch: variance of the samples of a block that one chromaticity does not explain, relative to that from errors of filled
        luminance, which are solved for together with chromaticity (see `sites`); 0 = Eqs. 8-9 as they are.
    """

    taps: int = 5
    repetitions: int = 20
    detail_gain: float = 0.0
    mismatch: float = 0.0

    def __post_init__(self) -> None:
        require(self.taps >= 1 and self.taps % 2 == 1, "chromaticity.taps", self.taps, "an odd number")
        require(self.repetitions >= 0, "chromaticity.repetitions", self.repetitions, "0 or more")
        require(0 <= self.detail_gain < math.inf, "chromaticity.detail_gain", self.detail_gain, "0 or more")
        require(0 <= self.mismatch < math.inf, "chromaticity.mismatch", self.mismatch, "0 or more")

    @property
    def kernels(self) -> tuple[str, ...]:
        """Those of the stage."""
        asked = {"oriented_median": self.taps > 1, "solve_jointly": self.mismatch > 0, "smooth": self.detail_gain > 0}
        return tuple(name for name, used in asked.items() if used)


class PoolingPass(NamedTuple):
    """One pass of pooling.

    blur: standard deviation of the Gaussian that smooths the chromaticities compared, blocks, 0 or more.
    tolerance: squared difference that chromaticities may have, as a multiple of the variance that noise has left in them, > 0.
    radius: radius of the window, blocks.
    """

    blur: float
    tolerance: float
    radius: int


@dataclass(frozen=True)
class PoolingSettings(StageSettings):
    """Averaging of the sums of Eqs. 8-9 over blocks of similar chromaticity; the paper has none.

    passes: one `PoolingPass` each; empty = no pooling.
    light: how much the luminance of blocks may differ: standard deviation of the Gaussian weight of its logarithm, less in the
        dark, > 0.
    curvature_error: error of filled luminance, as a multiple of its curvature there, 0 or more.
    """

    kernels = "pool", "smooth"

    passes: tuple[PoolingPass, ...] = ()
    light: float = 0.25
    curvature_error: float = 0.2

    def __post_init__(self) -> None:
        allowed = all(len(each) == 3 and each[0] >= 0 and each[1] > 0 and 1 <= each[2] <= _WIDEST for each in self.passes)
        expected = f"for each pass a blur, 0 or more, a tolerance, more than 0, and a radius, 1 to {_WIDEST}"
        require(allowed, "pooling.passes", self.passes, expected)
        require(self.light > 0, "pooling.light", self.light, "more than 0")
        require(self.curvature_error >= 0, "pooling.curvature_error", self.curvature_error, "0 or more")

    @property
    def used(self) -> bool:
        """Whether the stage changes anything."""
        return bool(self.passes)


@dataclass(frozen=True)
class AffinitySettings(StageSettings):
    """Affinity maps, Eqs. 11-13.

    scales: standard deviations of the derivative filters, pixels (the paper gives none: errata).
    tolerance: residual of conjugate gradients relative to the right-hand side, 0 to 1.
    iterations: largest number of iterations.
    """

    scales: tuple[float, ...] = (0.5, 1.0)
    tolerance: float = 1e-3
    iterations: int = 500

    def __post_init__(self) -> None:
        require(bool(self.scales) and min(self.scales) > 0, "affinity.scales", self.scales, "one or more positive scales")
        require(0 < self.tolerance < 1, "affinity.tolerance", self.tolerance, "between 0 and 1")
        require(self.iterations >= 1, "affinity.iterations", self.iterations, "1 or more")


@dataclass(frozen=True)
class PropagationSettings(StageSettings):
    """Mixing the chromaticities of the four blocks around a pixel, Eqs. 10 and 14.

    A block's weight is (alpha + softness)^2 l / (1 + likeness d^2), in the paper alpha^2 l, with l the luminance at the block, and
    d the difference of the pixel's from it, over their sum. More softness makes gradients of colour smoother, more likeness prefers
    blocks as bright as the pixel; both 0 or more.
    """

    softness: float = 0.0
    likeness: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require(0 <= value < math.inf, f"propagation.{name}", value, "0 or more")


@dataclass(frozen=True)
class RefinementSettings(StageSettings):
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
        require(self.strength >= 0, "refinement.strength", self.strength, "0 or more")
        require(self.floor > 0, "refinement.floor", self.floor, "more than 0")
        require(self.blur > 0, "refinement.blur", self.blur, "more than 0")
        require(self.repetitions >= 0, "refinement.repetitions", self.repetitions, "0 or more")

    @property
    def used(self) -> bool:
        """Whether the stage changes anything."""
        return self.repetitions > 0


@dataclass(frozen=True)
class RenderSettings:
    """All settings of a render, one part per stage, in order of execution. The presets are `PAPER` and `BEST`.

    Stages with a `Switch` are not in the paper: `BEST` has all of them, `PAPER` none.
    correction shares out what the picture misses at the colour sites (`rows.correction`), pinning does so where these are scattered
    (`rows.pinning`), and learned corrects chromaticity by a network that has seen photographs, where there is one for the pattern
    (`rows.learned`).

    >>> from dataclasses import replace
    >>> from offline import BEST, PAPER
    >>> sharp = replace(BEST, denoising=replace(BEST.denoising, strength=0.5))
    >>> sharp.denoising.strength, PAPER.luminance.iterations
    (0.5, 50)
    """

    noise: NoiseSettings = NoiseSettings()
    defects: DefectSettings = DefectSettings()
    trust: TrustSettings = ALL_TRUSTED
    highlights: HighlightSettings = HighlightSettings()
    luminance: LuminanceSettings = LuminanceSettings()
    denoising: DenoisingSettings = DenoisingSettings()
    chromaticity: ChromaticitySettings = ChromaticitySettings()
    pooling: PoolingSettings = PoolingSettings()
    lines: LineSettings = NO_LINES
    settling: SettlingSettings = NOT_SETTLED
    affinity: AffinitySettings = AffinitySettings()
    propagation: PropagationSettings = PropagationSettings()
    refinement: RefinementSettings = RefinementSettings()
    correction: Switch = OFF
    pinning: Switch = OFF
    learned: Switch = OFF

    @property
    def asks_for_codes(self) -> bool:
        """Whether it matters which samples are saturated.

        If not, `Mosaic.in_scene_units` renders to the same picture, unless the lens has lateral chromatic aberration.
        """
        return self.defects.used or self.highlights.used or self.asks_for_sites

    @property
    def asks_for_sites(self) -> bool:
        """Whether a switch is on: these stages look at the samples of the colour sites, or at what the picture misses there."""
        return any(each.used for each in vars(self).values() if isinstance(each, Switch))

    def switched(self, used: bool) -> "RenderSettings":
        """These settings with every `Switch` on or off."""
        switches: dict[str, Any] = {name: replace(each, used=used) for name, each in vars(self).items() if isinstance(each, Switch)}
        return replace(self, **switches)


PAPER = RenderSettings()
BEST = RenderSettings(
    noise=NoiseSettings(estimate=True),
    defects=DefectSettings(listed=True, contrast=5.0),
    highlights=HighlightSettings(restored=True),
    # The last threshold is 7e-5 of the brightest sample.
    luminance=LuminanceSettings(threshold=8 / 3, relative=True, iterations=62, learned=True),
    denoising=DenoisingSettings(strength=1.0),
    chromaticity=ChromaticitySettings(detail_gain=3.0, mismatch=0.5),
    pooling=PoolingSettings(passes=(PoolingPass(0.7, 0.3, 7), PoolingPass(0.4, 3.0, 7), PoolingPass(0.3, 1.5, 22))),
    propagation=PropagationSettings(softness=0.3, likeness=10.0),  # without likeness photographs lose 0.05 dB
    refinement=RefinementSettings(repetitions=0),  # from chromaticities without noise it would only remove detail
).switched(True)
UNLEARNED = replace(BEST, learned=PAPER.learned, luminance=replace(BEST.luminance, learned=False))
PRESETS = {"best": BEST, "unlearned": UNLEARNED, "paper": PAPER}
"""The presets by name; unlearned is best without networks."""
