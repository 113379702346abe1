"""The settings of each stage, in order of execution, and the presets."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

from .stage import Between, Count, CountOrNone, Finite, NotNegative, Positive, Range, StageSettings

# Accepted at most, for time and memory: side of a DCT block, pixels; radius of pooling, blocks.
_LARGEST, _WIDEST = 32, 64
_SIZES = Range(
    lambda value: bool(value) and {*value} <= {*range(4, _LARGEST + 1, 4)}, f"one or more multiples of 4 up to {_LARGEST}"
)
_SCALES = Range(lambda value: min(value, default=0) > 0, "one or more positive scales")


@dataclass(frozen=True)
class Switch(StageSettings):
    """A stage that is used or not. used: whether it is."""

    used: bool = False


@dataclass(frozen=True)
class DefectsSettings(StageSettings):
    """Samples that do not measure light.

    An unlisted panchromatic sample is defective if it lies outside its neighbours' range by more than contrast x local contrast +
    deviations x noise sigma + floor x mean panchromatic sample. Colour samples are judged by their blocks, with the same settings.

    listed: replace the samples in the calibration's list of defects.
    contrast: multiple of the local contrast, 0 or more; 0 = look for no unlisted defects.
    deviations, floor: multiples of the noise, where it is known, 0 or more; and of the mean panchromatic sample, > 0.
    """

    kernels = "find_outliers", "mend_panchromatic", "surroundings"
    asked_by = "listed", "contrast"
    listed: bool = False
    contrast: NotNegative = 0.0
    deviations: NotNegative = 6.0
    floor: Positive = 0.04


@dataclass(frozen=True)
class TrustSettings(Switch):
    """Blocks whose samples do not add up to luminance take the colour of their neighbours (see `whole.trust`); not in the paper.

    tolerance: how far the samples of a block may differ from luminance, relative to it, before half of its chromaticity is that of
        its neighbours, > 0.
    """

    kernels = "surroundings", "smooth"
    tolerance: Positive = 0.4


@dataclass(frozen=True)
class HighlightsSettings(StageSettings):
    """Panchromatic samples at the sensor's limit.

    restored: take luminance there from the colour samples.
    shoulder: the uppermost fraction of the colour samples' own range, in which they gradually count as clipped, 0 to 1.
    """

    kernels = "surroundings", "raise_clipped", "interpolate", "smooth"
    asked_by = ("restored",)
    restored: bool = False
    shoulder: Between = 0.05


@dataclass(frozen=True)
class LuminanceSettings(StageSettings):
    """Hole filling, Eqs. 1-5.

    iterations, decay: 50, and beta = 2^(-1/4), in the paper.
    threshold: shrinkage at the first iteration, scene units (1 in the paper); larger in frames brighter than 3 scene units, half of
        what they exceed 1 by.
    relative: the threshold is a multiple of the brightest sample instead, so that the picture does not depend on the exposure; and
        holes start from the samples around them, not from their own, which takes half the iterations.
    learned: a network that has seen photographs corrects what is filled in under blocks of 2 x 2 pixels (`whole.filling`).
    """

    kernels = "fill_blocks", "shrink_margins"
    iterations: Count = 50
    decay: Between = 2**-0.25
    threshold: Positive = 1.0
    relative: bool = False
    learned: bool = False


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
    """

    kernels = ("denoise",)
    asked_by = ("strength",)
    strength: NotNegative = 0.0
    sizes: Annotated[tuple[int, ...], _SIZES] = (4, 12)
    threshold: Positive = 2.4


@dataclass(frozen=True)
class ChromaticitySettings(StageSettings):
    """Block chromaticities, Eqs. 6-9, and the oriented medians after them.

    taps: length of the 1-D medians, odd; 5 in the paper, 1 = no medians.
    repetitions: largest number of repetitions of the medians ("till convergence" in the paper).
    """

    taps: Annotated[int, Range(lambda value: value >= 1 and value % 2 == 1, "an odd number")] = 5
    repetitions: CountOrNone = 20

    @property
    def kernels(self) -> tuple[str, ...]:
        """Those of the stage."""
        return ("oriented_median",) if self.taps > 1 else ()


class PoolingPass(NamedTuple):
    """One pass of pooling.

    blur: standard deviation of the Gaussian that smooths the chromaticities compared, blocks, 0 or more.
    tolerance: squared difference that chromaticities may have, as a multiple of the variance that noise has left in them, > 0.
    radius: radius of the window, blocks.
    """

    blur: float
    tolerance: float
    radius: int


_PASSES = Range(
    lambda passes: all(len(each) == 3 and each[0] >= 0 and each[1] > 0 and 1 <= each[2] <= _WIDEST for each in passes),
    f"for each pass a blur, 0 or more, a tolerance, more than 0, and a radius, 1 to {_WIDEST}",
)


@dataclass(frozen=True)
class PoolingSettings(StageSettings):
    """Averaging of the sums of Eqs. 8-9 over blocks of similar chromaticity; the paper has none.

    passes: one `PoolingPass` each; empty = no pooling.
    light: how much the luminance of blocks may differ: standard deviation of the Gaussian weight of its logarithm, less in the
        dark, > 0.
    curvature_error: error of filled luminance, as a multiple of its curvature there, 0 or more.
    """

    kernels = "pool", "smooth"
    asked_by = ("passes",)
    passes: Annotated[tuple[PoolingPass, ...], _PASSES] = ()
    light: Positive = 0.25
    curvature_error: NotNegative = 0.2


@dataclass(frozen=True)
class LineSettings(Switch):
    """Colour as a linear function of luminance, where that explains the samples (see `whole.colour_lines`); not in the paper."""

    kernels = "surroundings", "smooth"


@dataclass(frozen=True)
class SettlingSettings(Switch):
    """Correction of luminance at the colour sites once the colour of blocks is known (see `sites`); not in the paper."""

    kernels = "share_out", "smooth"


@dataclass(frozen=True)
class AffinitySettings(StageSettings):
    """Affinity maps, Eqs. 11-13.

    scales: standard deviations of the derivative filters, pixels (the paper gives none: errata).
    tolerance, iterations: of conjugate gradients, residual relative to the right-hand side, 0 to 1, and largest number.
    """

    scales: Annotated[tuple[float, ...], _SCALES] = (0.5, 1.0)
    tolerance: Between = 1e-3
    iterations: Count = 20_000  # photographs take 120 at most; pages without noise, where blocks differ by rounding, took 1056


@dataclass(frozen=True)
class PropagationSettings(StageSettings):
    """Mixing the chromaticities of the four blocks around a pixel, Eqs. 10 and 14.

    A block's weight is (alpha + softness)^2 l / (1 + likeness d^2), in the paper alpha^2 l, with l the luminance at the block, and
    d the difference of the pixel's from it, over their sum. More softness makes gradients of colour smoother, more likeness prefers
    blocks as bright as the pixel; both 0 or more.
    """

    softness: Finite = 0.0
    likeness: Finite = 0.0


@dataclass(frozen=True)
class RefinementSettings(StageSettings):
    """Non-local averaging of chromaticity, Eqs. 15-16.

    strength: lambda in h = lambda sigma_z, 40 in the paper.
    floor: the least h, scene units, > 0; it makes sigma_z = 0 defined and the average harmless there.
    blur: standard deviation of G in periods (K/8 in the paper).
    repetitions: 0 or more ("multiple times" in the paper).
    """

    asked_by = ("repetitions",)
    strength: NotNegative = 40.0
    floor: Positive = 1e-3
    blur: Positive = 1 / 8
    repetitions: CountOrNone = 2


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
    defects: DefectsSettings = DefectsSettings()
    trust: TrustSettings = TrustSettings()
    highlights: HighlightsSettings = HighlightsSettings()
    luminance: LuminanceSettings = LuminanceSettings()
    denoising: DenoisingSettings = DenoisingSettings()
    chromaticity: ChromaticitySettings = ChromaticitySettings()
    pooling: PoolingSettings = PoolingSettings()
    lines: LineSettings = LineSettings()
    settling: SettlingSettings = SettlingSettings()
    affinity: AffinitySettings = AffinitySettings()
    propagation: PropagationSettings = PropagationSettings()
    refinement: RefinementSettings = RefinementSettings()
    correction: Switch = Switch()
    pinning: Switch = Switch()
    learned: Switch = Switch()

    @property
    def asks_for_codes(self) -> bool:
        """Whether it matters which samples are saturated; if not, `in_scene_units` renders the same."""
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
    defects=DefectsSettings(listed=True, contrast=5.0),
    highlights=HighlightsSettings(restored=True),
    # The first threshold is a sixth of the brightest sample, the last one 0.0015: before and after, no iteration gains anything.
    luminance=LuminanceSettings(threshold=1 / 6, relative=True, iterations=28, learned=True),
    denoising=DenoisingSettings(strength=1.0),
    pooling=PoolingSettings(passes=(PoolingPass(0.7, 0.3, 7), PoolingPass(0.4, 3.0, 7), PoolingPass(0.3, 1.5, 22))),
    propagation=PropagationSettings(softness=0.45, likeness=7.0),  # without likeness print loses 1.2 dB, photographs 0.05, one 0.3
    affinity=AffinitySettings(tolerance=3e-3),  # with 1e-3 no photograph gains 0.02 dB
    refinement=RefinementSettings(repetitions=0),  # from chromaticities without noise it would only remove detail
).switched(True)
UNLEARNED = replace(BEST, learned=PAPER.learned, luminance=replace(BEST.luminance, learned=False))
PRESETS = {"best": BEST, "unlearned": UNLEARNED, "paper": PAPER}
"""The presets by name; unlearned is best without networks."""
