"""What the frames of one camera show: the statistics from which the parts of a camera file are concluded."""

from dataclasses import dataclass, field

from shared import Mosaic

from .aberration import AberrationResult
from .dark_frames import DarkResult
from .gamma import GammaFit, combined
from .noise import FlatResult
from .shading import ShadingResult
from .shot import ShotMeasurement


@dataclass(eq=False)
class Observations:
    """What was measured, and what could not be; None = not measured.

    base: the first frame that was read: its pattern, levels and sensor are those of the camera. None = no frame could be read.
    dark: of dark frames.
    flats: of pairs of flat frames.
    shots: of each shot of a chart or of an ordinary scene.
    lights: the names of the two lights on the charts; () = one light, whose name does not matter.
    shading: of flat frames.
    aberration: of shots with edges.
    skipped: a line for each frame, or set of frames, that could not be used.
    remarks: why flat frames do not show shading or noise, and why a measurement of before is kept.
    """

    base: Mosaic | None = None
    dark: DarkResult | None = None
    flats: FlatResult | None = None
    shots: list[ShotMeasurement] = field(default_factory=list)
    lights: tuple[str, ...] = ()
    shading: ShadingResult | None = None
    aberration: AberrationResult | None = None
    skipped: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def fits(self) -> list[tuple[ShotMeasurement, GammaFit, bool]]:
        """All estimates of gamma: shot, estimate, and whether it comes from the patches of a chart."""
        return [(shot, fit, shot.chart is not None and fit is shot.fits[0]) for shot in self.shots for fit in shot.fits]

    @property
    def gamma(self) -> GammaFit | None:
        """Gamma as all shots show it together; None = there are none."""
        return combined([fit for _, fit, _ in self.fits]) if self.shots else None

    @property
    def empty(self) -> bool:
        """Whether no frame could be used."""
        return not (self.dark or self.flats or self.shots or self.shading or self.aberration)
