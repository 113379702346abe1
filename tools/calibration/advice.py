"""Warnings about a calibration: what is uncertain or wrong, and what to shoot instead."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .chart.place import PATCHES
from .colour_matrix import GREYS, UNEVEN, ColourFit
from .dark_frames import DarkResult
from .gamma import GammaFit
from .noise import SIGMAS, NoiseResult

if TYPE_CHECKING:
    from .shot import ShotMeasurement

_LEVER = 0.2  # of the black level: so much of what planes are off by in common has to show
CONTRADICTION = 4.0  # standard errors: a larger one is not a coincidence
_SPREAD = 2.5  # residuals over noise: larger ones have another cause than noise
_GOOD_READ = 0.05  # half width over read noise
_GOOD_NOISE = 0.1  # half width over variance at full scale
_CORRECTED = 2.5  # mean dE2000 of patches predicted from the others: below it the correction for uneven light has worked
_GOOD_GAMMA = 0.02  # half width over gamma
_COLOURED = 0.2  # of the brightest channel: in daylight and in the light of a bulb, grey reads more in each of three broad channels
_GOOD_COLOUR = 4.0  # mean dE2000: an average chart in average light stays below


def contradicting(gamma: GammaFit, shots: Sequence["ShotMeasurement"]) -> list[str]:
    """Return what does not fit together by more than four standard errors, and what to shoot instead; a sentence each."""
    said = []
    if abs(gamma.off) > CONTRADICTION:
        said.append(_wrong_black(gamma))
    if gamma.apart > CONTRADICTION:
        each = ", ".join(
            f"{shot.name}{' (around the chart)' if shot.chart and number else ''} {_figures(fit)}"
            for shot in shots
            for number, fit in enumerate(shot.fits)
        )
        said.append(
            f"the shots contradict each other in gamma by {gamma.apart:.0f} standard deviations: {each}; give only shots of "
            "one session, with one lens, or shoot the chart anew in even light"
        )
    return said


def _wrong_black(gamma: GammaFit) -> str:
    """Return that shots contradict the black level, by how much, and what to do."""
    offset, error = gamma.offset
    span = gamma.calibration.white_level - gamma.calibration.black_level[-1]
    # In common on all planes, it is off by so much; unless gamma adds up to about 1: then that does not show.
    lever = 1 - float(gamma.gamma.sum())
    codes, unsure = (abs(value * span / lever) for value in (offset, error)) if abs(lever) > _LEVER else (np.nan, np.nan)
    seems = f": it seems to be {codes:.1f} ± {unsure:.1g} codes {'higher' if offset / lever > 0 else 'lower'}" if codes > 0 else ""
    which, remedy = (
        "that is assumed",
        "take dark frames (--dark), and give them together with these shots, or add them with --update",
    )
    if gamma.assumed.black_measured:
        which = "that the dark frames show"
        remedy = "take dark frames anew, with gain, exposure and temperature of the other shots, and the chart without reflections"
    return f"the shots contradict the black level {which} by {abs(gamma.off):.0f} standard errors{seems}; {remedy}"


def _figures(fit: GammaFit) -> str:
    return " ".join(f"{value:.3f} ± {half:.2g}" for value, half in zip(fit.gamma, fit.half_width, strict=True))


def gamma_warnings(gamma: GammaFit, shots: Sequence["ShotMeasurement"]) -> list[str]:
    """Warn of an uncertain gamma, of residuals that noise does not explain, and of patches that were left out."""
    warnings = []
    tints = [tint for shot in shots if (tint := coloured_light(shot))]
    if gamma.worst > _GOOD_GAMMA:
        remedy = "white light would help" if tints else "more light, a larger chart, more shots or flat frames (--flat) would help"
        warnings.append(f"gamma is only known to ±{100 * gamma.worst:.1f} % (95 %): {remedy}")
    warnings += tints
    if gamma.spread > _SPREAD:
        warnings.append(
            f"the residuals are {gamma.spread:.1f} times as large as noise explains: "
            "reflections, a dirty chart, or a sensor that is not linear"
        )
    for shot in shots:
        if shot.places is None:
            continue
        clipped = int(shot.places.clipped.sum())
        if clipped:
            warnings.append(
                f"{shot.name}: {clipped} of {PATCHES} patches are clipped and were left out; expose less to measure colours"
            )
        left_out = int((~shot.fits[0].used).sum()) - clipped
        if left_out > 0:
            warnings.append(f"{shot.name}: {left_out} patches do not fit the others and were left out (reflections, dust?)")
    return warnings


def coloured_light(shot: "ShotMeasurement") -> str:
    """Return what strongly coloured light does to a shot of the chart, "" if the light is not: it shows on the grey patches."""
    if shot.places is None:
        return ""
    grey = shot.places.mean[list(GREYS), :-1].mean(axis=0)
    if grey.min() > _COLOURED * grey.max():
        return ""
    letters = shot.calibration.channels
    weak, strong = letters[int(grey.argmin())], letters[int(grey.argmax())]
    return (
        f"{shot.name}: the light is strongly coloured: on grey {weak} reads {100 * max(grey.min(), 0) / grey.max():.0f} % of what "
        f"{strong} does, so that colours, and gamma of {weak}, are known less well; take white light"
    )


def noise_warnings(noise: NoiseResult, dark: DarkResult | None) -> list[str]:
    """Warn of an uncertain gain, and of an uncertain read noise: in all but the darkest frames shot noise hides it."""
    warnings = []
    if not noise.uncertainty <= _GOOD_NOISE:
        warnings.append(
            f"the noise at full scale is only known to ±{100 * noise.uncertainty:.0f} % (95 %); "
            "take more pairs of flat frames (--flat)"
        )
    part = max(line.read_error / max(line.read, 1e-12) for line in noise.lines)
    if part > _GOOD_READ / SIGMAS:
        known = f"only known to ±{100 * SIGMAS * part:.0f} % (95 %)" if SIGMAS * part < 1 else "unknown"
        if dark is not None and dark.shows_read:
            warnings.append(f"read noise is {known}; take more dark frames (--dark)")
        else:
            instead = "; take dark frames (--dark)" if dark is None else " either"
            warnings.append(f"read noise is {known}, because {noise.source} hardly show it{instead}")
    return warnings


def dark_warnings(dark: DarkResult) -> list[str]:
    """Warn of codes that are too coarse for the read noise."""
    if dark.shows_read:
        return []
    return ["the read noise is smaller than rounding to codes shows, so the dark frames do not tell it; use more gain or more bits"]


def colour_warnings(colour: ColourFit, shot: str, *, coloured: bool) -> list[str]:
    """Warn of uneven light on the chart and of large colour differences.

    shot: its name.
    coloured: whether its light is strongly coloured: then that is the cause of errors that are corrected as uneven light.
    """
    warnings = []
    if not coloured and colour.unevenness > UNEVEN and colour.left_out.mean() > _CORRECTED:
        warnings.append(
            f"{shot}: the light on the chart is uneven, up to {colour.unevenness:.2f} times brighter in one place than in another; "
            "correcting the colours for it leaves errors; light the chart evenly"
        )
    mean = float(colour.difference.mean())
    if mean > _GOOD_COLOUR:
        warnings.append(
            f"{shot}: the colours differ from the reference by a mean dE2000 of {mean:.1f}, more than {_GOOD_COLOUR:.0f}"
        )
    return warnings
