"""One shot, rendered to one picture, once, by whichever process on whichever machine gets it."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path

from shared.errors import ForeignFileError, InputError, OutputError
from shared.writing import keep_old, write_durably
from tools.host.jobs import file_status, identity, reason, refuse_existing
from tools.host.progress import StageProgress
from tools.pictures.writer import written_shape
from tools.rendering.compilation import announced_compilation, compile_ahead, load_compiled

from .journal import Entry, Journal, digest, key
from .lock import output_lock
from .order import Note, Order, Outcome, Share, State
from .picture_file import check_memory, needed_memory, render_to
from .shots import Shot
from .subject import Subject

_TURN = 5e-5  # seconds that a thread waits for the interpreter while another one computes; Python's default is 100 times as long


def attempt(order: Order, share: Share, shot: Shot, note: Note, progress: StageProgress | None = None) -> Outcome:
    """Make a picture, or say why there is none. Raises nothing but interrupts: one bad shot must not stop the others.

    order: settings of the run.
    share: what it may use of the machine.
    shot: the shot, and where its picture goes.
    note: called with each remark for the user.
    progress: listens to the stages, if there is one.
    """
    try:
        return _make(order, share, shot, note, progress or StageProgress())
    except ForeignFileError as error:
        return Outcome("foreign" if shot.found else "failed", str(error))
    except Exception as error:  # one odd file must not end a night's batch
        return Outcome("failed", reason(error))


def _make(order: Order, share: Share, shot: Shot, note: Note, progress: StageProgress) -> Outcome:
    output = shot.output
    if not (order.dry_run or order.folder.is_dir()):
        raise OutputError(f"{order.folder}: the output folder is not there; every machine at work has to see it under this name")
    if not any(_states(shot)):
        order.open(shot, share.memory, note)  # says what is wrong with it, before a folder is made for its picture
    try:
        if order.dry_run:
            if not _current(_existing(order, shot, _digest(shot))):
                errors = order.open(shot, share.memory, note).errors
                return Outcome("planned", f"{shot.source} -> {output}", {"output": str(output), "dry_run": True}, errors)
            facts = {"output": str(output), "current": True, "dry_run": True}
            return Outcome("current", f"{output}: is up to date", facts, order.failures(shot))
        output.parent.mkdir(parents=True, exist_ok=True)
        with output_lock(output, wait=share.last) as free:
            return _make_locked(order, share, shot, note, progress) if free else Outcome("postponed")
    except FileExistsError:
        raise OutputError(f"{output}: {output.parent} is not a folder; remove it, or use another output folder") from None
    except OSError as error:
        raise OutputError(f"{output}: cannot be written ({error.strerror or error})") from error


@dataclass(frozen=True)
class _Existing:
    """What exists already under the name of an output.

    current: the outcome when it is up to date, made by this run or by an earlier one; otherwise None.
    replace: it may be replaced.
    changed: a render made it, and somebody has changed it since.
    """

    current: State | None = None
    replace: bool = False
    changed: bool = False


def _existing(order: Order, shot: Shot, source_digest: str | None) -> list[_Existing]:
    """What exists under the name of each output. Raises OutputError for a file that must stay."""
    return [_existing_output(order, shot.source, output, source_digest) for output in shot.outputs]


def _current(existing: list[_Existing]) -> State | None:
    """The outcome when all outputs are up to date; otherwise None."""
    return existing[0].current if all(each.current for each in existing) else None


def _existing_output(order: Order, source: str, output: Path, source_digest: str | None) -> _Existing:
    if not output.exists():
        return _Existing(replace=order.overwrite)
    made = _journal(order.folder).of(order.name(output))
    of_this_run = bool(made) and made[-1].run == order.run  # by a process that died before it could say so
    if not (order.resume or of_this_run):
        if not order.overwrite:
            refuse_existing([output])
        return _Existing(replace=True)
    if not made and not order.overwrite:
        raise OutputError(f"{output}: exists already, and no render noted that it made it; `overwrite=True` replaces it")
    found = digest(output)
    if made and source_digest and made[-1].digest == found and made[-1].key == order.key(output, source_digest):
        return _Existing("made" if of_this_run else "current", True)
    if made and not order.overwrite and _both_there(made[-1].source, source):
        raise OutputError(f"{output}: is the picture of {made[-1].source}; use another output folder, or `overwrite=True`")
    return _Existing(None, True, not order.overwrite and found not in {entry.digest for entry in made})


def _make_locked(order: Order, share: Share, shot: Shot, note: Note, progress: StageProgress) -> Outcome:
    """Make the picture while this process holds the lock on the output."""
    start = time.monotonic()
    output, source = shot.output, shot.source
    before, source_digest = _states(shot), _digest(shot)
    existing = _existing(order, shot, source_digest)
    if state := _current(existing):
        return Outcome(state, f"{output}: is up to date", {"output": str(output), "current": True}, order.failures(shot))
    subject, settings = _read(order, share, shot, note, progress), order.settings
    mosaic = subject.mosaic
    with announced_compilation(note, progress):
        if source_digest is None or _states(shot) != before:
            raise InputError(f"{source}: has changed while it was read; render it again when it is complete")
        if not share.last and needed_memory(mosaic, order.kind, settings, subject.count) > share.memory:
            return Outcome("postponed")
        check_memory(mosaic, order.kind, settings, share.memory, subject.count)
        compile_ahead([settings], share.processes, note, progress)  # now that only the writing can fail
        if mosaic.calibration.noise is None:
            taken = "estimated from the shot" if settings.noise.estimate else "taken as zero"
            note(f"{source}: the noise level is unknown and {taken}; calibrate the camera for better colour")
        calibration = mosaic.calibration
        if calibration.neutral is None and calibration.camera_to_xyz is None and order.kind.has_white_balance:
            note(f'{source}: the white balance is unknown and taken as even; `wb="auto"` estimates it, `wb="R,G,B"` sets it')
        for zoomed in calibration.zoomed(mosaic.metadata.focal_length):
            note(f"{source}: {zoomed}")
        subject.prepare(settings, progress)
        mosaic = subject.mosaic
        for each, path in zip(existing, shot.outputs, strict=True):
            if each.changed:
                note(f"{path}: has changed since it was made; it is kept as {keep_old(path).name}")

        def note_made(made: Path, part: Path) -> None:
            absolute = os.path.abspath(source)  # noqa: PTH100 (without following links)
            entry = Entry(order.name(made), digest(part) or "", order.key(made, source_digest), order.run, absolute)
            _journal(order.folder).append(entry)

        def journal(made: Path, part: Path) -> Callable[[], None]:
            return writer.submit(note_made, made, part).result

        # Journal and picture are fsynced at the same time: for small pictures fsync takes most of the time, and a large one is
        # digested meanwhile. The pool is this picture's own: one that stays would wait for ever for a thread whose start is
        # interrupted.
        with ThreadPoolExecutor(1) as writer:
            solved = render_to(
                output,
                mosaic,
                order.kind,
                settings,
                progress,
                exposure=order.exposure,
                overwrite=existing[0].replace,
                on_complete=partial(journal, output),
                bands=subject.bands,
            )
            for path, each, data in zip(shot.outputs[1:], existing[1:], subject.beside(settings, progress), strict=True):
                write_durably(path, data, overwrite=each.replace, on_complete=partial(journal, path))
    from offline import network_name

    seconds = time.monotonic() - start
    rows, columns = written_shape(order.kind, mosaic.shape, mosaic.metadata)
    line = f"{output}: {columns} x {rows}, {order.kind.bits} bits, {order.kind.space}, {subject.words}{seconds:.1f} s"
    solvers = {name: asdict(each) for name, each in solved.items()}
    facts = {"output": str(output), "width": columns, "height": rows, "seconds": round(seconds, 3), "solvers": solvers}
    facts["neutral"], facts["neutral_estimated"] = mosaic.calibration.neutral, mosaic.calibration.neutral_estimated
    facts["learned"] = network_name(mosaic.pattern) if settings.learned.used else None
    return Outcome("made", line, facts | subject.facts(), subject.errors)


def _read(order: Order, share: Share, shot: Shot, note: Note, progress: StageProgress) -> Subject:
    """What the picture is rendered from. Decoding leaves a processor idle: meanwhile the renderer is loaded."""
    progress.stage("reading", 1)
    with ThreadPoolExecutor(1, "reading") as reader, _frequent_turns():
        subject = reader.submit(order.open, shot, share.memory, note)
        with announced_compilation(note, progress):
            load_compiled(order.settings)
        return subject.result()


@contextmanager
def _frequent_turns() -> Iterator[None]:
    """In the `with` block, let a thread that needs the interpreter for a moment have it soon: every tile's digest asks for it."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(_TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(usual)


@lru_cache(maxsize=1)  # so that a process reads a long journal once
def _journal(folder: Path) -> Journal:
    return Journal(folder)


def _digest(shot: Shot) -> str | None:
    """Digest of the files that a picture is made from; None if there is only one, and it cannot be read."""
    return key(frames=[digest(name) for name in shot.frames]) if shot.frames else digest(shot.source)


def _states(shot: Shot) -> list[tuple[int, ...] | None]:
    return [_state(name) for name in shot.files]


def _state(source: str) -> tuple[int, ...] | None:
    """Identity, size and time of a file, by which a change shows; None when there is no such file."""
    status = file_status(source)
    return (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns) if status else None


def _both_there(one: str, other: str) -> bool:
    """Whether these are two existing files, rather than one that was moved."""
    first, second = identity(one), identity(other)
    return bool(first and second) and first != second
