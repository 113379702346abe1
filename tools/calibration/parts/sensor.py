"""Black level, defects, noise and shading, from dark and flat frames."""

from dataclasses import astuple
from typing import Any

import numpy as np

from ..dark_frames import DarkResult
from ..measure import Measurements
from ..noise import SIGMAS, NoiseResult, noise_of_flats
from .gamma import black_error
from .part import Part, rounded

_MANY = 1e-3  # of the pixels
_NAMED = 5  # defects that a warning lists
_BLIND = 0.01  # of the pixels: so many may be left out in the search for dead ones
_GOOD_READ, _GOOD_NOISE = 0.05, 0.1  # half width over read noise, and over variance at full scale


def black_level(seen: Measurements) -> Part | None:
    """Return the black level of each plane, and a warning of codes that are too coarse for the read noise."""
    dark = seen.dark
    if dark is None:
        return None
    coarse = "the read noise is smaller than rounding to codes shows, so the dark frames do not tell it; use more gain or more bits"
    return Part(
        "black_level",
        {"frames": dark.frames, "standard_error": rounded(dark.black_error)},
        {"black_level": seen.calibration.black_level},
        warnings=() if dark.shows_read else (coarse,),
        result=dark,
    )


def defects(seen: Measurements) -> Part | None:
    """Return the defects.

    Those that the frames or the camera file state stay, unless dark and flat frames together do not show them: dark frames alone
    show no dead pixels, and flat ones no hot pixels.
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
            f"{len(gone)} defects that the frames state show neither in dark nor in flat frames, and are left out (row and column "
            f"{places})"
        )
    if part > _MANY:
        warnings.append(f"there are many defective pixels: {len(found)} ({100 * part:.2f} %)")
    if flats and flats.blind > _BLIND:
        warnings.append(
            f"the flat frames are too dark, or too uneven, to tell dead pixels in {100 * flats.blind:.0f} % of the frame; "
            "expose the brightest pair up to three quarters of full scale"
        )
    return Part("defects", {"part_of_pixels": part}, {"defects": tuple(found)}, warnings)


def noise(seen: Measurements) -> Part | None:
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
        {"from": found.source, "shot_error": rounded(shot_error), "read_error": rounded(read_error)},
        {"noise": found.model(full_scale)},
        _noise_warnings(found, seen.dark),
        result=found,
    )


def _noise_warnings(noise: NoiseResult, dark: DarkResult | None) -> list[str]:
    """Warn of an uncertain gain, and of an uncertain read noise: in all but the darkest frames shot noise hides it."""
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


def shading(seen: Measurements) -> Part | None:
    """Return how light falls off, for each plane, and a warning if its error is that of an assumed black level."""
    found = seen.shading
    if found is None:
        return None
    gain, error, warnings = found.shading, found.error, []
    if not seen.assumed().black_measured:  # light that is black in truth does not fall off
        error = float(np.hypot(error, found.error_of_black(black_error(seen))))
        warnings.append(
            f"shading was measured with a black level that is assumed, and so is only known to ±{100 * error:.2g} % in the "
            "corners (standard error); take dark frames (`dark`)"
        )
    facts: dict[str, Any] = {"frames": found.frames, "standard_error": float(f"{error:.2g}")}
    if gain:
        facts |= {"stops": round(gain.stops, 3), "colour": round(gain.colour, 4)}
        facts |= {"residual": gain.residual, "focal_length": gain.focal_length}
    return Part("shading", facts, {"shading": gain}, warnings, result=found)
