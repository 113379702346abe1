"""Gamma (Eq. 7), from all shots of charts."""

from collections.abc import Sequence
from html import escape

import numpy as np

from shared.arrays import DoubleArray
from shared.errors import InputError
from tools.batch.html import figure, picture, reduced
from tools.io.colour import xyz_to_lab

from ..chart.place import NAMES, PATCHES
from ..colour_matrix import GREYS
from ..gamma import GammaFit, check_determined
from ..observations import Observations, ShotMeasurement
from ..part import Evidence, Part, axes, css_colours, rounded, table
from ..samples import figures

CONTRADICTION = 4.0  # standard errors: a larger one is not a coincidence
_LEVER = 0.2  # of an error of black common to all planes: the least share that shows in Eq. 7, so that it can be stated in codes
_UNEVEN_BLACK = 1 / 128  # of the black level, by which planes may differ: 2 codes of 256
_SPREAD = 2.5  # residuals over noise: larger ones have another cause than noise
_GOOD = 0.02  # half width over gamma
_COLOURED = 0.2  # of the brightest channel: in daylight and in the light of a bulb, grey reads more in each of three broad channels
_MOST_POINTS = 600  # of a scatter plot: more only make the file larger
_SHOWN = 0.98  # of the places lie inside the plot


def gamma(evidence: Evidence) -> Part | None:
    """The weights of Eq. 7 as all shots show them together, and what does not fit together."""
    fit, shots = evidence.gamma, evidence.seen.shots
    if fit is None:
        stated = ", ".join(f"{value:g}" for value in evidence.calibration.gamma)
        line = f"gamma was not measured, and stays as the shots state it ({stated})"
        remedy = "shoot a ColorChecker, and add it with `update`"
        return None if "gamma" in evidence.known else Part("gamma", warnings=[f"{line}; {remedy}"])
    refusal, contradictions = "", _contradictions(fit, evidence.seen)
    try:
        check_determined(fit)
    except InputError as error:
        refusal = str(error)
    # If only a black level that was assumed is contradicted, gamma covers it, and dark frames may follow.
    if contradictions and (refusal or evidence.assumed.black_measured or fit.contradiction > CONTRADICTION):
        refusal = "; ".join(contradictions)
    return Part(
        "gamma",
        {
            "from": "the patches of a ColorChecker",
            "shots": [shot.name for shot in shots],
            "half_width_95": rounded(fit.half_width),
            "condition": round(fit.condition, 2),
            "residuals_over_noise": round(fit.spread, 2),
        },
        {"gamma": tuple(fit.gamma.tolist())},
        _warnings(fit, shots),
        contradictions,
        refusal,
        headline="" if refusal else f"Gamma is known to ±{100 * fit.worst:.2g} % (95 %).",
        sections=lambda: {
            "Chart": "".join(map(_chart, shots)),
            "Gamma (Eq. 7)": _estimates(fit, evidence),
            "Luminance, predicted by Eq. 7": _residuals(evidence.seen.fits, css_colours(xyz_to_lab(evidence.chart_colours))),
        },
    )


def black_error(evidence: Evidence) -> DoubleArray:
    """Return how far the black level may be off, (C + 1,), codes: by what is assumed, and by what shots show of it."""
    assumed, fit = evidence.assumed, evidence.gamma
    if fit is None or assumed.black_measured:
        return assumed.black
    offset, error = fit.offset
    black = np.array(fit.calibration.black_level)
    # On all planes in common, and on each by itself.
    common = np.hypot(offset, error) / max(abs(1 - float(fit.gamma.sum())), _LEVER) * (fit.calibration.white_level - black)
    return np.minimum(assumed.black, np.hypot(common, _UNEVEN_BLACK * black))


def coloured_light(shot: ShotMeasurement) -> str:
    """Return what strongly coloured light does to a shot of the chart, "" if the light is not: it shows on the grey patches."""
    grey = shot.places.mean[list(GREYS), :-1].mean(axis=0)
    if grey.min() > _COLOURED * grey.max():
        return ""
    letters = shot.calibration.channels
    weak, strong = letters[int(grey.argmin())], letters[int(grey.argmax())]
    return (
        f"{shot.name}: the light is strongly coloured: on grey {weak} reads {100 * max(grey.min(), 0) / grey.max():.0f} % of what "
        f"{strong} does, so that colours, and gamma of {weak}, are known less well; take white light"
    )


def _contradictions(fit: GammaFit, seen: Observations) -> list[str]:
    """Return what does not fit together by more than four standard errors, and what to shoot instead; a sentence each."""
    lines = []
    if abs(fit.black_deviation) > CONTRADICTION:
        lines.append(_wrong_black(fit))
    if fit.contradiction > CONTRADICTION:
        each = ", ".join(
            f"{shot.name}{'' if chart else ' (around the chart)'} "
            + " ".join(f"{value:.3f} ± {half:.2g}" for value, half in zip(one.gamma, one.half_width, strict=True))
            for shot, one, chart in seen.fits
        )
        lines.append(
            f"the shots contradict each other in gamma by {fit.contradiction:.0f} standard deviations: {each}; give only shots of "
            "one session, with one lens, or shoot the chart anew in even light"
        )
    return lines


def _wrong_black(fit: GammaFit) -> str:
    """Return that shots contradict the black level, by how much, and what to do."""
    offset, error = fit.offset
    span = fit.calibration.white_level - fit.calibration.black_level[-1]
    # In common on all planes, it is off by so much; unless gamma adds up to about 1: then that does not show.
    lever = 1 - float(fit.gamma.sum())
    codes, codes_error = (abs(value * span / lever) for value in (offset, error)) if abs(lever) > _LEVER else (np.nan, np.nan)
    direction = "higher" if offset / lever > 0 else "lower"
    seems = f": it seems to be {codes:.1f} ± {codes_error:.1g} codes {direction}" if codes > 0 else ""
    which, remedy = "that is assumed", "take dark frames (`dark`), and give them together with these shots"
    if fit.assumed.black_measured:
        which = "that the dark frames show"
        remedy = "take dark frames anew, with gain, exposure and temperature of the other shots, and the chart without reflections"
    return f"the shots contradict the black level {which} by {abs(fit.black_deviation):.0f} standard errors{seems}; {remedy}"


def _warnings(fit: GammaFit, shots: Sequence[ShotMeasurement]) -> list[str]:
    """Warn of an uncertain gamma, of residuals that noise does not explain, and of patches that were left out."""
    warnings = []
    tints = [tint for shot in shots if not shot.light and (tint := coloured_light(shot))]
    if fit.worst > _GOOD:
        remedy = "white light would help" if tints else "more light, a larger chart, more shots or flat frames (`flat`) would help"
        warnings.append(f"gamma is only known to ±{100 * fit.worst:.1f} % (95 %): {remedy}")
    warnings += tints
    if fit.spread > _SPREAD:
        warnings.append(
            f"the residuals are {fit.spread:.1f} times as large as noise explains: "
            "reflections, a dirty chart, or a sensor that is not linear"
        )
    for shot in shots:
        clipped = int(shot.places.clipped.sum())
        if clipped:
            warnings.append(
                f"{shot.name}: {clipped} of {PATCHES} patches are clipped and were left out; expose less to measure colours"
            )
        left_out = int((~shot.fits[0].used).sum()) - clipped
        if left_out > 0:
            warnings.append(f"{shot.name}: {left_out} patches do not fit the others and were left out (reflections, dust?)")
    return warnings


def _estimates(fit: GammaFit, evidence: Evidence) -> str:
    """List gamma, and the estimates that it was combined from."""
    rows = [
        (letter, f"{value:.4f}", f"{value - half:.4f} to {value + half:.4f}", f"±{100 * half / value:.2g} %")
        for letter, value, half in zip(evidence.channels, fit.gamma, fit.half_width, strict=True)
    ]
    shots = [
        (
            shot.name,
            ("around it", "chart")[chart],
            figures(one.gamma),
            figures(one.half_width),
            f"{int(one.used.sum())} of {one.used.size}",
        )
        for shot, one, chart in evidence.seen.fits
    ]
    facts = (
        f"Condition number of the colours: {fit.condition:.1f}, 1 is ideal. Residuals: {fit.spread:.2f} times what noise explains. "
        f"Offset of the panchromatic samples: {fit.black_deviation:+.1f} standard errors."
    )
    head = ("shot", "measured on", "gamma", "± (95 %)", "places used")
    return table(("channel", "gamma", "95 % interval", ""), rows) + f"<p>{escape(facts)}</p>" + table(head, shots)


def _chart(shot: ShotMeasurement) -> str:
    """Show where the chart was found and measured."""
    return figure(
        picture(reduced(shot.picture), "The shot with the measured places outlined"),
        f"{shot.name}: corners {shot.chart.place}, {shot.chart.place.pitch:.0f} pixels between patches. "
        "White: patches; magenta: their measured parts.",
    )


def _residuals(fits: Sequence[tuple[ShotMeasurement, GammaFit, bool]], colours: Sequence[str]) -> str:
    """Return a plot of how far predicted luminance is off at every place, in per cent.

    fits: see `Observations.fits`.
    colours: CSS colours of the patches.
    """
    off = [100 * (fit.predicted / np.maximum(fit.level, 1e-9) - 1) for _, fit, _ in fits]
    high = max(1.1 * float(np.quantile(np.abs(np.concatenate(off)), _SHOWN)), 0.1)
    highest = 1.05 * max(float(fit.level.max()) for _, fit, _ in fits)
    plot = axes((0, highest), (-high, high), "measured, part of full scale", "predicted - measured, %")
    plot.line([(0, 0), (highest, 0)], "ideal")
    for (shot, fit, chart), percent in zip(fits, off, strict=True):
        for index in range(0, fit.level.size, max(1, fit.level.size // _MOST_POINTS)):
            name = NAMES[index] if chart else "block"
            dashes, note = ("", "") if fit.used[index] else (";stroke-dasharray:2", " (left out)")
            text = f"{shot.name}, {name}: measured {fit.level[index]:.4f}, {percent[index]:+.2f} %{note}"
            size, style = 2, "fill:var(--soft);fill-opacity:.35"
            if chart:
                size, style = 5, f"fill:{colours[index]};stroke:var(--ink);stroke-width:.6{dashes}"
            plot.dot(fit.level[index], float(np.clip(percent[index], -high, high)), size, text, style)
    return figure(plot.drawn("Residuals of luminance"), "Places beyond the axis are drawn at its ends.")
