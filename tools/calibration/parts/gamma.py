"""Gamma (Eq. 7), from all shots of charts."""

from collections.abc import Sequence

import numpy as np

from ....shared.arrays import DoubleArray
from ....shared.errors import InputError
from ..chart.place import PATCHES
from ..colour_matrix import GREYS
from ..gamma import GammaFit, check_determined
from ..measure import Measurements, ShotMeasurement
from .part import Part, rounded

_CONTRADICTION = 4.0  # standard errors: a larger one is not a coincidence
_LEVER = 0.2  # of an error of black common to all planes: the least share that shows in Eq. 7, so that it can be stated in codes
_UNEVEN_BLACK = 1 / 128  # of the black level, by which planes may differ: 2 codes of 256
_SPREAD = 2.5  # residuals over noise: larger ones have another cause than noise
_GOOD = 0.02  # half width over gamma
_COLOURED = 0.2  # of the brightest channel: in daylight and in the light of a bulb, grey reads more in each of three broad channels


def gamma(seen: Measurements) -> Part | None:
    """Return the weights of Eq. 7 as all shots show them together, and what does not fit together."""
    fit = seen.gamma
    if fit is None:
        stated = ", ".join(f"{value:g}" for value in seen.calibration.gamma)
        line = f"gamma was not measured, and stays as the shots state it ({stated})"
        remedy = "shoot a ColorChecker, and add it with `update`"
        return None if "gamma" in seen.known else Part("gamma", warnings=[f"{line}; {remedy}"])
    refusal, contradictions = "", _contradictions(fit, seen.shots)
    try:
        check_determined(fit)
    except InputError as error:
        refusal = str(error)
    # If only a black level that was assumed is contradicted, gamma covers it, and dark frames may follow.
    if contradictions and (refusal or fit.assumed.black_measured or fit.contradiction > _CONTRADICTION):
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
        _warnings(fit, seen.shots),
        contradictions,
        refusal,
        fit,
    )


def black_error(seen: Measurements) -> DoubleArray:
    """Return how far the black level may be off, (C + 1,), codes: by what is assumed, and by what shots show of it."""
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


def _contradictions(fit: GammaFit, shots: Sequence[ShotMeasurement]) -> list[str]:
    """Return what does not fit together by more than four standard errors, and what to shoot instead; a sentence each."""
    lines = []
    if abs(fit.black_deviation) > _CONTRADICTION:
        lines.append(_wrong_black(fit))
    if fit.contradiction > _CONTRADICTION:
        each = ", ".join(
            " ".join(
                [shot.name, *(f"{value:.3f} ± {half:.2g}" for value, half in zip(shot.fit.gamma, shot.fit.half_width, strict=True))]
            )
            for shot in shots
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
    lever, seems = 1 - float(fit.gamma.sum()), ""
    if abs(lever) > _LEVER:
        codes, codes_error = (abs(value * span / lever) for value in (offset, error))
        direction = "higher" if offset / lever > 0 else "lower"
        seems = f": it seems to be {codes:.1f} ± {codes_error:.1g} codes {direction}"
    which = "that is assumed"
    remedy = "take dark frames (`dark`), and give them together with these shots"
    if fit.assumed.black_measured:
        which = "that the dark frames show"
        remedy = "take dark frames anew, with gain, exposure and temperature of the other shots, and the chart without reflections"
    return f"the shots contradict the black level {which} by {abs(fit.black_deviation):.0f} standard errors{seems}; {remedy}"


def _warnings(fit: GammaFit, shots: Sequence[ShotMeasurement]) -> list[str]:
    """Warn of an uncertain gamma, of residuals that noise does not explain, and of patches that were left out."""
    warnings = []
    tints = [tint for shot in shots if not shot.light and (tint := coloured_light(shot))]
    if fit.worst > _GOOD:
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
