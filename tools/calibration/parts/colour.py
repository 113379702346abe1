"""Colour: the matrix to XYZ and what white reads, from the chart that fits best."""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from ....shared.arrays import DoubleArray
from ....shared.colorimetry import SRGB_TO_XYZ, as_rows
from ....shared.lights import CalibratedLight
from ...io.colour_difference import delta_e_2000
from ..colour_matrix import UNEVEN, VERY_UNEVEN, ColourFit, fit_colour, light_change, white_balanced
from ..gamma import reconciled
from ..measure import Measurements, ShotMeasurement
from .gamma import coloured_light
from .part import Part

# See `light_change`. Right lights give 0.9 to 1.8 with measured sensitivities of two cameras; the rest is for lamps and daylight
# that are not quite what is said of them.
_LIKELY_CHANGE = (0.6, 1.9)
_CORRECTED = 2.5  # mean dE2000 of patches predicted from the others: below it the correction for uneven light has worked
# Mean dE2000: an average chart in average light stays below; above it the colours are useless.
_GOOD, _USELESS = 4.0, 6.0


@dataclass(frozen=True, eq=False)
class ChartColours:
    """The colours of a chart without clipped patches.

    shot: of the chart.
    fit: matrix, neutral and light.
    before: L*a*b* of the patches with the matrix in the shot (without one: sRGB primaries), (24, 3); None = there is neither.
    """

    shot: ShotMeasurement
    fit: ColourFit
    before: DoubleArray | None


def colour(seen: Measurements) -> Part | None:
    """Return the camera's colours: of every chart without clipped patches those that predict the left-out patches best.

    Under two lights, those under each; the part is refused unless both are known.
    """
    lights = seen.lights or ("",)
    charts = {light: _charts(seen, light) for light in lights}
    if missing := [light for light in lights if not charts[light]]:
        why = "no chart without clipped patches was found under the light"
        refusal = f"{why} {' and '.join(missing)}"
        return Part("colour", refusal=refusal) if seen.lights else None
    if seen.lights and (wrong := _wrong_lights(charts)):
        return Part("colour", refusal=wrong)
    best = [min(each, key=lambda chart: chart.fit.left_out.mean()) for each in charts.values()]
    warnings, contradictions = [], []
    for chart in best:
        mean = float(chart.fit.difference.mean())
        off = f"{chart.shot.name}: the colours differ from the reference by a mean dE2000 of {mean:.1f}, more than"
        warnings += _uneven(chart)
        if mean > _USELESS:
            contradictions.append(f"{off} {_USELESS:.0f}")
        elif mean > _GOOD:
            warnings.append(f"{off} {_GOOD:.0f}")
    facts = [_facts(chart) for chart in best]
    found = [(as_rows(chart.fit.matrix), tuple(chart.fit.neutral.tolist())) for chart in best]
    every: dict[str, Any] = facts[0]
    changes: dict[str, Any] = {"camera_to_xyz": found[0][0], "neutral": found[0][1], "lights": None}
    if seen.lights:
        every = {"light": list(lights)} | {name: [each[name] for each in facts] for name in every}
        both = (CalibratedLight(light, *each) for light, each in zip(lights, found, strict=True))
        changes = {"lights": tuple(both), "neutral": None, "neutral_estimated": False}
    return Part("colour", every, changes, warnings, contradictions, result=best)


def _charts(seen: Measurements, light: str) -> list[ChartColours]:
    """Return the charts under one light that show colours."""
    gamma, charts = seen.gamma, []
    for shot in seen.shots:
        if gamma is not None and shot.light == light and not shot.places.clipped.any():
            levels = reconciled(shot.places, gamma.gamma)
            known, before = shot.calibration.camera_to_xyz, None
            if known is not None or shot.calibration.channels == "RGB":
                matrix = np.array(SRGB_TO_XYZ if known is None else known)
                before = white_balanced(levels, seen.chart_colours, matrix)
            fit = fit_colour(levels, seen.chart_colours, shot.chart.place.cells)
            charts.append(ChartColours(shot, fit, before))
    return charts


def _facts(chart: ChartColours) -> dict[str, object]:
    """Return how well the colours of a chart are known, for camera.json."""
    fit, before = chart.fit, chart.before
    return {
        "shot": chart.shot.name,
        "mean_dE2000": round(float(fit.difference.mean()), 3),
        "mean_dE2000_before": None if before is None else round(float(delta_e_2000(before, fit.reference).mean()), 3),
        "max_dE2000": round(float(fit.difference.max()), 3),
        "leave_one_out_dE2000": round(float(fit.left_out.mean()), 3),
        "light_unevenness": round(fit.unevenness, 3),
    }


def _uneven(chart: ChartColours) -> list[str]:
    """Warn of uneven light on a chart."""
    unevenness = chart.fit.unevenness
    least = UNEVEN if chart.fit.left_out.mean() > _CORRECTED else VERY_UNEVEN
    # In strongly coloured light other errors are corrected as uneven light.
    if unevenness <= least or coloured_light(chart.shot):
        return []
    return [
        f"{chart.shot.name}: the light on the chart is uneven, up to {unevenness:.2f} times brighter in one place than in "
        "another, and colours are only corrected for it in part; light the chart evenly, and take flat frames (`flat`) if the "
        "lens darkens the corners"
    ]


def _wrong_lights(charts: dict[str, list[ChartColours]]) -> str:
    """Return which shots cannot be under the two lights that are named, and what to do; "" if all can."""
    (one, first), (other, second) = charts.items()
    changes = []
    for a, b in product(first, second):
        change = light_change(a.fit, b.fit, (one, other))
        changes.append((change, a.shot.name, b.shot.name))
    change, warm, cold = min(changes)
    least, most = _LIKELY_CHANGE
    if change >= least:
        change, warm, cold = max(changes)
    if least <= change <= most:
        return ""
    said = f"{warm} is given as under {one} and {cold} as under {other}, but white changes"
    if change <= -least:
        return (
            f"{said} the other way from one to the other: the two lights are exchanged; name the light of each shot (`chart_light`)"
        )
    return (
        f"{said} {max(change, 0):.1f} times as much from one to the other as between these lights, {least:g} to {most:g} times are "
        "likely: name the light under which each was taken (`chart_light`), or take the chart anew under these two"
    )
