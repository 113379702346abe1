"""What the frames of one camera show: the statistics from which the parts of a camera file are concluded."""

from contextlib import suppress
from dataclasses import dataclass, field

from shared import Mosaic, SensorCalibration
from shared.arrays import ByteArray, DoubleArray
from shared.colorimetry import Matrix
from shared.errors import InputError
from shared.progress import SILENT, Progress

from .chart.find import FoundChart, chart_at, find_chart
from .chart.picture import overlay
from .chart_gamma import fit_chart_gamma
from .colour_matrix import check_channel_order
from .dark_frames import DarkResult
from .gamma import Assumed, GammaFit, combined
from .noise import FlatResult
from .samples import PlaceSamples, figures, patch_samples
from .scene_gamma import fit_scene_gamma
from .shading import ShadingResult

# Half width over gamma: what knows gamma less well has hardly any colour, and its interval is not to be trusted either.
_VAGUE = 0.2


@dataclass(frozen=True, eq=False)
class ShotMeasurement:
    """Measurements of one shot.

    name: file name.
    calibration: the calibration stored in the shot, with the black level that the measurements refer to.
    fits: independent estimates of gamma; if there is a chart, the first one comes from its patches.
    chart: the chart; None for an ordinary scene.
    places: statistics of the patches; None for an ordinary scene.
    picture: uint8 RGB (H, W, 3), the shot with the patches outlined; None for an ordinary scene.
    light: the one of two on the chart, "" = the only one.
    """

    name: str
    calibration: SensorCalibration
    fits: tuple[GammaFit, ...]
    chart: FoundChart | None = None
    places: PlaceSamples | None = None
    picture: ByteArray | None = None
    light: str = ""

    @property
    def words(self) -> str:
        """Name, place of the chart, and gamma, for people."""
        where = f"chart at {self.chart.place}, " if self.chart else ""
        return f"{self.name}: {where}gamma {figures(self.fits[0].gamma)} ± {figures(self.fits[0].half_width)}"


def measure_chart(
    name: str,
    mosaic: Mosaic,
    reference: DoubleArray,
    corners: Matrix | None = None,
    progress: Progress = SILENT,
    assumed: Assumed | None = None,
) -> ShotMeasurement:
    """Find the chart in a shot, measure its patches, and estimate gamma from them and from the scene around the chart.

    name: file name.
    mosaic: the shot.
    reference: (24, 3), XYZ (D50), white = 1.
    corners: of the chart, see `ChartPlace`; None = find it.
    progress: receives the stages of the search.
    assumed: what may be off; None = nothing was measured, see `Assumed.of`.

    Raises InputError with the reason if the shot cannot be used.
    """
    chart = chart_at(mosaic, corners, reference) if corners else find_chart(mosaic, reference, progress)
    progress.stage("measuring", 1)
    places = patch_samples(mosaic, chart.place.measured())
    check_channel_order(places.mean[:, :-1], reference, mosaic.pattern)
    fits = [fit_chart_gamma(places, mosaic.calibration, assumed)]
    with suppress(InputError):  # Surroundings are optional: a wall behind the chart has no colours.
        around = fit_scene_gamma(mosaic, chart.place.covered(mosaic.shape), assumed)
        if around.gamma.min() > 0 and around.worst < _VAGUE:
            fits.append(around)
    return ShotMeasurement(name, mosaic.calibration, tuple(fits), chart, places, overlay(mosaic, chart.place))


def measure_scene(name: str, mosaic: Mosaic, assumed: Assumed | None = None) -> ShotMeasurement:
    """Estimate gamma from a shot without a chart. Raises InputError with the reason if the shot cannot be used."""
    return ShotMeasurement(name, mosaic.calibration, (fit_scene_gamma(mosaic, assumed=assumed),))


@dataclass(eq=False)
class Observations:
    """What was measured, and what could not be; None = not measured.

    base: the first frame that was read: its pattern, levels and sensor are those of the camera. None = no frame could be read.
    dark: of dark frames.
    flats: of pairs of flat frames.
    shots: of each shot of a chart or of an ordinary scene.
    lights: the names of the two lights on the charts; () = one light, whose name does not matter.
    shading: of flat frames.
    stated_defects: (row, column) of the defects that the frames state.
    skipped: a line for each frame, or set of frames, that could not be used.
    remarks: why flat frames do not show shading or noise, and why a measurement of before is kept.
    """

    base: Mosaic | None = None
    dark: DarkResult | None = None
    flats: FlatResult | None = None
    shots: list[ShotMeasurement] = field(default_factory=list)
    lights: tuple[str, ...] = ()
    shading: ShadingResult | None = None
    stated_defects: set[tuple[int, int]] = field(default_factory=set)
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
        return not (self.dark or self.flats or self.shots or self.shading)
