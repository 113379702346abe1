"""From measurements to a camera: each of its entries is concluded by itself, and none depends on
another.

`conclude_gamma`, `conclude_colour` and so on return a `Finding` each; `conclude` makes a camera of
them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from ...shared import Camera, DoubleArray, FloatArray, InputError, Shading
from ...shared.colorimetry import as_rows
from ...shared.lights import CalibratedLight, without_gamma
from .chart.place import NAMES
from .colour_matrix import FEWEST_CHANNELS, UNEVEN, ColourFit, fit_colour, light_change
from .gamma import SUFFERS, GammaFit, reconciled
from .measure import Measurements, ShotMeasurement
from .photon_transfer import SIGMAS, PhotonTransfer, contradiction, noise_of_flats
from .places import figures

# Of gamma.
_CONTRADICTION = 4.0  # standard errors: a larger one is not a coincidence
_BENT = 3.0  # standard errors, beyond what black explains: the sensor is not linear
# of an error of black common to all planes: the least share that shows in Eq. 7, so that it can be
# stated in codes
_LEVER = 0.2
_GOOD_GAMMA = 0.4  # half width over gamma, in units of what is allowed

# Of colour. See `light_change`. Right lights give 0.9 to 1.8 with measured sensitivities of two
# cameras; the rest is for lamps and daylight that are not quite what is said of them.
_LIKELY_CHANGE = (0.6, 1.9)
# Mean dE2000: an average chart in average light stays below; above it the colours are useless.
_GOOD_COLOUR, _USELESS_COLOUR = 4.0, 6.0
# dE2000 of a patch from the others, alone and over the mean: it has dirt, or a reflection
_ODD_COLOUR, _ODD = 15.0, 4.0

# Of what dark and flat frames show.
_MANY = 1e-3  # of the pixels
_BLIND = 0.01  # of the pixels: so many may be left out in the search for dead ones
_GOOD_READ, _GOOD_NOISE = 0.05, 0.1  # half width over read noise, and over variance at full scale

# Of a camera file that is updated.
_OF_BLACK = ("gamma", "noise", "colour", "shading")  # entries that a wrong black level makes wrong
_OF_SHADING, _TINTED = ("gamma", "colour"), 0.02  # and a share of the light that shows in these
_MOVED = 2.0  # standard errors of the black level, and 95 % intervals of gamma


@dataclass(frozen=True, eq=False)
class Finding:
    """One measured entry of a camera file: what it changes, how well it is known, and what a user
    has to know of it.

    Attributes
    ----------
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
    missing : str
        Why it was not measured, and the remedy; "" = it was, or what is usual.
    """

    facts: Mapping[str, Any] | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    contradictions: Sequence[str] = ()
    refusal: str = ""
    result: Any = None
    missing: str = ""


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a calibration.

    Attributes
    ----------
    measured
        What it was concluded from.
    findings
        What the frames show, or do not show: by the name in "measured" of camera.json.
    facts
        Sources of the measured entries: by that name.
    camera
        The camera; None if the frames cannot determine it.
    refusal
        The reason why there is no camera; "" if there is one.
    contradictions
        Sentences on what is wrong beyond doubt: the camera must not be used.
    warnings
        Sentences for the user.
    missing
        Entries that neither these frames nor the old camera file measured, and what to do.
    provenance
        Facts that every entry of the camera file records: date, program ...
    """

    measured: Measurements
    findings: Mapping[str, Finding]
    facts: Mapping[str, Mapping[str, Any]]
    camera: Camera | None
    refusal: str
    contradictions: tuple[str, ...]
    warnings: tuple[str, ...]
    missing: Mapping[str, str]
    provenance: Mapping[str, Any]

    @property
    def verdict(self) -> str:
        """The verdict: "use it", "use it with care" or "do not use it"."""
        if self.camera is None or self.contradictions:
            return "do not use it"
        return "use it with care" if self.warnings else "use it"

    @property
    def words(self) -> str:
        """The verdict, and what was not measured with the remedies, for people."""
        missing = (f"{name.replace('_', ' ')} ({why})" for name, why in self.missing.items())
        return "; not measured: ".join(filter(None, (self.verdict, ", ".join(missing))))


def conclude(measured: Measurements, provenance: Mapping[str, Any] | None = None) -> Result:
    """Combine all that was measured into one camera.

    measured: what was measured. What it shows replaces whole entries of the old camera file.
    provenance: facts that every entry of the camera file records. Raises InputError: no frame was
    read.
    """
    calibration = measured.calibration
    findings = {name: find(measured) for name, (find, _) in _ENTRIES.items()}
    changes = {name: value for entry in findings.values() for name, value in entry.changes.items()}
    made = provenance or {}
    sources = {
        name: {**made, **one.facts} for name, one in findings.items() if one.facts is not None
    }
    if calibration.noise and "noise" not in changes and "gamma" in changes:
        # Noise is in scene units, and the new gamma rescales these.
        rescaled = calibration.full_scale / math.fsum(changes["gamma"])
        changes["noise"] = calibration.noise.in_units_of(rescaled)
    refusal = "; ".join(entry.refusal for entry in findings.values() if entry.refusal)
    camera, known = None, measured.known | sources
    if (base := measured.base) and not refusal:
        camera = Camera(replace(calibration, **changes), base.pattern, known, base.shape)
    contradictions = tuple(line for entry in findings.values() for line in entry.contradictions)
    lines = [line for entry in findings.values() for line in entry.warnings]
    missing = {}
    for name, (_, remedy) in _ENTRIES.items():
        if name not in known and (name != "colour" or len(calibration.channels) >= FEWEST_CHANNELS):
            missing[name] = findings[name].missing or remedy
    lines += [f"{name.replace('_', ' ')}: not measured; {why}" for name, why in missing.items()]
    warnings = (*measured.remarks, *lines, *_outdated(measured, sources))
    told = contradictions, warnings, missing, made
    return Result(measured, findings, sources, camera, refusal, *told)


def _outdated(measured: Measurements, sources: Mapping[str, Any]) -> list[str]:
    """Return warnings of entries that are kept, and were measured with a black level, or with
    shading, that has turned out to be wrong.
    """
    if measured.old is None:
        return []
    before, wrong = measured.old.calibration, dict[str, tuple[str, ...]]()
    if measured.dark:
        moved = np.abs(measured.dark.black - np.array(before.black_level))
        if (moved > _MOVED * measured.assumed().black).any():
            wrong[f"the black level is {moved.max():.1f} codes off the one with which"] = _OF_BLACK
    if measured.shading:
        changed = float(np.abs(_tints(measured.shading.shading) / _tints(before.shading) - 1).max())
        if changed > _TINTED:
            off = f"colours fall off by up to {100 * changed:.1f} % otherwise than was known when"
            wrong[off] = _OF_SHADING
    lines, remedy = [], "give all frames together to measure these again"
    for off, entries in wrong.items():
        if kept := [entry for entry in measured.known if entry in entries and entry not in sources]:
            lines.append(f"{off} {', '.join(kept)} of the camera file were measured; {remedy}")
    return lines


def _tints(shading: Shading | None) -> FloatArray:
    """Return gains of the channels over that of panchromatic samples, see `Shading.sketch`."""
    return shading.sketch[:-1] / shading.sketch[-1] if shading else np.ones(1, np.float32)


# --- gamma ---------------------------------------------------------------------------------------


def conclude_gamma(measured: Measurements) -> Finding:
    """Return the weights of Eq. 7 as all shots show them together, and what does not fit
    together.
    """
    if not (gammas := measured.gammas):
        stated = ", ".join(f"{value:g}" for value in measured.calibration.gamma)
        line = f"it stays as the shots state it ({stated})"
        if len(measured.calibration.channels) >= FEWEST_CHANNELS:
            line += "; shoot a ColorChecker, and add it with `update`"
        return Finding(missing=line)
    black, others = _contradictions(measured)
    fit = max(gammas.values(), key=lambda each: each.worst)
    refusal = "; ".join(each.fault for each in gammas.values() if each.fault)
    # If only a black level that was assumed is contradicted, gamma covers it, and dark frames may
    # follow.
    if others or (black and (refusal or fit.assumed.black_measured)):
        refusal = "; ".join(black + others)
    facts = {
        "from": "the patches of a ColorChecker" + ", and even areas around it" * bool(fit.around),
        "shots": [shot.name for shot in measured.shots],
        "half_width_95": rounded(fit.half_width),
        "condition": round(fit.condition, 2),
        "residuals_over_noise": round(fit.spread, 2),
        "unexplained": round(fit.unexplained, 4),
    }
    changes, warnings = {"gamma": tuple(fit.gamma.tolist())}, _gamma_warnings(fit, measured.shots)
    old, lights = np.array(measured.calibration.gamma), measured.calibration.lights or ()
    if (before := measured.known.get("gamma")) and not any(light.gamma for light in lights):
        width = before.get("half_width_95", [0] * old.size)
        moved = float((np.abs(fit.gamma - old) / np.hypot(fit.half_width, width)).max())
        if moved > _MOVED:
            both = f"gamma was {figures(old)} in the camera file, and is {figures(fit.gamma)} now"
            apart = f"they differ by {moved:.0f} times their intervals (95 %)"
            warnings.append(f"{both}: {apart}; is this another camera, lens or light?")
    return Finding(facts, changes, warnings, black + others, refusal, fit)


def _contradictions(measured: Measurements) -> tuple[list[str], list[str]]:
    """Return what contradicts the black level, and what else does not fit together, by more than
    four standard errors, and what to shoot instead; a sentence each.
    """
    black, others = [], []
    remedy = "give only shots of one session, with one lens, or shoot the chart anew in even light"
    for light, fit in measured.gammas.items():
        is_linear = fit.bend[1] < _BENT
        if is_linear and abs(fit.black_deviation) > _CONTRADICTION:
            black.append(_wrong_black(fit))
        if is_linear and fit.unexplained > SUFFERS:
            others.append(_not_following(fit))
        if fit.contradiction > _CONTRADICTION:
            under = [shot for shot in measured.shots if light in ("", shot.light)]
            gammas = "; ".join(f"{shot.name} {shot.fit.words}" for shot in under)
            apart = f"by {fit.contradiction:.0f} standard deviations: {gammas}"
            others.append(f"the shots contradict each other in gamma {apart}; {remedy}")
    return black, others


def _wrong_black(fit: GammaFit) -> str:
    """Return that shots contradict the black level, by how much, and what to do."""
    offset, error = fit.offset
    calibration = fit.assumed.calibration
    span = calibration.white_level - calibration.black_level[-1]
    # In common on all planes, it is off by so much; unless gamma adds up to about 1: then that does
    # not show.
    lever, estimate = 1 - float(fit.gamma.sum()), ""
    if abs(lever) > _LEVER:
        codes, codes_error = (value * span / lever for value in (offset, error))
        direction = "higher" if codes > 0 else "lower"
        estimate = f": it seems to be {abs(codes):.1f} ± {abs(codes_error):.1g} codes {direction}"
    which = "that is assumed"
    remedy = "take dark frames (`dark`), and give them together with these shots"
    if fit.assumed.black_measured:
        which = "that the dark frames show"
        settings = "with gain, exposure and temperature of the other shots"
        remedy = f"take dark frames anew, {settings}, and the chart without reflections"
    errors = f"by {abs(fit.black_deviation):.0f} standard errors{estimate}"
    return f"the shots contradict the black level {which} {errors}; {remedy}"


def _not_following(fit: GammaFit) -> str:
    """Return by how much Eq. 7 does not hold, and what that may be."""
    letters = ", ".join(fit.assumed.calibration.channels)
    return (
        f"W does not follow from {letters}: the patches differ from Eq. 7 by "
        f"{100 * fit.unexplained:.1f} % beyond noise, and pictures suffer from "
        f"{100 * SUFFERS:.0f} % on; gamma of such a sensor depends on the light (`chart_light` "
        "keeps that of two), unless it is reflections, a dirty chart, or codes that are not linear"
    )


def _gamma_warnings(fit: GammaFit, shots: Sequence[ShotMeasurement]) -> list[str]:
    """Warn of an uncertain gamma, of residuals that noise does not explain, and of patches that
    were left out.
    """
    warnings = []
    if fit.worst > _GOOD_GAMMA * fit.limit:
        light = "white light" if any(shot.places.clipped.any() for shot in shots) else "more light"
        remedy = f"{light}, a larger chart, more shots or flat frames (`flat`) would help"
        warnings.append(f"gamma is only known to ±{100 * fit.worst:.1f} % (95 %): {remedy}")
    bend, sure = fit.bend
    if sure > _BENT:
        size = f"{100 * abs(bend):.0f} % too {'little' if bend < 0 else 'much'}"
        reads = f"at full scale it reads {size}, by {sure:.0f} standard errors"
        remedy = "expose less, or make its codes linear"
        warnings.append(f"the sensor is not linear: {reads}; {remedy}")
    elif not fit.follows and fit.unexplained <= SUFFERS:
        warnings.append(_not_following(fit))
    for shot in shots:
        clipped, unlike = shot.places.clipped, "unlike the others, avoid reflections and dirt"
        others = ~shot.fit.used & ~clipped
        for left_out, why in ((clipped, "clipped, expose less"), (others, unlike)):
            if names := ", ".join(np.array(NAMES)[left_out]):
                warnings.append(f"{shot.name}: {names} left out: {why}")
    return warnings


# --- colour --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ChartColours:
    """The colours of a chart.

    Attributes
    ----------
    shot : ShotMeasurement
        Of the chart.
    fit : ColourFit
        Matrix, neutral and light.
    gamma : tuple[float, ...]
        (C,), the weights of Eq. 7 with which they were measured.
    """

    shot: ShotMeasurement
    fit: ColourFit
    gamma: tuple[float, ...]


def conclude_colour(measured: Measurements) -> Finding:
    """Return the camera's colours: of every chart with enough patches that are not clipped those
    that predict the left-out patches best.

    Under two lights, those under each; the entry is refused unless both are known. Of two lights in
    a camera file that is updated, those that are not measured anew stay.
    """
    lights, two = measured.lights or ("",), (measured.old and measured.old.calibration.lights) or ()
    if two and measured.shots and not measured.lights:
        names = " and ".join(light.illuminant for light in two)
        line = f"the colours of the camera file, under {names}, stay as they are"
        remedy = "name the light of the chart (`chart_light`) to replace those under it"
        same = {"lights": without_gamma(measured.calibration.lights)}
        return Finding(changes=same, warnings=[f"{line}; {remedy}"])
    faults: list[str] = []
    charts = {light: _charts_under(measured, light, faults) for light in lights}
    if missing := [light for light in lights if not charts[light]]:
        if not measured.lights:
            return Finding(missing="; ".join(faults))
        why = "no chart without clipped patches was found under the light"
        found = [f"{why} {' and '.join(missing)}", *faults, *measured.skipped]
        return Finding(refusal="; ".join(found))
    best = [min(group, key=lambda chart: chart.fit.left_out.mean()) for group in charts.values()]
    kept = [light for light in two if len(lights) == 1 and light.illuminant not in lights]
    stored = replace(best[0].shot, name="the chart of the camera file")
    for light in kept:  # only its neutral is known: as if the chart here had been taken under it
        fit = replace(best[0].fit, neutral=np.array(light.neutral))
        charts[light.illuminant] = [replace(best[0], shot=stored, fit=fit)]
    if measured.lights and (wrong := _wrong_lights(charts)):
        return Finding(refusal=wrong)
    warnings, contradictions = [], []
    remedy = "light the chart evenly, and take flat frames (`flat`) if the lens darkens the corners"
    for chart in best:
        name, mean = chart.shot.name, float(chart.fit.difference.mean())
        off = f"{name}: the colours differ from the reference by a mean dE2000 of {mean:.1f}"
        unlike = np.array(NAMES)[chart.shot.places.exposed & ~chart.fit.used]
        fault = "does not fit the others, and was left out; avoid reflections and dirt"
        warnings += [f"{name}: the colour of {patch} {fault}" for patch in unlike]
        if (unevenness := chart.fit.unevenness) > UNEVEN:
            much = f"up to {unevenness:.2f} times brighter in one place than in another"
            fault = f"is uneven, {much}, and colours are only corrected for it in part"
            warnings.append(f"{name}: the light on the chart {fault}; {remedy}")
        if mean > _USELESS_COLOUR:
            contradictions.append(f"{off}, more than {_USELESS_COLOUR:.0f}")
        elif mean > _GOOD_COLOUR:
            warnings.append(f"{off}, more than {_GOOD_COLOUR:.0f}")
    of_charts = [_colour_facts(chart) for chart in best]
    pairs = [(chart.fit, chart.gamma) for chart in best]
    colours = [(as_rows(fit.matrix), tuple(fit.neutral.tolist()), gamma) for fit, gamma in pairs]
    facts, ((matrix, neutral, _), *_) = of_charts[0], colours
    changes: dict[str, Any] = {"camera_to_xyz": matrix, "neutral": neutral, "lights": None}
    if measured.lights:
        one = measured.calibration.gamma
        both = [CalibratedLight(light, *own) for light, own in zip(lights, colours, strict=True)]
        both += [replace(light, gamma=light.gamma or one) for light in kept]
        if "" in measured.gammas and not any(light.gamma for light in kept):
            both = [replace(light, gamma=None) for light in both]
        changes = {"lights": tuple(both), "neutral": None, "neutral_estimated": False}
        of_charts += [_kept_facts(measured.known.get("colour", {}), light) for light in kept]
        facts = {name: [chart.get(name) for chart in of_charts] for name in facts}
        facts = {"light": [light.illuminant for light in both], **facts}
    return Finding(facts, changes, warnings, contradictions, result=best)


def _charts_under(measured: Measurements, light: str, faults: list[str]) -> list[ChartColours]:
    """Return the charts under one light that show colours; the faults of others are added to
    `faults`.
    """
    gammas, charts = measured.gammas, []
    for shot in measured.shots:
        if shot.light != light:
            continue
        gamma = (gammas.get(light) or gammas[""]).gamma
        levels, used = reconciled(shot.places, gamma), shot.places.exposed
        try:
            fit = fit_colour(levels, measured.chart_colours, shot.chart.centres, used)
            odd = int(fit.left_out.argmax())
            if fit.left_out[odd] > max(_ODD_COLOUR, _ODD * fit.left_out.mean()):
                used = used & (np.arange(used.size) != odd)
                fit = fit_colour(levels, measured.chart_colours, shot.chart.centres, used)
        except InputError as error:
            faults.append(f"{shot.name}: {error}")
        else:
            charts.append(ChartColours(shot, fit, tuple(gamma.tolist())))
    return charts


def _colour_facts(chart: ChartColours) -> Mapping[str, Any]:
    """Return how well the colours of a chart are known, for camera.json."""
    fit = chart.fit
    return {
        "shot": chart.shot.name,
        "mean_dE2000": round(float(fit.difference.mean()), 3),
        "max_dE2000": round(float(fit.difference.max()), 3),
        "leave_one_out_dE2000": round(float(fit.left_out.mean()), 3),
        "light_unevenness": round(fit.unevenness, 3),
    }


def _kept_facts(facts: Mapping[str, Any], light: CalibratedLight) -> Mapping[str, Any]:
    """Return how well the colours under one of two lights of a camera file are known."""
    stated = {name: values for name, values in facts.items() if isinstance(values, list)}
    lights = [*map(str, stated.get("light", ()))]
    of_lights = {name: dict(zip(lights, values, strict=False)) for name, values in stated.items()}
    return {name: values.get(light.illuminant) for name, values in of_lights.items()}


def _wrong_lights(charts: dict[str, list[ChartColours]]) -> str:
    """Return which shots cannot be under the two lights that are named, and what to do; "" if
    all can.
    """
    (one, first), (other, second) = charts.items()
    lights, pairs = (one, other), product(first, second)
    changes = [(light_change(a.fit, b.fit, lights), a.shot.name, b.shot.name) for a, b in pairs]
    least, most = _LIKELY_CHANGE
    unlikely = [change for change in changes if not least <= change[0] <= most]
    if not unlikely:
        return ""
    change, warm, cold = min(unlikely)
    return (
        f"{warm} is given as under {one} and {cold} as under {other}, but white changes "
        f"{change:.1f} times as much from one to the other as between these lights, {least:g} to "
        f"{most:g} times are likely: name the light under which each was taken (`chart_light`), or "
        "take the chart anew under these two"
    )


# --- dark and flat frames ------------------------------------------------------------------------


def conclude_black_level(measured: Measurements) -> Finding:
    """Return the black level of each plane, and warnings of codes that are too coarse for the read
    noise, and of sites that differ.
    """
    if (dark := measured.dark) is None:
        return Finding()
    why = "the read noise is smaller than rounding to codes shows"
    coarse = f"{why}, so the dark frames do not tell it; use more gain or more bits"
    facts = {"frames": dark.frames, "standard_error": rounded(dark.black_error)}
    changes = {"black_level": measured.calibration.black_level}
    warnings = [] if dark.shows_read else [coarse]
    if dark.sites:
        differ = f"pixels of one colour differ in black level, by up to {dark.sites:.2g} codes"
        remedy = "let the camera correct the black level of each readout channel, if it can"
        warnings.append(f"{differ}, and shadows will show a pattern; {remedy}")
    return Finding(facts, changes, warnings)


def conclude_defects(measured: Measurements) -> Finding:
    """Return the defects.

    Those that the frames or the camera file state stay, unless dark and flat frames together do not
    show them: dark frames alone show no dead pixels, and flat ones no hot pixels.
    """
    dark, flats, stated = measured.dark, measured.flats, measured.stated_defects
    if measured.base is None:
        return Finding()
    before = stated | set(measured.calibration.defects)
    if not (dark or flats):
        return Finding(changes={"defects": tuple(before)})
    defects = {*(dark.defects if dark else ()), *(flats.dead if flats else ())}
    if not (dark and flats and flats.blind <= _BLIND):
        defects |= before
    fraction, warnings = len(defects) / measured.base.samples.size, []
    if gone := stated.difference(defects):
        unseen = "that the frames state show neither in dark nor in flat frames"
        warnings.append(f"{len(gone)} defects {unseen}, and are left out")
    if fraction > _MANY:
        warnings.append(f"there are many defective pixels: {len(defects)} ({100 * fraction:.2f} %)")
    if flats and flats.blind > _BLIND:
        where = f"to tell dead pixels in {100 * flats.blind:.0f} % of the frame"
        remedy = "expose the brightest pair up to three quarters of full scale"
        warnings.append(f"the flat frames are too dark, or too uneven, {where}; {remedy}")
    return Finding({"part_of_pixels": fraction}, {"defects": tuple(defects)}, warnings)


def conclude_noise(measured: Measurements) -> Finding:
    """Return the noise of each plane, and warnings if it is uncertain."""
    flats, dark, calibration = measured.flats, measured.dark, measured.calibration
    if not flats:
        return Finding(warnings=_stored_noise(measured))
    noise = noise_of_flats(flats, calibration, dark, measured.assumed().black)
    charts = [shot.places for shot in measured.shots]
    if fault := contradiction(noise.lines, calibration, dark, charts, noise.points):
        line = f"noise was left out: flat frames {', '.join(flats.names)}: {fault}"
        steady = "flat frames in steady light, no brighter than the sensor is linear"
        remedy = f"take all frames with one gain, and {steady}"
        return Finding(warnings=[f"{line}; {remedy}"])
    # In scene units noise is as uncertain as their size, which is that of gamma.
    full_scale, error, gamma = calibration.full_scale, 0.0, measured.gamma
    if gamma is not None:
        full_scale, error = float(gamma.gamma.sum()), float(gamma.covariance.sum()) ** 0.5
    shot, read, shot_own, read_own = np.array([astuple(line) for line in noise.lines]).T
    facts = {
        "from": noise.source,
        "shot_error": rounded(np.hypot(full_scale * shot_own, error * shot)),
        "read_error": rounded(np.hypot(full_scale * read_own, error * read)),
    }
    warnings = [*flats.flicker]
    if not noise.uncertainty <= _GOOD_NOISE:
        known = f"the noise at full scale is only known to ±{100 * noise.uncertainty:.0f} % (95 %)"
        warnings.append(f"{known}; take more pairs of flat frames (`flat`)")
    # In all but the darkest frames shot noise hides read noise.
    error = SIGMAS * max(line.read_error / max(line.read, 1e-12) for line in noise.lines)
    if error > _GOOD_READ and (dark is None or dark.shows_read):  # or dark frames cannot help
        known = f"only known to ±{100 * error:.0f} % (95 %)" if error < 1 else "unknown"
        warnings.append(f"read noise is {known}; take dark frames (`dark`), or more of them")
    return Finding(facts, {"noise": noise.model(full_scale)}, warnings, result=noise)


def _stored_noise(measured: Measurements) -> list[str]:
    """Return a warning if dark frames or charts contradict the noise of the camera file."""
    stated, calibration = measured.known.get("noise"), measured.calibration
    if stated is None or (model := calibration.noise) is None:
        return []
    errors = (stated.get(f"{name}_error", [0.0] * len(model.shot)) for name in ("shot", "read"))
    figures_of = np.array([model.shot, model.read, *errors]) / calibration.full_scale
    lines = tuple(PhotonTransfer(*plane) for plane in figures_of.T.tolist())
    charts = [shot.places for shot in measured.shots]
    fault = contradiction(lines, calibration, measured.dark, charts)
    remedy = "take flat frames (`flat`) with the gain of these frames, or these with that gain"
    where = f"noise in the camera file, from {stated.get('from', 'flat frames')}"
    return [f"{where}: {fault}; {remedy}"] if fault else []


def noise_change(old: Camera, new: Camera) -> tuple[str, bool]:
    """Return how far noise that was measured anew is from that of a camera file, for people, and
    whether it is beyond the intervals of both; "" = it was not replaced.
    """
    before, after = old.calibration.noise, new.calibration.noise
    facts = [camera.measured.get("noise", {}) for camera in (old, new)]
    if not before or not after or facts[0] == facts[1]:
        return "", False
    scales = np.array([[old.calibration.full_scale], [new.calibration.full_scale]])
    words, beyond = [], False
    for name, kind in (("shot", "photon noise"), ("read", "read noise")):
        key, values = f"{name}_error", np.array([getattr(before, name), getattr(after, name)])
        first, last = values / scales
        if all(key in of_noise for of_noise in facts):
            half = SIGMAS * (np.array([of_noise[key] for of_noise in facts]) / scales).sum(axis=0)
            beyond |= bool((np.abs(last - first) > half).any())
        moved = 100 * (last / np.maximum(first, 1e-12) - 1)
        words.append(f"{kind} by {moved.min():+.3g} to {moved.max():+.3g} %")
    return f"what is replaced moves: {', '.join(words)}", beyond


def conclude_shading(measured: Measurements) -> Finding:
    """Return how light falls off, for each plane, and a warning if black level was assumed."""
    if (result := measured.shading) is None:
        return Finding()
    # Light that is black in truth does not fall off.
    line = "shading was measured with a black level that is assumed; take dark frames (`dark`)"
    shading, warnings = result.shading, [] if measured.assumed().black_measured else [line]
    error = float(f"{result.error:.2g}")
    facts: dict[str, Any] = {"frames": result.frames, "standard_error": error}
    if shading:
        facts |= {"stops": round(shading.stops, 3), "colour": round(shading.colour, 4)}
        facts |= {"residual": shading.residual, "focal_length": shading.focal_length}
    return Finding(facts, {"shading": shading}, warnings, result=result)


def rounded(values: DoubleArray) -> list[float]:
    """Return numbers with three digits, for camera.json."""
    return [float(f"{value:.3g}") for value in values.tolist()]


_ENTRIES = {
    "gamma": (conclude_gamma, "shoot a ColorChecker"),
    "colour": (conclude_colour, "shoot a ColorChecker"),
    "noise": (conclude_noise, "take pairs of flat frames (`flat`), and dark frames (`dark`)"),
    "black_level": (conclude_black_level, "take dark frames (`dark`)"),
    "defects": (conclude_defects, "take dark and flat frames (`dark`, `flat`)"),
    "shading": (conclude_shading, "take flat frames (`flat`)"),
}
"""Key in "measured" of camera.json -> its finding, and the remedy where it was not measured."""
