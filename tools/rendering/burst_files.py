"""The files of a burst: what each holds, which do not fit the others, and what became of them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, Any

from shared import Mosaic

if TYPE_CHECKING:
    from offline.burst import Judged


@dataclass(eq=False)
class BurstFile:
    """One file of a burst.

    name: of the file.
    mosaic: its content; None = it is left out.
    reason: why it is.
    failed: it is no shot, or damaged.
    judged: what became of it when the burst was merged.
    """

    name: str
    mosaic: Mosaic | None = None
    reason: str = ""
    failed: bool = False
    judged: "Judged | None" = None

    @classmethod
    def refused(cls, name: str, error: Exception, *, failed: bool) -> "BurstFile":
        """A file that an error keeps out."""
        return cls(name, reason=str(error).removeprefix(f"{name}: "), failed=failed)

    def refuse(self, reason: str) -> None:
        """Leave it out."""
        self.mosaic, self.reason = None, reason

    @property
    def line(self) -> str:
        """Why it is left out, after its name."""
        return f"{self.name}: {self.reason}"

    def facts(self) -> dict[str, Any]:
        """What is known of it, for machines."""
        facts: dict[str, Any] = {"source": self.name, "used": not self.reason, "reason": self.reason}
        if self.judged is not None and self.judged.motion is not None:
            motion = self.judged.motion
            facts |= {"right": motion.shift[1], "down": motion.shift[0], "degrees": degrees(motion.angle)}
            facts |= {name: float(getattr(self.judged, name)) for name in ("gain", "agreement", "sharpness", "error")}
        return facts


def leave_odd_ones_out(frames: Sequence[BurstFile], reference: int | None) -> None:
    """Refuse the frames that are not like the reference, or, where there is none, like most of the others."""
    there = [frame.mosaic for frame in frames if frame.mosaic is not None]
    wanted = frames[reference].mosaic if reference is not None else None
    if wanted is None and there:
        most = Counter(map(_kind, there)).most_common(1)[0][0]
        wanted = next(mosaic for mosaic in there if _kind(mosaic) == most)
    for frame in frames:
        if frame.mosaic is not None and wanted is not None and _kind(frame.mosaic) != _kind(wanted):
            frame.refuse(_difference(frame.mosaic, wanted))


def _kind(mosaic: Mosaic) -> tuple[object, ...]:
    """What the frames of a burst have in common."""
    calibration = mosaic.calibration
    return mosaic.shape, mosaic.pattern, calibration.gamma, calibration.sensor, calibration.camera


def _difference(mosaic: Mosaic, wanted: Mosaic) -> str:
    """What two frames have not in common."""
    if mosaic.shape != wanted.shape:
        return "it has {1} x {0} pixels, the others {3} x {2}".format(*mosaic.shape, *wanted.shape)
    if mosaic.pattern != wanted.pattern:
        return "its filters are arranged otherwise than those of the others"
    return "it was taken with another camera than the others, or with another calibration; `camera` replaces it in all of them"
