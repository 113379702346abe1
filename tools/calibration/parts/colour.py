"""Colour: the matrix to XYZ and what white reads, from the chart that fits best."""

from collections.abc import Sequence
from functools import partial
from html import escape
from itertools import product

import numpy as np

from shared.arrays import DoubleArray
from shared.colorimetry import SRGB_TO_XYZ, as_rows
from shared.lights import CalibratedLight
from tools.io.colour_difference import delta_e_2000

from ..chart.place import COLUMNS, NAMES
from ..chart_gamma import reconciled
from ..colour_matrix import UNEVEN, VERY_UNEVEN, ColourFit, fit_colour, light_change, white_balanced
from ..observations import ShotMeasurement
from ..part import Evidence, Part, css_colours, table
from ..reference import ti3
from ..samples import figures
from .gamma import coloured_light

# See `light_change`. Right lights give 0.9 to 1.8 with measured sensitivities of two cameras; the rest is for lamps and daylight
# that are not quite what is said of them.
_LIKELY_CHANGE = (0.6, 1.9)
_CORRECTED = 2.5  # mean dE2000 of patches predicted from the others: below it the correction for uneven light has worked
_GOOD, _USELESS = 4.0, 6.0  # mean dE2000: an average chart in average light stays below; above it the colours are useless
_BRIGHT_GREYS = list(range(18, 21))  # white, neutral 8, neutral 6.5
Candidate = tuple[ColourFit, ShotMeasurement, DoubleArray]
"""A chart without clipped patches: its colours, its shot, and its levels (24, C)."""


def colour(evidence: Evidence) -> Part | None:
    """The camera's colours: of every chart without clipped patches those that predict the left-out patches best.

    Under two lights, those under each; the part is refused unless both are known.
    """
    lights = evidence.seen.lights
    if not lights:
        return _under(evidence, _candidates(evidence, ""))
    candidates = {light: _candidates(evidence, light) for light in lights}
    parts = {light: part for light in lights if (part := _under(evidence, candidates[light]))}
    if missing := [light for light in lights if light not in parts]:
        return Part("colour", refusal=f"no chart without clipped patches was found under the light {' and '.join(missing)}")
    if wrong := _wrong_lights(candidates):
        return Part("colour", refusal=wrong)
    every = list(parts.values())
    found = [CalibratedLight(light, part.changes["camera_to_xyz"], part.changes["neutral"]) for light, part in parts.items()]
    return Part(
        "colour",
        {"light": list(lights)} | {name: [(part.facts or {})[name] for part in every] for name in every[0].facts or ()},
        {"lights": tuple(found), "neutral": None, "neutral_estimated": False},
        [line for part in every for line in part.warnings],
        [line for part in every for line in part.contradictions],
        headline=" ".join(f"Under {light}: {part.headline}" for light, part in parts.items()),
        sections=lambda: {f"{name} under {light}": page for light, each in parts.items() for name, page in each.sections().items()},
    )


def _candidates(evidence: Evidence, light: str) -> list[Candidate]:
    """Return the charts under one light that show colours."""
    gamma, candidates = evidence.gamma, []
    for shot in evidence.seen.shots:
        if gamma is not None and shot.light == light and not shot.places.clipped.any():
            levels = reconciled(shot.places, gamma.gamma)
            candidates.append((fit_colour(levels, evidence.chart_colours, shot.chart.place.cells), shot, levels))
    return candidates


def _wrong_lights(candidates: dict[str, list[Candidate]]) -> str:
    """Return which shots cannot be under the two lights that are named, and what to do; "" if all can."""
    (one, first), (other, second) = candidates.items()
    changes = [(light_change(a[0], b[0], (one, other)), a[1].name, b[1].name) for a, b in product(first, second)]
    change, a, b = min(changes)
    least, most = _LIKELY_CHANGE
    if change <= -least:
        return (
            f"{a} is given as under {one} and {b} as under {other}, but white changes the other way from one to the other: the two "
            "lights are exchanged; name the light of each shot (`chart_light`)"
        )
    if change >= least:
        change, a, b = max(changes)
    if least <= change <= most:
        return ""
    return (
        f"{a} is given as under {one} and {b} as under {other}, but white changes {max(change, 0):.1f} times as much from one "
        f"to the other as between these lights, {least:g} to {most:g} times are likely: name the light under which each was taken "
        "(`chart_light`), or take the chart anew under these two"
    )


def _under(evidence: Evidence, candidates: Sequence[Candidate]) -> Part | None:
    """The colours of charts under one light; None if there are none."""
    if not candidates:
        return None
    chart_colours = evidence.chart_colours
    fit, shot, levels = min(candidates, key=lambda candidate: float(candidate[0].left_out.mean()))
    known, before = shot.calibration.camera_to_xyz, None
    if known is not None or evidence.channels == "RGB":
        before = white_balanced(levels, chart_colours, np.array(known if known is not None else SRGB_TO_XYZ))
    mean, left_out = float(fit.difference.mean()), float(fit.left_out.mean())
    warnings, off = [], f"{shot.name}: the colours differ from the reference by a mean dE2000 of {mean:.1f}, more than"
    # In strongly coloured light other errors are corrected as uneven light.
    if fit.unevenness > (UNEVEN if left_out > _CORRECTED else VERY_UNEVEN) and not coloured_light(shot):
        warnings.append(
            f"{shot.name}: the light on the chart is uneven, up to {fit.unevenness:.2f} times brighter in one place than in "
            "another, and colours are only corrected for it in part; light the chart evenly, and take flat frames (`flat`) if the "
            "lens darkens the corners"
        )
    if _GOOD < mean <= _USELESS:
        warnings.append(f"{off} {_GOOD:.0f}")
    return Part(
        "colour",
        {
            "shot": shot.name,
            "mean_dE2000": round(mean, 3),
            "mean_dE2000_before": None if before is None else round(float(delta_e_2000(before, fit.reference).mean()), 3),
            "max_dE2000": round(float(fit.difference.max()), 3),
            "leave_one_out_dE2000": round(left_out, 3),
            "light_unevenness": round(fit.unevenness, 3),
        },
        {"camera_to_xyz": as_rows(fit.matrix), "neutral": tuple(fit.neutral.tolist()), "lights": None},
        warnings,
        [f"{off} {_USELESS:.0f}"] if mean > _USELESS else (),
        headline=f"The colours match the reference to a mean ΔE2000 of {mean:.2f} (leave-one-out: {left_out:.2f}).",
        sections=partial(_sections, fit, shot.name, before),
        files=_profile(chart_colours, levels / fit.light[:, None], fit.neutral),
    )


def _profile(chart_colours: DoubleArray, even: DoubleArray, neutral: DoubleArray) -> dict[str, bytes]:
    """Return a file for Argyll CMS, if there are three channels: levels under even light, 1 = what white reads in the largest."""
    if even.shape[1] != 3:
        return {}
    scale = float((chart_colours[_BRIGHT_GREYS, 1] / (even[_BRIGHT_GREYS] / neutral).mean(axis=1)).mean())
    return {"chart.ti3": ti3(chart_colours, even * scale).encode()}


def _sections(fit: ColourFit, shot: str, before: DoubleArray | None) -> dict[str, str]:
    """Show the patches before and after, the colour differences, the matrix, and the light on the chart.

    shot: name.
    before: (24, 3), L*a*b* of its patches with the matrix in the shot (without one: sRGB primaries); None = there is neither.
    """
    versions = {} if before is None else {"before (only white balance, or the shot's own matrix)": before}
    differences = {name: delta_e_2000(lab, fit.reference) for name, lab in versions.items()} | {
        "matrix, light treated as even": fit.plain,
        "matrix, corrected for uneven light": fit.difference,
        "the same, leave-one-out (each patch predicted from the others)": fit.left_out,
    }
    rows = [(name, f"{each.mean():.2f}", f"{each.max():.2f}") for name, each in differences.items()]
    matrix = table((), [tuple(f"{value:+.4f}" for value in row) for row in fit.matrix])
    page = (
        f"<p>From {escape(shot)}. Each patch shows, from left to right: {'before, ' * len(versions)}after, reference.</p>"
        f'<div class="patches">{_patches(fit, [*versions.values(), fit.lab, fit.reference])}</div>'
        f"{table(('ΔE2000', 'mean', 'maximum'), rows)}"
        f'<div class="pair"><div><h3>Matrix from scene units to XYZ (D50)</h3>{matrix}'
        f"<p>White reads {figures(fit.neutral)}.</p></div>"
        f"<div><h3>Light on the chart</h3>{_light(fit.light)}<p>Brightest over dimmest: {fit.unevenness:.2f}.</p></div></div>"
    )
    return {"Colour": page}


def _patches(fit: ColourFit, versions: Sequence[DoubleArray]) -> str:
    """Show each patch in its colours of several versions, L*a*b* (24, 3), side by side."""
    stripes, page = map(css_colours, versions), ""
    for name, difference, *colours in zip(NAMES, fit.difference, *stripes, strict=True):
        striped = "".join(f'<i style="background:{css}"></i>' for css in colours)
        page += f'<div class="patch" title="{name}"><b>{striped}</b><span>{name}</span><span>ΔE {difference:.1f}</span></div>'
    return page


def _light(light: DoubleArray) -> str:
    """Show the relative illumination (24,) of each patch."""
    bright = 45 + 45 * np.clip((light - light.min()) / max(float(np.ptp(light)), 0.1), 0, 1)
    cells = (
        f'<div style="background:hsl(45 85% {tone:.0f}%)">{value:.2f}</div>' for value, tone in zip(light, bright, strict=True)
    )
    return f'<div class="light" style="grid-template-columns:repeat({COLUMNS},1fr)">{"".join(cells)}</div>'
