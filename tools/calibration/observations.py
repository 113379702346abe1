"""What the frames of one camera show: the statistics from which the parts of a camera file are concluded."""

from dataclasses import dataclass, field

from shared import Mosaic, SensorCalibration
from shared.arrays import ByteArray, DoubleArray
from shared.colorimetry import Matrix
from shared.progress import SILENT, Progress

from .chart.find import FoundChart, chart_at, find_chart
from .chart.picture import overlay
from .chart_gamma import fit_chart_gamma
from .colour_matrix import check_channel_order
from .dark_frames import DarkResult
from .gamma import Assumed, GammaFit, combined
from .noise import FlatResult
from .samples import PlaceSamples, figures, patch_samples
from .shading import ShadingResult
from .surroundings import fit_surroundings


@dataclass(frozen=True, eq=False)
class ShotMeasurement:
    """Measurements of one shot of the chart.

    name: file name.
    calibration: the calibration stored in the shot, with the black level that the measurements refer to.
    fits: independent estimates of gamma: from the patches, then from what surrounds the chart, if that has colours.
    chart: the chart.
    places: statistics of the patches.
    picture: uint8 RGB (H, W, 3), the shot with the patches outlined.
    light: the one of two on the chart, "" = the only one.
    """

    name: str
    calibration: SensorCalibration
    fits: tuple[GammaFit, ...]
    chart: FoundChart
    places: PlaceSamples
    picture: ByteArray
    light: str = ""

    @property
    def words(self) -> str:
        """Name, place of the chart, and gamma, for people."""
        gamma = combined(self.fits)
        return f"{self.name}: chart at {self.chart.place}, gamma {figures(gamma.gamma)} ± {figures(gamma.half_width)}"


def measure_chart(
    name: str,
    mosaic: Mosaic,
    reference: DoubleArray,
    corners: Matrix | None = None,
    progress: Progress = SILENT,
    assumed: Assumed | None = None,
) -> ShotMeasurement:
    """Find the chart in a shot, measure its patches, and estimate gamma from them and from what surrounds the chart.

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
    if around := fit_surroundings(mosaic, chart.place.covered(mosaic.shape), fits[0].where, assumed):
        fits.append(around)
    return ShotMeasurement(name, mosaic.calibration, tuple(fits), chart, places, overlay(mosaic, chart.place))


@dataclass(eq=False)
class Observations:
    """What was measured, and what could not be; None = not measured.

    base: the first frame that was read: its pattern, levels and sensor are those of the camera. None = no frame could be read.
    dark: of dark frames.
    flats: of pairs of flat frames.
    shots: of each shot of a chart.
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
        """All estimates of gamma: shot, estimate, and whether it comes from the patches of the chart."""
        return [(shot, fit, fit is shot.fits[0]) for shot in self.shots for fit in shot.fits]

    @property
    def gamma(self) -> GammaFit | None:
        """Gamma as all shots show it together; None = there are none."""
        return combined([fit for _, fit, _ in self.fits]) if self.shots else None

    @property
    def empty(self) -> bool:
        """Whether no frame could be used."""
        return not (self.dark or self.flats or self.shots or self.shading)
