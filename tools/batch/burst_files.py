"""A burst: which shots are its frames, which do not fit the others, and what one picture is
rendered from.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import degrees, log2
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ...shared import FloatArray, InputError, Mosaic, PanchromaError
from ...shared.errors import ForeignFileError
from ...shared.progress import Progress
from ...shared.series import frame_number
from .chosen_white import WhiteBalance
from .folders import Source
from .jobs import Job
from .memory import check_memory
from .order import Order, Subject
from .progress import Note

if TYPE_CHECKING:
    from ...offline.burst import Judged, MergedBurst, Motion

_FARTHEST_SHIFT = 1000.0  # pixels that a sensor moves
_NAMED = 4  # series that an error names
Shift = tuple[float, ...]
Read = Callable[[str], Mosaic]
"""Returns a frame by its name."""


@dataclass(eq=False)
class BurstFile:
    """One file of a burst.

    Attributes
    ----------
    name : str
        Of the file.
    mosaic : Mosaic | None
        Its content; None = it is left out.
    reason : str
        Why it is.
    failed : bool
        It is no shot, or damaged.
    judged : Judged | None
        What became of it when the burst was merged.
    """

    name: str
    mosaic: Mosaic | None = None
    reason: str = ""
    failed: bool = False
    judged: "Judged | None" = None

    @property
    def line(self) -> str:
        """Why it is left out, after its name."""
        return f"{self.name}: {self.reason}"

    def facts(self) -> dict[str, Any]:
        """Description for machines."""
        facts = {"source": self.name, "used": not self.reason, "reason": self.reason}
        if (judged := self.judged) is None or judged.motion is None:
            return facts
        down, right = judged.motion.shift
        facts |= {"right": right, "down": down, "degrees": degrees(judged.motion.angle)}
        figures = ("gain", "agreement", "sharpness", "error")
        return facts | {name: float(getattr(judged, name)) for name in figures}


def series(sources: Sequence[Source]) -> list[str]:
    """The names of the shots of one burst, in its order.

    Raises InputError that names the first ones, for shots in a folder that belong to several bursts
    or to none.

    Parameters
    ----------
    sources : Sequence[Source]
        See `tools.batch.folders.search`. Files that the user named are taken as they are, in the
        order given. Those found in a folder have to be the frames of one burst, named as `capture
        --burst` and `simulate --burst` do, STEM-1.dng, STEM-2.dng ...; some may be missing.

    Examples
    --------
    >>> series([Source("shots/rose-2.dng", Path("rose-2.dng")), Source("shots/rose-1.dng",
    ...     Path("rose-1.dng"))])
    ['shots/rose-1.dng', 'shots/rose-2.dng']
    """
    names = [source.name for source in sources if not source.from_folder]
    bursts: dict[Path, list[tuple[int, str]]] = {}
    for path in [Path(source.name) for source in sources if source.from_folder]:
        stem, number = frame_number(path.stem) or (path.name, 0)
        bursts.setdefault(path.with_name(stem), []).append((number, str(path)))
    if len(bursts) > 1:
        firsts = ", ".join(min(frames)[1] for frames in list(bursts.values())[:_NAMED])
        expected = "expected the frames of one burst, STEM-1.dng, STEM-2.dng ..."
        found = f"found those of {len(bursts)}: {firsts}"
        raise InputError(f"{expected}, {found}; name the files of one")
    return names + [name for frames in bursts.values() for _, name in sorted(frames)]


def pictures(paths: Sequence[str]) -> dict[str, str]:
    """The files of a folder that have the names of pictures of its bursts, see `folders.SetAside`.

    Examples
    --------
    >>> pictures(["shots/rose-1.dng", "shots/rose-2.dng", "shots/rose.dng"])
    {'shots/rose.dng': 'named as the picture of a burst beside it'}
    """
    stems = {frame[0] for path in paths if (frame := frame_number(Path(path).stem))}
    named = "named as the picture of a burst beside it"
    return {path: named for path in paths if Path(path).stem in stems}


def series_stem(names: Sequence[str]) -> str:
    """Name of the picture of a burst without suffix: the common part of its frames' names, or the
    first file's stem.

    names: of its shots, see `series`.

    Examples
    --------
    >>> series_stem(["shots/rose-1.dng", "shots/rose-2.dng"]), series_stem(["IMG_0001.dng",
    ...     "IMG_0002.dng"])
    ('rose', 'IMG_0001')
    """
    stems = [Path(name).stem for name in names]
    common = {frame[0] if (frame := frame_number(stem)) else "" for stem in stems}
    return common.pop() or stems[0] if len(common) == 1 else stems[0]


def checked_reference(
    names: Sequence[str], reference: str | Path | None, shifts: Sequence[Shift]
) -> int | None:
    """The index of the frame with the name of a file; None for None.

    Raises InputError for fewer than two frames, for another number of shifts, and for a name that
    none of them has.
    """
    if len(names) < 2:
        expected = "expected two or more of one scene; panchroma render renders a shot"
        raise InputError(f"{names[0]}: is one frame, {expected}")
    if shifts and len(shifts) != len(names):
        expected = 'expected one for each, such as "0,0 2,0 0,2 2,2"'
        raise InputError(f"`shifts` has places for {len(shifts)} of {len(names)} shots, {expected}")
    if reference is None:
        return None
    chosen, places = Path(reference).resolve(), [Path(name).resolve() for name in names]
    if chosen in places:
        return places.index(chosen)
    files = [place.name for place in places]
    if files.count(str(reference)) != 1:
        raise InputError(f"`reference` {reference}: is none of the shots, {names[0]} ...")
    return files.index(str(reference))


@dataclass(frozen=True)
class BurstOrder(Order):
    """Settings of a burst.

    Attributes
    ----------
    reference : int | None
        Index of the file that the picture shows; None = the first of the sharpest, or with `shifts`
        the first.
    shifts : tuple[Shift, ...]
        (right, down), where the sensor was at each file, in columns and rows of its pixels; () =
        hand-held: find the motion.
    """

    # a larger frame is left out, and the others make another picture
    no_matter = Order.no_matter - {"max_pixels"}

    reference: int | None = None
    shifts: tuple[Shift, ...] = ()

    def __post_init__(self) -> None:
        if not all(abs(pixels) <= _FARTHEST_SHIFT for shift in self.shifts for pixels in shift):
            expected = f"expected {_FARTHEST_SHIFT:g} pixels at most"
            raise InputError(f"`shifts` are {self.shifts}, {expected}")

    def open(self, job: Job, memory: int, note: Note, read: Read | None = None) -> "BurstSubject":
        """The frames that can be read.

        Raises InputError if there is none, or if the one that is to be the reference is not.

        read: returns a frame by its name; None = `decode`.
        """
        frames: list[BurstFile] = []
        order, read = self, read or self.decode
        if self.white.grey:  # one neutral for all, which may be clipped there, or have moved
            chosen = self.prepared(read(job.files[self.reference or 0]))
            neutral = chosen.calibration.neutral or ()
            order = replace(self, white=WhiteBalance("", tuple(1 / value for value in neutral)))
        for name in job.files:
            frame = order._frame(name, read, from_folder=job.from_folder)
            # before memory is full of frames
            if frame.mosaic and not any(earlier.mosaic for earlier in frames):
                check_memory(frame.mosaic, self.kind, self.settings, memory, len(job.files))
            frames.append(frame)
        for frame in frames:
            if frame.reason and not frame.failed:
                note(f"{frame.name}: is left out: {frame.reason}")
        if self.reference is not None and frames[self.reference].reason:
            raise InputError(f"{frames[self.reference].line}; name another `reference`")
        channels = {frame.mosaic.calibration.channels for frame in frames if frame.mosaic}
        if not channels:
            raise InputError(f"{frames[0].line}; none of the {len(frames)} frames can be used")
        if len(channels) > 1:
            kinds = ", ".join(sorted(channels))
            raise InputError(f"the frames are of several sensors, {kinds}; name those of one")
        return BurstSubject(self, frames, note)

    def _frame(self, name: str, read: Read, *, from_folder: bool) -> BurstFile:
        mosaic = None
        try:
            mosaic = read(name)
            return BurstFile(name, self.prepared(mosaic))
        except PanchromaError as error:  # a shot that is read, and cannot be used, has not failed
            failed = mosaic is None and not (from_folder and isinstance(error, ForeignFileError))
            return BurstFile(name, reason=str(error).removeprefix(f"{name}: "), failed=failed)


class BurstSubject(Subject):
    """The frames of a burst.

    frames: all files, those that are left out too; one or more have a mosaic.
    """

    def __init__(self, order: BurstOrder, frames: Sequence[BurstFile], note: Note) -> None:
        self._order, self.frames, self._note = order, frames, note
        self._used = [frame for frame in frames if frame.mosaic is not None]
        self._reference = self._used[0] if order.reference is None else frames[order.reference]
        self._merged: MergedBurst | None = None
        self.count = len(self._used)
        self.errors = tuple(frame.line for frame in frames if frame.failed)
        super().__init__(cast(Mosaic, self._reference.mosaic), order.settings)

    def prepare(self, progress: Progress) -> None:
        """Align and merge the frames."""
        from ...offline.burst import merge_burst

        if self.count > 1:
            is_fixed = self._order.reference is not None or self._order.shifts
            index = self._used.index(self._reference) if is_fixed else None
            motions = self._motions() if self._order.shifts else None
            mosaics = [cast(Mosaic, frame.mosaic) for frame in self._used]
            merged = merge_burst(mosaics, self.settings, progress, reference=index, motions=motions)
            self._reference, self._merged = self._used[merged.reference], merged
            for frame, judged in zip(self._used, merged.frames, strict=True):
                frame.judged, frame.reason = judged, judged.reason
                if judged.copy_of is not None:
                    frame.reason = f"is a copy of {self._used[judged.copy_of].name}"
        for frame in self._used:
            if frame.reason:
                self._note(f"{frame.name}: is left out: {frame.reason}")
        self.mosaic = cast(Mosaic, self._reference.mosaic)
        name = Path(self._reference.name).name
        gains = {f.name: f.judged.gain for f in self._used if f.judged and not f.reason}
        brightest = max(gains, key=gains.__getitem__, default=name)
        if (stops := log2(gains.get(brightest, 1))) > 1 and self._order.reference is None:
            dark = f"the picture as dark: {stops:.1f} stops darker than {brightest}"
            remedy = "name that as `reference`, or brighten what is shown by `exposure`"
            self._note(f"{name} is the reference, and {dark}; {remedy}")
        self.words = f"{self._left} of {len(self.frames)} frames, reference {name}, "

    def bands(self, progress: Progress) -> Iterator[FloatArray]:
        """Yield the picture as `offline.render_bands` does."""
        from ...offline.burst import render_burst_bands

        if self._merged is None or self._left == 1:
            return super().bands(progress)
        self.lost = self._merged.lost
        return render_burst_bands(self._merged, self.settings, progress)

    def facts(self) -> dict[str, Any]:
        """Verdict on each frame, for machines."""
        frames = [frame.facts() for frame in self.frames]
        return {"reference": self._reference.name, "frames": frames}

    @property
    def _left(self) -> int:
        return sum(not frame.reason for frame in self.frames)

    def _motions(self) -> list["Motion"]:
        """The known motions: a sensor that has moved to the right sees everything further left."""
        from ...offline.burst import Motion

        places = dict(zip(self.frames, self._order.shifts, strict=True))
        right, down = places[self._reference]
        moved = (places[frame] for frame in self._used)
        return [Motion((down - below, right - beside)) for beside, below in moved]
