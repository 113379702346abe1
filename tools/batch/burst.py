"""The frames of a burst as what one picture is rendered from: which fit, which are left out and why, what is known of each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...shared import Mosaic
from ...shared.arrays import FloatArray
from ...shared.errors import ForeignFileError, InputError, PanchromaError
from ...shared.progress import Progress
from .burst_files import BurstFile, leave_odd_ones_out
from .checks import check_memory
from .jobs import Job
from .order import Order, Subject
from .progress import Note

if TYPE_CHECKING:
    from ...offline.burst import MergedBurst, Motion

_MOST = 1000.0  # pixels that a sensor moves
Shift = tuple[float, ...]


@dataclass(frozen=True)
class BurstOrder(Order):
    """Settings of a burst.

    reference: index of the file that the picture shows; None = the first of the sharpest, or with `shifts` the first.
    shifts: (right, down), where the sensor was at each file, in columns and rows of its pixels; () = hand-held: find the motion.
    """

    no_matter = Order.no_matter - {"max_pixels"}  # a larger frame is left out, and the others make another picture

    reference: int | None = None
    shifts: tuple[Shift, ...] = ()

    def __post_init__(self) -> None:
        if not all(abs(pixels) <= _MOST for shift in self.shifts for pixels in shift):
            raise InputError(f"`shifts` are {self.shifts}, expected {_MOST:g} pixels at most")

    def open(self, job: Job, memory: int, note: Note) -> Subject:
        """The frames that can be read. Raises InputError if there is none, or if the one that is to be the reference is not."""
        frames: list[BurstFile] = []
        for name in job.files:
            frame = self._frame(name, found=job.found)
            if frame.mosaic and not any(each.mosaic for each in frames):  # before memory is full of frames
                check_memory(frame.mosaic, self.kind, self.settings, memory, len(job.files))
            frames.append(frame)
        leave_odd_ones_out(frames, self.reference)
        for frame in frames:
            if frame.reason and not frame.failed:
                note(f"{frame.name}: is left out: {frame.reason}")
        if self.reference is not None and frames[self.reference].reason:
            raise InputError(f"{frames[self.reference].line}; name another `reference`")
        if not any(frame.mosaic for frame in frames):
            for frame in frames:
                if frame.failed:
                    note(frame.line)
            raise InputError(f"none of the {len(frames)} frames can be used")
        return BurstSubject(self, frames, note)

    def failures(self, job: Job) -> tuple[str, ...]:
        """A line for each frame that cannot be read. Frames are read one by one, and not kept."""
        frames = (self._frame(name, found=job.found) for name in job.files)
        return tuple(frame.line for frame in frames if frame.failed)

    def _frame(self, name: str, *, found: bool) -> BurstFile:
        try:
            mosaic = self.decode(name)
        except PanchromaError as error:
            return BurstFile.refused(name, error, failed=not (found and isinstance(error, ForeignFileError)))
        try:
            return BurstFile(name, self.prepared(mosaic))
        except PanchromaError as error:
            return BurstFile.refused(name, error, failed=False)


class BurstSubject(Subject):
    """The frames of a burst.

    order: settings.
    frames: all files, those that are left out too; one or more have a mosaic.
    note: called with each remark for the user.
    """

    def __init__(self, order: BurstOrder, frames: Sequence[BurstFile], note: Note) -> None:
        self._order, self.frames, self._note = order, frames, note
        self._mosaics = {index: frame.mosaic for index, frame in enumerate(frames) if frame.mosaic is not None}
        self._used = list(self._mosaics)
        self._reference = self._used[0] if order.reference is None else order.reference
        self._merged: MergedBurst | None = None
        self.count = len(self._used)
        self.errors = tuple(frame.line for frame in frames if frame.failed)
        super().__init__(self._mosaics[self._reference], order.settings)

    def prepare(self, progress: Progress) -> None:
        """Align and merge the frames."""
        from ...offline.burst import merge_burst

        if self.count > 1:
            known = self._order.reference is not None or self._order.shifts
            merged = merge_burst(
                list(self._mosaics.values()),
                self.settings,
                progress,
                reference=self._used.index(self._reference) if known else None,
                motions=self._motions() if self._order.shifts else None,
            )
            self._reference, self._merged = self._used[merged.reference], merged
            for index, judged in zip(self._used, merged.frames, strict=True):
                self.frames[index].judged, self.frames[index].reason = judged, judged.reason
                if judged.copy_of is not None:
                    original = self.frames[self._used[judged.copy_of]].name
                    self.frames[index].reason = f"it is a copy of {original}: its samples are the same, and tell nothing new"
        for frame in self.frames:
            if frame.reason and frame.mosaic is not None:
                self._note(f"{frame.name}: is left out: {frame.reason}")
        self.mosaic = self._mosaics[self._reference]
        if self._left == 1:
            self._note(f"{self.frames[self._reference].name}: is the only frame that is left; the picture is that of one shot")
        self.words = f"{self._left} of {len(self.frames)} frames, reference {Path(self.frames[self._reference].name).name}, "

    def bands(self, progress: Progress) -> Iterator[FloatArray]:
        """Yield the picture as `offline.render_bands` does."""
        from ...offline.burst import render_burst_bands

        if self._merged is None or self._left == 1:
            return super().bands(progress)
        self.lost = self._merged.lost
        return render_burst_bands(self._merged, self.settings, progress)

    def _given_up(self) -> Mosaic:
        """The reference, which stays."""
        return self.mosaic

    def facts(self) -> dict[str, Any]:
        """What became of each frame, for machines."""
        return {"reference": self.frames[self._reference].name, "frames": [frame.facts() for frame in self.frames]}

    @property
    def _left(self) -> int:
        return sum(not frame.reason for frame in self.frames)

    def _motions(self) -> list["Motion"]:
        """The known motions: a sensor that has moved to the right sees everything further left."""
        from ...offline.burst import Motion

        right, down = self._order.shifts[self._reference]
        moved = (self._order.shifts[index] for index in self._used)
        return [Motion((down - below, right - beside)) for beside, below in moved]
