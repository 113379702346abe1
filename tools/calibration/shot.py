"""The measurements of one shot."""

from contextlib import suppress
from dataclasses import dataclass

from shared import Mosaic, SensorCalibration
from shared.arrays import ByteArray, DoubleArray
from shared.colorimetry import Matrix
from shared.errors import InputError
from shared.progress import SILENT, Progress

from .assumed import Assumed
from .channel_order import check_channel_order
from .chart.find import FoundChart, chart_at, find_chart
from .chart.picture import overlay
from .chart_gamma import fit_chart_gamma
from .gamma import GammaFit
from .samples import PlaceSamples, figures, patch_samples
from .scene_gamma import fit_scene_gamma

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
