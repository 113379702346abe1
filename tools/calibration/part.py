"""A measured part of a camera, what it is concluded from, and the pieces of the report that several parts need.

`measure.PARTS` lists all parts; each is a function in `parts/`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from shared import Camera, SensorCalibration
from shared.arrays import DoubleArray
from shared.colorimetry import SRGB_TO_XYZ
from tools.batch.html import cell, row
from tools.batch.html import table as table_of
from tools.batch.plot import Plot, Span, round_step, ticks
from tools.io.colour import encode_srgb, lab_to_xyz

from .gamma import Assumed, GammaFit
from .observations import Observations

_OTHER = "#b658c4"  # colour of what has no colour of its own
_PLANES = {"R": "#e5484d", "G": "#30a46c", "B": "#3e63dd", "W": "#8d8d86"}
_SIZE, _MARGINS = (560, 340), (64, 14, 12, 46)


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


def plane_colour(letter: str) -> str:
    """Return the CSS colour of a plane."""
    return _PLANES.get(letter, _OTHER)


def css_colours(lab: DoubleArray) -> list[str]:
    """Return CSS colours for L*a*b* (N, 3): sRGB, clipped."""
    encoded = encode_srgb((lab_to_xyz(lab) @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T).astype(np.float32))
    return ["#" + "".join(f"{round(255 * value):02x}" for value in row) for row in encoded.tolist()]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of texts; head: titles of the columns, empty = none."""
    return table_of(head, [row(map(cell, texts)) for texts in rows])


def axes(x: Span, y: Span, across: str, up: str, *, log: bool = False) -> Plot:
    """Return an empty plot with a grid and the names of both axes.

    x, y: first and last value on each axis.
    across, up: names.
    log: whether both axes are logarithmic.
    """
    plot = Plot(x, y, _SIZE, _MARGINS, log=log)
    plot.columns(_ticks(x, log=log))
    plot.rows(_ticks(y, log=log))
    plot.name_axes(across, up)
    return plot


def _ticks(span: Span, *, log: bool) -> list[float]:
    """Return round numbers inside a span: about five, or powers of ten."""
    if not log:
        return ticks(span, round_step(span[1] - span[0], 5))
    low, high = map(math.log10, span)
    return [10.0**power for power in ticks((low, high), max(1.0, round_step(high - low, 9)))]
