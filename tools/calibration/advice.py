"""Warnings about a calibration: what is uncertain or wrong, and what to shoot instead."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .chart.place import PATCHES
from .colour_matrix import UNEVEN, ColourFit
from .gamma import GammaFit
from .noise import SIGMAS, DarkResult, NoiseResult

if TYPE_CHECKING:
    from .shot import ShotMeasurement

_OFFSET = 4.0  # standard errors: a larger offset is not a coincidence
_SPREAD = 2.5  # residuals over noise: larger ones have another cause than noise
_GOOD_READ = 0.05  # half width over read noise
_GOOD_NOISE = 0.1  # half width over variance at full scale
_CORRECTED = 2.5  # mean dE2000 of patches predicted from the others: below it the correction for uneven light has worked
_GOOD_GAMMA = 0.02  # half width over gamma
_GOOD_COLOUR = 4.0  # mean dE2000: an average chart in average light stays below


def gamma_warnings(gamma: GammaFit, shots: Sequence["ShotMeasurement"]) -> list[str]:
    """Warn of an uncertain gamma, of residuals that noise does not explain, and of patches that were left out."""
    warnings = []
    if gamma.worst > _GOOD_GAMMA:
        warnings.append(
            f"gamma is only known to ±{100 * gamma.worst:.1f} % (95 %): more light, a larger chart or more shots would help"
        )
    if abs(gamma.offset) > _OFFSET:
        warnings.append(
            f"the panchromatic samples have an offset of {gamma.offset:+.1f} standard errors relative to the colours: "
            "the black level is probably wrong; take dark frames (--dark)"
        )
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


def colour_warnings(colour: ColourFit, shot: str) -> list[str]:
    """Warn of uneven light on the chart and of large colour differences; shot: name of the shot."""
    warnings = []
    if colour.unevenness > UNEVEN and colour.left_out.mean() > _CORRECTED:
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
