"""Black level, from dark frames."""

from collections.abc import Mapping
from html import escape
from typing import Self

from ..noise import SIGMAS
from ..page import table
from ..part import Evidence, Part, rounded


class BlackLevelPart(Part):
    """The black level of each plane."""

    name, place = "black_level", 50

    @classmethod
    def concluded(cls, evidence: Evidence) -> Self | None:
        """Take the black level of the dark frames, and warn of codes that are too coarse for the read noise."""
        dark = evidence.seen.dark
        if dark is None:
            return None
        coarse = (
            "the read noise is smaller than rounding to codes shows, so the dark frames do not tell it; use more gain or more bits"
        )
        return cls(
            facts={"frames": dark.frames, "standard_error": rounded(dark.black_error)},
            changes={"black_level": evidence.calibration.black_level},
            warnings=() if dark.shows_read else (coarse,),
        )

    def sections(self, evidence: Evidence) -> Mapping[str, str]:
        """List black level and read noise per plane."""
        if (dark := evidence.seen.dark) is None:
            return {}
        rows = [
            (letter, f"{black:.3f} ± {SIGMAS * error:.3f}", f"{read:.3f}")
            for letter, black, error, read in zip(evidence.planes, dark.black, dark.black_error, dark.read, strict=True)
        ]
        facts = f"{dark.frames} frames; {len(dark.defects)} pixels are not black."
        return {"Dark frames": table(("plane", "black level, codes", "read noise, codes"), rows) + f"<p>{escape(facts)}</p>"}
