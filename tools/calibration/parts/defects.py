"""Defective pixels: those that are not black in dark frames, and those that are dead in flat frames."""

from typing import Self

from ..part import Evidence, Part

_MANY = 1e-3  # of the pixels
_BLIND = 0.01  # of the pixels: so many may be left out in the search for dead ones


class DefectsPart(Part):
    """The pixels that do not measure light."""

    name, place = "defects", 60

    @classmethod
    def concluded(cls, evidence: Evidence) -> Self | None:
        """List the defects. Dark frames alone show no dead pixels, and flat ones no hot pixels: then those of before stay."""
        dark, flats, base = evidence.seen.dark, evidence.seen.flats, evidence.seen.base
        if base is None or not (dark or flats):
            return None
        before = () if (dark and flats) or "defects" not in evidence.known else evidence.calibration.defects
        defects = sorted({*(dark.defects if dark else ()), *(flats.dead if flats else ()), *before})
        part, warnings = len(defects) / base.samples.size, []
        if part > _MANY:
            warnings.append(f"there are many defective pixels: {len(defects)} ({100 * part:.2f} %)")
        if flats and flats.blind > _BLIND:
            warnings.append(
                f"the flat frames are too dark, or too uneven, to tell dead pixels in {100 * flats.blind:.0f} % of the frame; "
                "expose the brightest pair up to three quarters of full scale"
            )
        return cls(facts={"part_of_pixels": part}, changes={"defects": tuple(defects)}, warnings=warnings)
