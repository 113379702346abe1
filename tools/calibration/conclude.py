"""From measurements to a camera: each of its parts is concluded by itself, and none depends on
another.

`conclude_gamma`, `conclude_colour` and so on return a `Part` each; `conclude` makes a camera of
them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from ...shared import Camera
from ...shared.arrays import DoubleArray
from ...shared.colorimetry import SRGB_TO_XYZ, as_rows
from ...shared.errors import InputError
from ...shared.lights import CalibratedLight
from ..io.colour_difference import delta_e_2000
from .chart.place import PATCHES
from .colour_matrix import (
    FEWEST_CHANNELS,
    GREYS,
    UNEVEN,
    VERY_UNEVEN,
    ColourFit,
    fit_colour,
    light_change,
    white_balanced,
)
from .dark_frames import DarkResult
from .gamma import GammaFit, check_determined, reconciled
from .measure import Measurements, ShotMeasurement
from .noise import SIGMAS, NoiseResult, noise_of_flats

# Of gamma.
_CONTRADICTION = 4.0  # standard errors: a larger one is not a coincidence
# of an error of black common to all planes: the least share that shows in Eq. 7, so that it can be
# stated in codes
_LEVER = 0.2
_UNEVEN_BLACK = 1 / 128  # of the black level, by which planes may differ: 2 codes of 256
_SPREAD = 2.5  # residuals over noise: larger ones have another cause than noise
_GOOD_GAMMA = 0.4  # half width over gamma, in units of what is allowed
# of the brightest channel: in daylight and in the light of a bulb, grey reads more in each of three
# broad channels
_COLOURED = 0.2

# Of colour. See `light_change`. Right lights give 0.9 to 1.8 with measured sensitivities of two
# cameras; the rest is for lamps and daylight that are not quite what is said of them.
_LIKELY_CHANGE = (0.6, 1.9)
# mean dE2000 of patches predicted from the others: below it the correction for uneven light has
# worked
_CORRECTED = 2.5
# Mean dE2000: an average chart in average light stays below; above it the colours are useless.
_GOOD_COLOUR, _USELESS_COLOUR = 4.0, 6.0

# Of what dark and flat frames show.
_MANY = 1e-3  # of the pixels
_NAMED = 5  # defects that a warning lists
_BLIND = 0.01  # of the pixels: so many may be left out in the search for dead ones
_GOOD_READ, _GOOD_NOISE = 0.05, 0.1  # half width over read noise, and over variance at full scale

# Of a camera file that is updated.
_OF_BLACK = ("gamma", "noise", "colour", "shading")  # parts that a wrong black level makes wrong
_MOVED = 2.0  # standard errors of the black level


@dataclass(frozen=True, eq=False)
class Part:
    """One measured part of a camera: what it changes, how well it is known, and what a user has to
    know of it.

    Attributes
    ----------
    name : str
        Its key in "measured" of camera.json.
    facts : Mapping[str, Any] | None
        For camera.json: how it was measured, and how well it is known; None = it was not, and only
        its warnings count.
    changes : Mapping[str, Any]
        Fields of the calibration, and their values.
    warnings : Sequence[str]
        Sentences for the user.
    contradictions : Sequence[str]
        Sentences on what is wrong beyond doubt: the camera must not be used.
    refusal : str
        Why there must not be a camera file; "" = there may be one.
    result : Any
        The fit, for the report.
    """

    name: str
    facts: Mapping[str, Any] | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    contradictions: Sequence[str] = ()
    refusal: str = ""
    result: Any = None


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a calibration.

    Attributes
    ----------
    seen
        What it was concluded from.
    parts
        What the frames show, or say that they do not show: by the name in "measured" of
        camera.json.
    camera
        The camera; None if the frames cannot determine it.
    refusal
        The reason why there is no camera; "" if there is one.
    contradictions
        Sentences on what is wrong beyond doubt: the camera must not be used.
    warnings
        Sentences for the user.
    """

    seen: Measurements
    parts: Mapping[str, Part]
    camera: Camera | None
    refusal: str
    contradictions: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def facts(self) -> dict[str, Mapping[str, Any]]:
        """Sources of the measured parts: by the name in "measured" of camera.json."""
        return {name: part.facts for name, part in self.parts.items() if part.facts is not None}

    @property
    def verdict(self) -> str:
        """The verdict: "use it", "use it with care" or "do not use it"."""
        if self.camera is None or self.contradictions:
            return "do not use it"
        return "use it with care" if self.warnings else "use it"


def conclude(seen: Measurements, provenance: Mapping[str, Any] | None = None) -> Result:
    """Combine all that was measured into one camera.

    Parameters
    ----------
    seen
        What was measured. What it shows replaces whole parts of the old camera file.
    provenance
        Facts that every part of the camera file records.

    Raises
    ------
    InputError
        No frame was read.
    """
    calibration = seen.calibration
    parts = {part.name: part for conclude_part in _PARTS if (part := conclude_part(seen))}
    changes: dict[str, Any] = {}
    measured: dict[str, Any] = {}
    for name, part in parts.items():
        changes |= part.changes
        if part.facts is not None:
            measured[name] = {**(provenance or {}), **part.facts}
    if calibration.noise and "noise" not in changes and "gamma" in changes:
        # Noise is in scene units, and the new gamma rescales these.
        rescaled = calibration.full_scale / math.fsum(changes["gamma"])
        changes["noise"] = calibration.noise.in_units_of(rescaled)
    refusal = "; ".join(part.refusal for part in parts.values() if part.refusal)
    camera = None
    if seen.base and not refusal:
        base, parts_of = seen.base, {**seen.known, **measured}
        camera = Camera(replace(calibration, **changes), base.pattern, parts_of, base.shape)
    contradictions = tuple(line for part in parts.values() for line in part.contradictions)
    warned = [line for part in parts.values() for line in part.warnings]
    warnings = (*seen.remarks, *warned, *_outdated(seen, measured))
    return Result(seen, parts, camera, refusal, contradictions, warnings)


def _outdated(seen: Measurements, measured: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a warning of parts that are kept, and were measured with a black level that has turned
    out to be wrong.
    """
    kept = [part for part in seen.known if part in _OF_BLACK and part not in measured]
    if not (kept and seen.old and seen.dark):
        return ()
    moved = seen.dark.black - np.array(seen.old.calibration.black_level)
    if not (np.abs(moved) > _MOVED * seen.assumed().black).any():
        return ()
    return (
        f"the black level is {np.abs(moved).max():.1f} codes off the one with which "
        f"{', '.join(kept)} of the camera file were "
        "measured; give all frames together to measure these again",
    )


# --- gamma ---------------------------------------------------------------------------------------


def conclude_gamma(seen: Measurements) -> Part | None:
    """Return the weights of Eq. 7 as all shots show them together, and what does not fit
    together.
    """
    fit = seen.gamma
    if fit is None:
        stated = ", ".join(f"{value:g}" for value in seen.calibration.gamma)
        line = f"gamma was not measured, and stays as the shots state it ({stated})"
        if len(seen.calibration.channels) >= FEWEST_CHANNELS:
            line += "; shoot a ColorChecker, and add it with `update`"
        return None if "gamma" in seen.known else Part("gamma", warnings=[line])
    refusal, contradictions = "", _contradictions(fit, seen.shots)
    try:
        check_determined(fit)
    except InputError as error:
        refusal = str(error)
    # If only a black level that was assumed is contradicted, gamma covers it, and dark frames may
    # follow.
    if contradictions and (
        refusal or fit.assumed.black_measured or fit.contradiction > _CONTRADICTION
    ):
        refusal = "; ".join(contradictions)
    return Part(
        "gamma",
        {
            "from": "the patches of a ColorChecker",
            "shots": [shot.name for shot in seen.shots],
            "half_width_95": rounded(fit.half_width),
            "condition": round(fit.condition, 2),
            "residuals_over_noise": round(fit.spread, 2),
        },
        {"gamma": tuple(fit.gamma.tolist())},
        _gamma_warnings(fit, seen.shots),
        contradictions,
        refusal,
        fit,
    )


def black_error(seen: Measurements) -> DoubleArray:
    """Return how far the black level may be off, (C + 1,), codes: by what is assumed, and by what
    shots show of it.
    """
    assumed, fit = seen.assumed(), seen.gamma
    if fit is None or assumed.black_measured:
        return assumed.black
    offset, error = fit.offset
    black = np.array(fit.calibration.black_level)
    # On all planes in common, and on each by itself.
    lever = max(abs(1 - float(fit.gamma.sum())), _LEVER)
    common = np.hypot(offset, error) / lever * (fit.calibration.white_level - black)
    return np.minimum(assumed.black, np.hypot(common, _UNEVEN_BLACK * black))


def coloured_light(shot: ShotMeasurement) -> str:
    """Return what strongly coloured light does to a shot of the chart, "" if the light is not: it
    shows on the grey patches.
    """
    grey = shot.places.mean[list(GREYS), :-1].mean(axis=0)
    if grey.min() > _COLOURED * grey.max():
        return ""
    letters = shot.fit.calibration.channels
    weak, strong = letters[int(grey.argmin())], letters[int(grey.argmax())]
    return (
        f"{shot.name}: the light is strongly coloured: on grey {weak} reads "
        f"{100 * max(grey.min(), 0) / grey.max():.0f} % of what "
        f"{strong} does, so that colours, and gamma of {weak}, are known less well; take white "
        "light"
    )


def _contradictions(fit: GammaFit, shots: Sequence[ShotMeasurement]) -> list[str]:
    """Return what does not fit together by more than four standard errors, and what to shoot
    instead; a sentence each.
    """
    lines = []
    if abs(fit.black_deviation) > _CONTRADICTION:
        lines.append(_wrong_black(fit))
    if fit.contradiction > _CONTRADICTION:
        each = ", ".join(
            " ".join(
                [
                    shot.name,
                    *(
                        f"{value:.3f} ± {half:.2g}"
                        for value, half in zip(shot.fit.gamma, shot.fit.half_width, strict=True)
                    ),
                ]
            )
            for shot in shots
        )
        lines.append(
            f"the shots contradict each other in gamma by {fit.contradiction:.0f} standard "
            f"deviations: {each}; give only shots of "
            "one session, with one lens, or shoot the chart anew in even light"
        )
    return lines


def _wrong_black(fit: GammaFit) -> str:
    """Return that shots contradict the black level, by how much, and what to do."""
    offset, error = fit.offset
    span = fit.calibration.white_level - fit.calibration.black_level[-1]
    # In common on all planes, it is off by so much; unless gamma adds up to about 1: then that does
    # not show.
    lever, seems = 1 - float(fit.gamma.sum()), ""
    if abs(lever) > _LEVER:
        codes, codes_error = (abs(value * span / lever) for value in (offset, error))
        direction = "higher" if offset / lever > 0 else "lower"
        seems = f": it seems to be {codes:.1f} ± {codes_error:.1g} codes {direction}"
    which = "that is assumed"
    remedy = "take dark frames (`dark`), and give them together with these shots"
    if fit.assumed.black_measured:
        which = "that the dark frames show"
        remedy = (
            "take dark frames anew, with gain, exposure and temperature of the other "
            "shots, and the chart without reflections"
        )
    return (
        f"the shots contradict the black level {which} by {abs(fit.black_deviation):.0f} "
        f"standard errors{seems}; {remedy}"
    )


def _gamma_warnings(fit: GammaFit, shots: Sequence[ShotMeasurement]) -> list[str]:
    """Warn of an uncertain gamma, of residuals that noise does not explain, and of patches that
    were left out.
    """
    warnings = []
    tints = [tint for shot in shots if not shot.light and (tint := coloured_light(shot))]
    if fit.worst > _GOOD_GAMMA * fit.limit:
        remedy = "more light, a larger chart, more shots or flat frames (`flat`)"
        known = f"gamma is only known to ±{100 * fit.worst:.1f} % (95 %)"
        warnings.append(f"{known}: {'white light' if tints else remedy} would help")
    warnings += tints
    if fit.spread > _SPREAD:
        warnings.append(
            f"the residuals are {fit.spread:.1f} times as large as noise explains: "
            "reflections, a dirty chart, or a sensor that is not linear"
        )
    for shot in shots:
        clipped = int(shot.places.clipped.sum())
        if clipped:
            part = f"{clipped} of {PATCHES} patches are clipped and were left out"
            warnings.append(f"{shot.name}: {part}; expose less to measure colours")
        left_out = int((~shot.fit.used).sum()) - clipped
        if left_out > 0:
            part = f"{left_out} patches do not fit the others and were left out"
            warnings.append(f"{shot.name}: {part} (reflections, dust?)")
    return warnings


# --- colour --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ChartColours:
    """The colours of a chart without clipped patches.

    Attributes
    ----------
    shot : ShotMeasurement
        Of the chart.
    fit : ColourFit
        Matrix, neutral and light.
    before : DoubleArray | None
        L*a*b* of the patches with the matrix in the shot (without one: sRGB primaries), (24, 3);
        None = there is neither.
    """

    shot: ShotMeasurement
    fit: ColourFit
    before: DoubleArray | None


def conclude_colour(seen: Measurements) -> Part | None:
    """Return the camera's colours: of every chart without clipped patches those that predict the
    left-out patches best.

    Under two lights, those under each; the part is refused unless both are known.
    """
    lights = seen.lights or ("",)
    charts = {light: _charts_under(seen, light) for light in lights}
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
        off = (
            f"{chart.shot.name}: the colours differ from the reference by a mean dE2000 of "
            f"{mean:.1f}, more than"
        )
        warnings += _uneven_warnings(chart)
        if mean > _USELESS_COLOUR:
            contradictions.append(f"{off} {_USELESS_COLOUR:.0f}")
        elif mean > _GOOD_COLOUR:
            warnings.append(f"{off} {_GOOD_COLOUR:.0f}")
    facts = [_colour_facts(chart) for chart in best]
    found = [(as_rows(chart.fit.matrix), tuple(chart.fit.neutral.tolist())) for chart in best]
    every: dict[str, Any] = facts[0]
    changes: dict[str, Any] = {"camera_to_xyz": found[0][0], "neutral": found[0][1], "lights": None}
    if seen.lights:
        every = {"light": list(lights)} | {name: [fact[name] for fact in facts] for name in every}
        both = (CalibratedLight(light, *each) for light, each in zip(lights, found, strict=True))
        changes = {"lights": tuple(both), "neutral": None, "neutral_estimated": False}
    return Part("colour", every, changes, warnings, contradictions, result=best)


def _charts_under(seen: Measurements, light: str) -> list[ChartColours]:
    """Return the charts under one light that show colours."""
    gamma, charts = seen.gamma, []
    for shot in seen.shots:
        if gamma is not None and shot.light == light and not shot.places.clipped.any():
            levels = reconciled(shot.places, gamma.gamma)
            known, before = shot.fit.calibration.camera_to_xyz, None
            if known is not None or shot.fit.calibration.channels == "RGB":
                matrix = np.array(SRGB_TO_XYZ if known is None else known)
                before = white_balanced(levels, seen.chart_colours, matrix)
            fit = fit_colour(levels, seen.chart_colours, shot.chart.place.cells)
            charts.append(ChartColours(shot, fit, before))
    return charts


def _colour_facts(chart: ChartColours) -> dict[str, object]:
    """Return how well the colours of a chart are known, for camera.json."""
    fit, before = chart.fit, chart.before
    return {
        "shot": chart.shot.name,
        "mean_dE2000": round(float(fit.difference.mean()), 3),
        "mean_dE2000_before": None
        if before is None
        else round(float(delta_e_2000(before, fit.reference).mean()), 3),
        "max_dE2000": round(float(fit.difference.max()), 3),
        "leave_one_out_dE2000": round(float(fit.left_out.mean()), 3),
        "light_unevenness": round(fit.unevenness, 3),
    }


def _uneven_warnings(chart: ChartColours) -> list[str]:
    """Warn of uneven light on a chart."""
    unevenness = chart.fit.unevenness
    least = UNEVEN if chart.fit.left_out.mean() > _CORRECTED else VERY_UNEVEN
    # In strongly coloured light other errors are corrected as uneven light.
    if unevenness <= least or coloured_light(chart.shot):
        return []
    return [
        f"{chart.shot.name}: the light on the chart is uneven, up to {unevenness:.2f} times "
        "brighter in one place than in "
        "another, and colours are only corrected for it in part; light the chart evenly, and "
        "take flat frames (`flat`) if the "
        "lens darkens the corners"
    ]


def _wrong_lights(charts: dict[str, list[ChartColours]]) -> str:
    """Return which shots cannot be under the two lights that are named, and what to do; "" if
    all can.
    """
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
            f"{said} the other way from one to the other: the two lights are exchanged; name "
            "the light of each shot (`chart_light`)"
        )
    return (
        f"{said} {max(change, 0):.1f} times as much from one to the other as between these "
        f"lights, {least:g} to {most:g} times are "
        "likely: name the light under which each was taken (`chart_light`), or take the chart "
        "anew under these two"
    )


# --- dark and flat frames ------------------------------------------------------------------------


def conclude_black_level(seen: Measurements) -> Part | None:
    """Return the black level of each plane, and a warning of codes that are too coarse for the read
    noise.
    """
    dark = seen.dark
    if dark is None:
        return None
    coarse = (
        "the read noise is smaller than rounding to codes shows, so the dark frames do not "
        "tell it; use more gain or more bits"
    )
    return Part(
        "black_level",
        {"frames": dark.frames, "standard_error": rounded(dark.black_error)},
        {"black_level": seen.calibration.black_level},
        warnings=() if dark.shows_read else (coarse,),
        result=dark,
    )


def conclude_defects(seen: Measurements) -> Part | None:
    """Return the defects.

    Those that the frames or the camera file state stay, unless dark and flat frames together do not
    show them: dark frames alone show no dead pixels, and flat ones no hot pixels.
    """
    dark, flats, stated = seen.dark, seen.flats, seen.stated_defects
    if seen.base is None:
        return None
    shown = {*(dark.defects if dark else ()), *(flats.dead if flats else ())}
    before = stated | set(seen.calibration.defects)
    if not (dark or flats):
        return Part("defects", changes={"defects": tuple(sorted(before))}) if stated else None
    found = sorted(shown if dark and flats and flats.blind <= _BLIND else shown | before)
    part, warnings = len(found) / seen.base.samples.size, []
    if gone := sorted(stated.difference(found)):
        named = [f"{row} {column}" for row, column in gone]
        places = ", ".join(named[:_NAMED] + ["..."] * (len(named) > _NAMED))
        warnings.append(
            f"{len(gone)} defects that the frames state show neither in dark nor in flat frames, "
            "and are left out (row and column "
            f"{places})"
        )
    if part > _MANY:
        warnings.append(f"there are many defective pixels: {len(found)} ({100 * part:.2f} %)")
    if flats and flats.blind > _BLIND:
        warnings.append(
            "the flat frames are too dark, or too uneven, to tell dead pixels in "
            f"{100 * flats.blind:.0f} % of the frame; "
            "expose the brightest pair up to three quarters of full scale"
        )
    return Part("defects", {"part_of_pixels": part}, {"defects": tuple(found)}, warnings)


def conclude_noise(seen: Measurements) -> Part | None:
    """Return the noise of each plane."""
    if not seen.flats:
        remedy = "take pairs of flat frames (`flat`), and dark frames (`dark`)"
        line = f"noise was not measured; {remedy}"
        return Part("noise", warnings=[line]) if seen.shots and "noise" not in seen.known else None
    found = noise_of_flats(seen.flats, seen.calibration, seen.dark, black_error(seen))
    # In scene units noise is as uncertain as their size, which is that of gamma.
    full_scale, error, gamma = seen.calibration.full_scale, 0.0, seen.gamma
    if gamma is not None:
        full_scale, error = float(gamma.gamma.sum()), float(gamma.covariance.sum()) ** 0.5
    shot, read, shot_own, read_own = np.array([astuple(line) for line in found.lines]).T
    shot_error = np.hypot(full_scale * shot_own, error * shot)
    read_error = np.hypot(full_scale * read_own, error * read)
    return Part(
        "noise",
        {
            "from": found.source,
            "shot_error": rounded(shot_error),
            "read_error": rounded(read_error),
        },
        {"noise": found.model(full_scale)},
        _noise_warnings(found, seen.dark),
        result=found,
    )


def _noise_warnings(noise: NoiseResult, dark: DarkResult | None) -> list[str]:
    """Warn of an uncertain gain, and of an uncertain read noise: in all but the darkest frames shot
    noise hides it.
    """
    warnings = []
    if not noise.uncertainty <= _GOOD_NOISE:
        warnings.append(
            f"the noise at full scale is only known to ±{100 * noise.uncertainty:.0f} % (95 %); "
            "take more pairs of flat frames (`flat`)"
        )
    part = SIGMAS * max(line.read_error / max(line.read, 1e-12) for line in noise.lines)
    if part > _GOOD_READ:
        known = f"only known to ±{100 * part:.0f} % (95 %)" if part < 1 else "unknown"
        if dark is not None and dark.shows_read:
            warnings.append(f"read noise is {known}; take more dark frames (`dark`)")
        else:
            instead = "; take dark frames (`dark`)" if dark is None else " either"
            why = f"because {noise.source} hardly show it{instead}"
            warnings.append(f"read noise is {known}, {why}")
    return warnings


def conclude_shading(seen: Measurements) -> Part | None:
    """Return how light falls off, for each plane, and a warning if its error is that of an assumed
    black level.
    """
    found = seen.shading
    if found is None:
        return None
    gain, error, warnings = found.shading, found.error, []
    if not seen.assumed().black_measured:  # light that is black in truth does not fall off
        error = float(np.hypot(error, found.error_of_black(black_error(seen))))
        warnings.append(
            "shading was measured with a black level that is assumed, and so is only known to "
            f"±{100 * error:.2g} % in the "
            "corners (standard error); take dark frames (`dark`)"
        )
    facts: dict[str, Any] = {"frames": found.frames, "standard_error": float(f"{error:.2g}")}
    if gain:
        facts |= {"stops": round(gain.stops, 3), "colour": round(gain.colour, 4)}
        facts |= {"residual": gain.residual, "focal_length": gain.focal_length}
    return Part("shading", facts, {"shading": gain}, warnings, result=found)


def rounded(values: DoubleArray) -> list[float]:
    """Return numbers with three digits, for camera.json."""
    return [float(f"{value:.3g}") for value in values.tolist()]


_PARTS = (
    conclude_gamma,
    conclude_colour,
    conclude_noise,
    conclude_black_level,
    conclude_defects,
    conclude_shading,
)
