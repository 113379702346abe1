"""Black level, and defective pixels: those that are not black in dark frames, and those that are dead in flat frames."""

from html import escape

from ..noise import SIGMAS
from ..part import Evidence, Part, rounded, table

_MANY = 1e-3  # of the pixels
_NAMED = 5  # defects that a warning lists
_BLIND = 0.01  # of the pixels: so many may be left out in the search for dead ones


def black_level(evidence: Evidence) -> Part | None:
    """The black level of each plane, and a warning of codes that are too coarse for the read noise."""
    dark = evidence.seen.dark
    if dark is None:
        return None
    coarse = "the read noise is smaller than rounding to codes shows, so the dark frames do not tell it; use more gain or more bits"
    rows = [
        (letter, f"{black:.3f} ± {SIGMAS * error:.3f}", f"{read:.3f}")
        for letter, black, error, read in zip(evidence.planes, dark.black, dark.black_error, dark.read, strict=True)
    ]
    facts = f"<p>{escape(f'{dark.frames} frames; {len(dark.defects)} pixels are not black.')}</p>"
    return Part(
        "black_level",
        {"frames": dark.frames, "standard_error": rounded(dark.black_error)},
        {"black_level": evidence.calibration.black_level},
        warnings=() if dark.shows_read else (coarse,),
        sections=lambda: {"Dark frames": table(("plane", "black level, codes", "read noise, codes"), rows) + facts},
    )


def defects(evidence: Evidence) -> Part | None:
    """The defects. Those that the frames or the camera file state stay, unless dark and flat frames together do not show them.

    Dark frames alone show no dead pixels, and flat ones no hot pixels.
    """
    dark, flats, base, stated = evidence.seen.dark, evidence.seen.flats, evidence.seen.base, evidence.seen.stated_defects
    if base is None:
        return None
    shown = {*(dark.defects if dark else ()), *(flats.dead if flats else ())}
    before = stated | set(evidence.calibration.defects)
    if not (dark or flats):
        return Part("defects", changes={"defects": tuple(sorted(before))}) if stated else None
    found = sorted(shown if dark and flats and flats.blind <= _BLIND else shown | before)
    part, warnings = len(found) / base.samples.size, []
    if gone := sorted(stated.difference(found)):
        places = ", ".join(f"{row} {column}" for row, column in gone[:_NAMED]) + ", ..." * (len(gone) > _NAMED)
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
