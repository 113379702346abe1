"""The settings of a render, and the presets. Those of a stage are in its file."""

from dataclasses import dataclass, replace

from .stage import Switch, check_settings
from .stages.affinity import AffinitySettings
from .stages.chromaticity import ChromaticitySettings
from .stages.defects import DefectsSettings
from .stages.denoising import DenoisingSettings
from .stages.highlights import HighlightsSettings
from .stages.luminance import LuminanceSettings
from .stages.noise import NoiseSettings
from .stages.pooling import PoolingPass, PoolingSettings
from .stages.propagation import PropagationSettings
from .stages.refinement import RefinementSettings


@dataclass(frozen=True)
class RenderSettings:
    """All settings of a render, one object per stage, in order of execution. The presets are
    `PAPER` and `BEST`.

    Stages with a `Switch` are not in the paper: `BEST` has all of them, `PAPER` none. posterior
    updates luminance at the colour sites once the colour of blocks is known; correction distributes
    the residual of the picture there (`stages.correction`); learned corrects chromaticity by a
    network, where there is one for the pattern (`stages.colour_network`).

    Examples
    --------
    >>> from dataclasses import replace
    >>> from panchroma.offline import BEST, PAPER
    >>> sharp = replace(BEST, denoising=replace(BEST.denoising, strength=0.5))
    >>> sharp.denoising.strength, PAPER.luminance.iterations
    (0.5, 50)
    """

    noise: NoiseSettings = NoiseSettings()
    defects: DefectsSettings = DefectsSettings()
    highlights: HighlightsSettings = HighlightsSettings()
    luminance: LuminanceSettings = LuminanceSettings()
    denoising: DenoisingSettings = DenoisingSettings()
    chromaticity: ChromaticitySettings = ChromaticitySettings()
    pooling: PoolingSettings = PoolingSettings()
    posterior: Switch = Switch()
    affinity: AffinitySettings = AffinitySettings()
    propagation: PropagationSettings = PropagationSettings()
    refinement: RefinementSettings = RefinementSettings()
    correction: Switch = Switch()
    learned: Switch = Switch()

    def __post_init__(self) -> None:
        """See `check_settings`."""
        check_settings(self)

    @property
    def asks_for_codes(self) -> bool:
        """True if the result depends on which samples are saturated; if not, `in_scene_units`
        renders the same.
        """
        mended = self.defects.listed or self.defects.contrast > 0
        return mended or self.highlights.restored or self.asks_for_sites

    @property
    def asks_for_sites(self) -> bool:
        """True if a switch is on: these stages use the samples of the colour sites, or the residual
        of the picture there.
        """
        return any(stage.used for stage in vars(self).values() if isinstance(stage, Switch))


PAPER = RenderSettings()
BEST = RenderSettings(
    noise=NoiseSettings(estimate=True),
    defects=DefectsSettings(listed=True, contrast=5.0),
    highlights=HighlightsSettings(restored=True),
    # The first threshold is a sixth of the brightest sample, the last one 0.0015: before and after,
    # no iteration gains anything.
    luminance=LuminanceSettings(threshold=1 / 6, relative=True, iterations=28, learned=True),
    denoising=DenoisingSettings(strength=1.0, sizes=(4, 8, 12)),
    chromaticity=ChromaticitySettings(learned=True),
    pooling=PoolingSettings(
        passes=(PoolingPass(0.7, 0.3, 7), PoolingPass(0.4, 3.0, 7), PoolingPass(0.3, 1.5, 22))
    ),
    posterior=Switch(used=True),
    # likeness is for print
    propagation=PropagationSettings(softness=0.45, likeness=7.0),
    affinity=AffinitySettings(tolerance=3e-2),  # a smaller one shows in no photograph
    # from chromaticities without noise it would only remove detail
    refinement=RefinementSettings(repetitions=0),
    correction=Switch(used=True),
    learned=Switch(used=True),
)
UNLEARNED = replace(
    BEST,
    luminance=replace(BEST.luminance, learned=False),
    chromaticity=replace(BEST.chromaticity, learned=False),
    learned=PAPER.learned,
)
PRESETS = {"best": BEST, "unlearned": UNLEARNED, "paper": PAPER}
"""The presets by name; unlearned is best without networks."""
