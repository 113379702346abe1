"""Black level, from dark frames."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Self

from ..dark_frames import DarkResult
from ..noise import SIGMAS
from ..page import table
from ..part import Evidence, Part, rounded


@dataclass(frozen=True, eq=False, kw_only=True)
class BlackLevelPart(Part):
    """The black level of each plane. dark: what the dark frames show; planes: letters."""

    name, place = "black_level", 50

    dark: DarkResult
    planes: str

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
            dark=dark,
            planes=evidence.channels + "W",
            facts={"frames": dark.frames, "standard_error": rounded(dark.black_error)},
            changes={"black_level": evidence.calibration.black_level},
            warnings=() if dark.shows_read else (coarse,),
        )

    def sections(self) -> Mapping[str, str]:
        """List black level and read noise per plane."""
        rows = [
            (letter, f"{black:.3f} ± {SIGMAS * error:.3f}", f"{read:.3f}")
            for letter, black, error, read in zip(self.planes, self.dark.black, self.dark.black_error, self.dark.read, strict=True)
        ]
        facts = f"{self.dark.frames} frames; {len(self.dark.defects)} pixels are not black."
        return {"Dark frames": table(("plane", "black level, codes", "read noise, codes"), rows) + f"<p>{escape(facts)}</p>"}
