"""The files of a burst: which shots they are and in which order, which do not fit the others, and what became of each."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...shared import Mosaic
from ...shared.errors import InputError
from ...shared.series import frame_number
from .folders import Source
from .jobs import identity

if TYPE_CHECKING:
    from ...offline.burst import Judged


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


_NAMED = 4  # series that an error names, before it counts the others


def series(sources: Sequence[Source]) -> list[str]:
    """The names of the shots of one burst, in its order.

    sources: see `tools.batch.folders.search`. Files that the user named are taken as they are, in the order given. Those found in
        a folder have to be the frames of one burst, named as `capture --burst` and `simulate --burst` do, STEM-1.dng, STEM-2.dng
        ...; some may be missing.
    Raises InputError that names the odd ones, for shots in a folder that belong to several bursts or to none, and for a file that
    is given twice, under whatever names.

    >>> series([Source("shots/rose-2.dng", Path("rose-2.dng")), Source("shots/rose-1.dng", Path("rose-1.dng"))])
    ['shots/rose-1.dng', 'shots/rose-2.dng']
    """
    named = [source.name for source in sources if not source.found]
    bursts: dict[Path, list[tuple[int, str]]] = {}
    singles: list[str] = []
    for path in [Path(source.name) for source in sources if source.found]:
        if frame := frame_number(path.stem):
            bursts.setdefault(path.with_name(frame[0]), []).append((frame[1], str(path)))
        else:
            singles.append(str(path))
    found = [[name for _, name in sorted(frames)] for frames in bursts.values()]
    if len(found) > 1 or singles:
        groups = [names[0] + (f" and {len(names) - 1} more" if len(names) > 1 else "") for names in found] + singles
        listed = ", ".join(groups[:_NAMED]) + (f" and {len(groups) - _NAMED} others" if len(groups) > _NAMED else "")
        raise InputError(f"expected the frames of one burst, STEM-1.dng, STEM-2.dng ..., found {listed}; name the files of one")
    names = named + [name for frames in found for name in frames]
    known: dict[object, str] = {}
    for name in names:
        place = identity(name) or name  # other spellings of a name, and links, lead to the same file
        if place in known:
            raise InputError(
                f"{name}: is given twice" + (f": it is the same file as {known[place]}" if known[place] != name else "")
            )
        known[place] = name
    return names


def series_stem(names: Sequence[str]) -> str:
    """What the picture of a burst is called, without suffix: what its frames have in common, or else the first file's stem.

    names: of its shots, see `series`.

    >>> series_stem(["shots/rose-1.dng", "shots/rose-2.dng"]), series_stem(["IMG_0001.dng", "IMG_0002.dng"])
    ('rose', 'IMG_0001')
    """
    stems = [Path(name).stem for name in names]
    common = {frame[0] if (frame := frame_number(stem)) else "" for stem in stems}
    return common.pop() or stems[0] if len(common) == 1 else stems[0]
