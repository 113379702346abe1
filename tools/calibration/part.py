"""A measured part of a camera, and what it is concluded from. `measure.PARTS` lists all parts; each is a function in `parts/`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from shared import Camera, SensorCalibration
from shared.arrays import DoubleArray

from .gamma import Assumed, GammaFit
from .observations import Observations


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that a part is concluded from.

    seen: what the frames show.
    calibration: of the camera file that is updated, or of the frames; with the black level of the dark frames.
    channels: their letters.
    chart_colours: (24, 3), XYZ (D50) of the chart, white = 1.
    old: the camera file that is updated; None = there is none.
    """

    seen: Observations
    calibration: SensorCalibration
    channels: str
    chart_colours: DoubleArray
    old: Camera | None = None

    @property
    def known(self) -> Mapping[str, Mapping[str, Any]]:
        """The parts that the camera file describes: name -> how it was measured."""
        return self.old.measured if self.old else {}

    @property
    def planes(self) -> str:
        """The letters of all planes: the channels, then panchromatic."""
        return self.channels + "W"

    @cached_property
    def assumed(self) -> Assumed:
        """How far black level and shading may be off."""
        return Assumed.of(self.calibration, self.seen.dark, self.known, even=self.seen.shading is not None)

    @cached_property
    def gamma(self) -> GammaFit | None:
        """Gamma as all shots show it; None = there are none."""
        return self.seen.gamma


@dataclass(frozen=True, eq=False)
class Part:
    """One measured part of a camera: what it changes, how well it is known, and what a user has to know of it.

    name: its key in "measured" of camera.json.
    facts: for camera.json: how it was measured, and how well it is known; None = it was not, and only its warnings count.
    changes: fields of the calibration, and their values.
    warnings: sentences for the user.
    contradictions: sentences on what is wrong beyond doubt: the camera must not be used.
    refusal: why there must not be a camera file; "" = there may be one.
    headline: what the report's verdict says of it; "" = nothing.
    sections: draws its sections of the report: heading -> HTML.
    files: to be written beside the report: name -> content.
    """

    name: str
    facts: Mapping[str, Any] | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    contradictions: Sequence[str] = ()
    refusal: str = ""
    headline: str = ""
    sections: Callable[[], Mapping[str, str]] = dict
    files: Mapping[str, bytes] = field(default_factory=dict)


def rounded(values: DoubleArray) -> list[float]:
    """Return numbers with three digits, for camera.json."""
    return [float(f"{value:.3g}") for value in values.tolist()]
