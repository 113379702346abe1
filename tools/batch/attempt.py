"""One shot or burst, rendered to one picture, once, by whichever process on whichever machine
gets it.
"""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from ...shared import CfaPattern
from ...shared.arrays import ByteArray, FloatArray
from ...shared.errors import InputError, OutputError
from ...shared.processors import threads
from ..io.backup import keep_old
from ..io.development import Development, write_picture
from .checks import check_memory
from .compilation import announced_compilation, compile_ahead
from .jobs import Job, Outcome, State, file_status, identity, refuse_existing
from .journal import Entry, Journal, digest, key, output_lock
from .order import Order, Subject
from .progress import StageProgress


def attempt(
    order: Order, memory: int, processes: int, job: Job, listener: StageProgress
) -> Outcome:
    """Make a picture, or find that it is there already.

    Parameters
    ----------
    order
        Settings of the run.
    memory
        Bytes that may be used.
    processes
        Number of processes that may be started to compile the renderer; 1 in a process that was
        started itself.
    job
        The shot or burst, and where its picture goes.
    listener
        Takes stages, and remarks for the user.

    Raises
    ------
    InputError, ForeignFileError, OutputError
        There can be no picture.
    """
    return _Attempt(order, memory, processes, job, listener).outcome()


@dataclass(frozen=True)
class _Existing:
    """Existing file under the name of an output.

    current: the outcome when it is up to date, made by this run or by an earlier one; otherwise
    None. replace: it may be replaced. changed: a render made it, and somebody has changed it since.
    """

    current: State | None = None
    replace: bool = False
    changed: bool = False


@dataclass(frozen=True)
class _Attempt:
    """Implementation of `attempt`."""

    order: Order
    memory: int
    processes: int
    job: Job
    listener: StageProgress

    def outcome(self) -> Outcome:
        """Find out what is to be done, and do it."""
        order, output = self.order, self.job.output
        if not (order.dry_run or order.folder.is_dir()):
            raise OutputError(f"{order.folder}: is not there; every machine has to see this folder")
        if not any(map(file_status, self.job.files)):
            self._open()  # says what is wrong with it, before a folder is made for its picture
        try:
            if order.dry_run:
                return self._plan()
            self.job.make_folders()
            with output_lock(output):
                return self._make()
        except OSError as error:
            raise OutputError(f"{output}: cannot be written ({error.strerror or error})") from error

    def _plan(self) -> Outcome:
        """Say what would be done."""
        if self._is_unchanged() or self._existing(self._digest()).current:
            return self._report_current("current", dry_run=True)
        source, output = self.job.source, self.job.output
        facts = {"output": str(output), "dry_run": True}
        return Outcome(facts, (f"{source} -> {output}",), self._open().errors, "planned")

    def _make(self) -> Outcome:
        """Make the picture, while this process holds the lock on the output."""
        start, order = time.monotonic(), self.order
        if self._is_unchanged():
            return self._report_current("current")
        stamp, output_stamp = _stamp(self.job.files), _stamp([self.job.output])
        source_digest = self._digest()
        existing = self._existing(source_digest)
        if existing.current:
            self._note_stamp(f"{stamp} {output_stamp}")
            return self._report_current(existing.current)
        self.listener.stage("reading", 1)
        subject = self._open()
        with announced_compilation(self.listener):
            if source_digest is None or self._digest() != source_digest:
                raise InputError(
                    f"{self.job.source}: has changed while it was read; render it again when it "
                    "is complete"
                )
            check_memory(subject.mosaic, order.kind, order.settings, self.memory, subject.count)
            # now that only the writing can fail
            compile_ahead([order.settings], self.processes, self.listener)
            self._note_what_is_assumed(subject)
            subject.prepare(self.listener)
            development, pattern = order.development(subject.mosaic), subject.mosaic.pattern
            self._write(subject, development, existing, source_digest)
            self._note_stamp(f"{stamp} {_stamp([self.job.output])}")
        return self._report_made(subject, development, pattern, time.monotonic() - start)

    def _open(self) -> Subject:
        return self.order.open(self.job, self.memory, self.listener.note)

    def _note_what_is_assumed(self, subject: Subject) -> None:
        source, mosaic, order = self.job.source, subject.mosaic, self.order
        calibration, note = mosaic.calibration, self.listener.note
        if calibration.noise is None:
            note(f"{source}: the noise level is unknown; calibrate the camera for better colour")
        if not calibration.knows_white and order.kind.has_white_balance:
            note(f'{source}: the white balance is unknown; `wb="auto"` estimates it')
        for remark in calibration.remarks(mosaic.metadata.focal_length):
            note(f"{source}: {remark}")

    def _write(
        self,
        subject: Subject,
        development: Development,
        existing: _Existing,
        source_digest: str,
    ) -> None:
        """Render, and write the picture."""
        path = self.job.output
        if existing.changed:
            self.listener.note(
                f"{path}: has changed since it was made; it is kept as {keep_old(path).name}"
            )
        # Journal and picture are fsynced at the same time: for small pictures fsync takes most of
        # the time, and a large one is digested meanwhile. The pool is this picture's own: one that
        # stays would wait for ever for a thread whose start is interrupted.
        with ThreadPoolExecutor(1) as pool:

            def note_in_journal(part: Path) -> Callable[[], object]:
                return pool.submit(self._note_in_journal, part, source_digest).result

            write = partial(write_picture, overwrite=existing.replace, on_complete=note_in_journal)
            bands = self._whiten(subject.bands(self.listener), subject.lost, development)
            write(path, bands, development, threads=threads())

    def _whiten(
        self, bands: Iterable[FloatArray], lost: ByteArray | None, development: Development
    ) -> Iterator[FloatArray]:
        """Yield the bands as the picture shows them. lost: where light is lost."""
        top = 0
        for band in bands:
            yield development.whitened(band, None if lost is None else lost[top : top + len(band)])
            top += len(band)
        self.listener.stage("writing", 1)

    def _note_in_journal(self, part: Path, source_digest: str) -> None:
        order, output = self.order, self.job.output
        entry = Entry(
            order.name(output),
            digest(part) or "",
            order.key(output, source_digest),
            order.run,
            os.path.abspath(self.job.source),  # noqa: PTH100 (without following links)
            source_digest,
        )
        _journal(order.folder).append(entry)

    def _note_stamp(self, stamp: str) -> None:
        """Note sizes and times of files that are as the last entry says: the next run need not read
        them. Getting its name changed the picture's.
        """
        journal = _journal(self.order.folder)
        last = journal.of(self.order.name(self.job.output))[-1]
        journal.append(replace(last, stamp=stamp), wait=False)

    def _report_made(
        self,
        subject: Subject,
        development: Development,
        pattern: CfaPattern,
        seconds: float,
    ) -> Outcome:
        """Return the outcome of a picture that was made."""
        from ...offline import network_name

        output, kind, calibration = self.job.output, self.order.kind, development.calibration
        rows, columns = development.written_shape
        line = (
            f"{output}: {columns} x {rows}, {kind.bits} bits, {kind.space}, "
            f"{subject.words}{seconds:.1f} s"
        )
        facts = {
            "output": str(output),
            "width": columns,
            "height": rows,
            "seconds": round(seconds, 3),
            "neutral": calibration.neutral,
            "neutral_estimated": calibration.neutral_estimated,
            "learned": network_name(pattern) if self.order.settings.learned.used else None,
        }
        return Outcome(facts | subject.facts(), (line,), subject.errors)

    def _report_current(self, state: State, **facts: bool) -> Outcome:
        """Return the outcome of a picture that is up to date."""
        output = self.job.output
        record: dict[str, Any] = {"output": str(output), "current": True, **facts}
        return Outcome(record, (f"{output}: is up to date",), state=state)

    def _is_unchanged(self) -> bool:
        """True if the picture is up to date by sizes and times alone: reading all files of an
        archive takes long.
        """
        order, output = self.order, self.job.output
        entries = _journal(order.folder).of(order.name(output)) if order.resume else []
        if not entries or entries[-1].stamp != f"{_stamp(self.job.files)} {_stamp([output])}":
            return False
        return entries[-1].key == order.key(output, entries[-1].input)

    def _existing(self, source_digest: str | None) -> _Existing:
        """Look up what exists under the name of the output. Raises OutputError for a file that must
        stay.
        """
        order, output = self.order, self.job.output
        if not output.exists():
            return _Existing(replace=order.overwrite)
        entries = _journal(order.folder).of(order.name(output))
        last = entries[-1] if entries else None
        # by a process that died before it could say so
        of_this_run = last is not None and last.run == order.run
        if not (order.resume or of_this_run):
            if not order.overwrite:
                refuse_existing([output])
            return _Existing(replace=True)
        current = digest(output)
        up_to_date = current, order.key(output, source_digest or "")
        if last and source_digest and (last.digest, last.key) == up_to_date:
            return _Existing("made" if of_this_run else "current", True)
        if order.overwrite:
            return _Existing(replace=True)
        if not last:
            raise OutputError(
                f"{output}: exists already, and no render noted that it made it; "
                "`overwrite=True` replaces it"
            )
        if _both_there(last.source, self.job.source):
            raise OutputError(
                f"{output}: is the picture of {last.source}; use another output folder, or "
                "`overwrite=True`"
            )
        changed = current not in {entry.digest for entry in entries}
        return _Existing(replace=True, changed=changed)

    def _digest(self) -> str | None:
        """Digest of the files that a picture is made from; None if there is only one, and it cannot
        be read.
        """
        frames = self.job.frames
        return key(frames=[digest(name) for name in frames]) if frames else digest(self.job.source)


@lru_cache(maxsize=1)  # so that a process reads a long journal once
def _journal(folder: Path) -> Journal:
    return Journal(folder)


def _stamp(files: Iterable[str | Path]) -> str:
    """Digest of the size of each file and of the times at which it was modified and changed:
    programs that edit a file may set the former back, and none can set the latter.
    """
    statuses = map(file_status, files)
    return key(
        files=[
            status and (status.st_size, status.st_mtime_ns, status.st_ctime_ns)
            for status in statuses
        ]
    )


def _both_there(one: str, other: str) -> bool:
    """True if these are two existing files, rather than one that was moved."""
    first, second = identity(one), identity(other)
    return bool(first and second) and first != second
