"""What was seen of one camera, and how camera.json keeps it, so that a later `--update` can conclude from old and new together.

A conclusion depends on all frames: gamma and colour on the black level of the dark frames, the noise of flat frames on their read
noise. So camera.json keeps the statistics of the frames, not only the conclusions: under "kept", in `measured`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shared import Camera, SensorCalibration
from shared.arrays import DoubleArray
from shared.colorimetry import as_rows
from shared.errors import InputError
from shared.figures import tables

from .assumed import Assumed, unknowns
from .chart.judge import FoundChart
from .chart.place import PATCHES, ChartPlace
from .chart_gamma import fit_chart_gamma
from .dark_frames import DarkResult
from .gamma import GammaFit, combined
from .noise import FlatResult
from .samples import PlaceSamples
from .shot import ShotMeasurement

KEPT = "kept"
_LESS_KNOWN = 1.2  # times the uncertainty: new frames that are about as good as the old ones replace them
_DIGITS = 9


@dataclass(frozen=True, eq=False)
class Observations:
    """Statistics of the frames of one camera.

    dark, flats: of dark and flat frames; None = there were none.
    charts, scenes: shots of a chart, and of ordinary scenes.
    """

    dark: DarkResult | None = None
    flats: FlatResult | None = None
    charts: tuple[ShotMeasurement, ...] = ()
    scenes: tuple[ShotMeasurement, ...] = ()

    def with_known(self, old: "Observations") -> tuple["Observations", list[str]]:
        """Return these observations and, of each kind, the old ones where they are better known; and a line for each of those."""
        chosen: dict[str, Any] = {}
        lines = []
        for kind, uncertainty in _UNCERTAINTY.items():
            new, known = getattr(self, kind), getattr(old, kind)
            chosen[kind] = new or known
            if new and known and uncertainty(new) > _LESS_KNOWN * uncertainty(known):
                chosen[kind] = known
                lines.append(f"the {_KINDS[kind]} before are kept: they are better known than the new ones")
        return Observations(**chosen), lines

    def rebased(self, calibration: SensorCalibration, assumed: Assumed) -> "Observations":
        """Return the observations with the black level of a calibration, and with what is assumed now, in all shots."""
        charts, scenes = (tuple(_rebased(shot, calibration, assumed) for shot in shots) for shots in (self.charts, self.scenes))
        return replace(self, charts=charts, scenes=scenes)

    def to_json(self) -> dict[str, Any]:
        """Return part of a calibration -> what camera.json keeps for it."""
        kept: dict[str, Any] = {}
        if self.dark is not None:
            figures = {name: _listed(getattr(self.dark, name)) for name in _DARK}
            kept["black_level"] = {"frames": self.dark.frames, **figures}
        if self.flats is not None:
            points = _points_to_json(self.flats.points)
            kept["noise"] = {"pairs": self.flats.pairs, "black_level": _listed(self.flats.black), **points}
            kept["defects"] = {"dead": [list(place) for place in self.flats.dead]}
        if self.charts or self.scenes:
            kept["gamma"] = {kind: [_shot_to_json(shot) for shot in getattr(self, kind)] for kind in ("charts", "scenes")}
        return kept

    @staticmethod
    def of_camera(camera: Camera) -> "Observations":
        """Return what a camera file keeps. Raises InputError that names the part that is damaged."""
        calibration, planes = camera.calibration, len(camera.calibration.channels) + 1
        kept = {part: how[KEPT] for part, how in camera.measured.items() if KEPT in how}
        part = ""
        try:
            dead: tuple[tuple[int, int], ...] = ()
            if part := "defects" if "defects" in kept else "":
                dead = SensorCalibration(defects=kept[part]["dead"]).defects
            dark = flats = None
            if part := "black_level" if "black_level" in kept else "":
                figures = {name: _numbers(kept[part][name], (planes,)) for name in _DARK}
                hot = tuple(place for place in calibration.defects if place not in set(dead))
                dark = DarkResult(_count(kept[part]["frames"]), **figures, defects=hot)
            if part := "noise" if "noise" in kept else "":
                black = _numbers(kept[part]["black_level"], (planes,))
                flats = FlatResult(_count(kept[part]["pairs"]), black, _points(kept[part], planes), dead)
            shots: dict[str, tuple[ShotMeasurement, ...]] = {"charts": (), "scenes": ()}
            if part := "gamma" if "gamma" in kept else "":
                shots = {kind: tuple(_shot(given, calibration) for given in kept[part][kind]) for kind in shots}
                if any(shot.places is None for shot in shots["charts"]) or not all(
                    shot.fits for each in shots.values() for shot in each
                ):
                    raise ValueError
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, ArithmeticError, np.linalg.LinAlgError, InputError):
            raise InputError(f"camera: measured.{part}.{KEPT} is damaged; write a new camera file with --overwrite") from None
        return Observations(dark, flats, **shots)


_BESIDE = ("where", "gain")
_DARK = ("black", "black_error", "read", "read_error")
_KINDS = {"dark": "dark frames", "flats": "flat frames", "charts": "shots of the chart", "scenes": "scenes"}


def _gamma_uncertainty(shots: Sequence[ShotMeasurement]) -> float:
    return combined([fit for shot in shots for fit in shot.fits]).worst


_UNCERTAINTY: Mapping[str, Callable[[Any], float]] = {
    "dark": lambda dark: float(dark.black_error.max()),
    "flats": lambda flats: float(flats.points.count.sum(axis=0).min()) ** -0.5,
    "charts": _gamma_uncertainty,
    "scenes": _gamma_uncertainty,
}


def _rebased(shot: ShotMeasurement, calibration: SensorCalibration, assumed: Assumed) -> ShotMeasurement:
    was, black = (np.array(each.black_level) for each in (shot.calibration, calibration))
    own = replace(shot.calibration, black_level=calibration.black_level)
    if calibration.shading and not own.shading:  # flat frames have come later, and the shot's samples are as they were
        assumed = assumed.uneven()
    fits = tuple(replace(fit.rebased(black), assumed=assumed) for fit in shot.fits)
    places = None if shot.places is None else shot.places.rebased(was, black, calibration.white_level)
    if places is not None:
        fits = (fit_chart_gamma(places, own, assumed), *fits[1:])
    return replace(shot, calibration=own, fits=fits, places=places)


def _shot_to_json(shot: ShotMeasurement) -> dict[str, Any]:
    document: dict[str, Any] = {"name": shot.name, "black_level": list(shot.calibration.black_level)}
    document["camera_to_xyz"] = shot.calibration.camera_to_xyz
    document["shading_undone"] = shot.calibration.shading is not None
    if shot.chart is not None and shot.places is not None:
        document |= {"corners": _listed(np.array(shot.chart.place.corners)), **_points_to_json(shot.places)}
        document["clipped"] = shot.places.clipped.tolist()
        document |= {name: _listed(values) for name in _BESIDE if (values := getattr(shot.places, name)) is not None}
    document["fits"] = [
        {
            "information": fit.information.tolist(),
            "told": fit.told.tolist(),
            "freedom": fit.freedom,
            "condition": fit.condition,
        }
        for fit in shot.fits[1 if shot.places else 0 :]  # a chart's own comes from its patches
    ]
    return document


def _shot(given: Mapping[str, Any], calibration: SensorCalibration) -> ShotMeasurement:
    own = replace(calibration, black_level=given["black_level"], camera_to_xyz=given["camera_to_xyz"])
    if not _truth(given["shading_undone"]):
        own = replace(own, shading=None)
    fits = [_fit(each, own) for each in given["fits"]]
    if "corners" not in given:
        return ShotMeasurement(_text(given["name"]), own, tuple(fits))
    planes = len(calibration.channels) + 1
    sizes = {"where": 2, "gain": planes}
    beside = {name: _numbers(given[name], (PATCHES, width)) for name, width in sizes.items() if name in given}
    places = replace(_points(given, planes), clipped=np.array([_truth(each) for each in given["clipped"]]), **beside)
    if places.mean.shape[0] != PATCHES or places.clipped.shape != (PATCHES,):
        raise ValueError
    chart = FoundChart(ChartPlace(as_rows(_numbers(given["corners"], (4, 2)))), 0.0)
    return ShotMeasurement(_text(given["name"]), own, (fit_chart_gamma(places, own), *fits), chart, places)


def _fit(given: Mapping[str, Any], calibration: SensorCalibration) -> GammaFit:
    number, none = unknowns(np.zeros((1, len(calibration.channels))), None).size, np.zeros(0)
    information, told = _numbers(given["information"], (number, number), 1e30), _numbers(given["told"], (number,), 1e30)
    values = np.linalg.eigvalsh(information)
    if not np.allclose(information, information.T, rtol=1e-6) or values[0] < -1e-6 * values[-1] or not values[-1] > 0:
        raise ValueError
    condition = float(_numbers([given["condition"]], (1,))[0])
    assumed = Assumed.of(calibration)
    return GammaFit(
        information, told, assumed, calibration, _count(given["freedom"]), none, none, none.astype(bool), condition, spread=1.0
    )


def _points_to_json(points: PlaceSamples) -> dict[str, Any]:
    return {name: _listed(getattr(points, name)) for name in ("mean", "variance", "count")}


def _points(given: Mapping[str, Any], planes: int) -> PlaceSamples:
    number = len(given["mean"])
    mean, variance, count = (_numbers(given[name], (number, planes)) for name in ("mean", "variance", "count"))
    if not number or variance.min() < 0 or count.min() < 0 or np.abs(mean).max() > 2 or variance.max() > 1 or count.max() > 1e12:
        raise ValueError
    return PlaceSamples(mean, variance, count, np.zeros(number, bool))


def _listed(values: DoubleArray) -> Any:
    """Return an array as lists, with digits enough for any later computation."""
    if values.ndim > 1:
        return [_listed(row) for row in values]
    return [float(f"{value:.{_DIGITS}g}") for value in values.tolist()]


def _numbers(given: Any, shape: tuple[int, ...], most: float = 1e15) -> DoubleArray:
    values = np.array(tables("kept", given, len(shape)), np.float64)
    if values.shape != shape or not (np.abs(values) < most).all():
        raise ValueError
    return values


def _count(given: Any) -> int:
    if type(given) is not int or not 0 < given < 1 << 40:
        raise ValueError
    return given


def _truth(given: Any) -> bool:
    if not isinstance(given, bool):
        raise TypeError
    return given


def _text(given: Any) -> str:
    if not isinstance(given, str):
        raise TypeError
    return given
