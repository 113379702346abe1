"""The unit of work: one shot, one picture, made once, by whichever process on whichever machine gets it."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import count
from pathlib import Path

from shared.errors import ForeignFileError, InputError, OutputError, PanchromaError
from tools.host.compilation import telling_compilation
from tools.host.console import StageProgress, fault
from tools.host.jobs import refuse_existing

from .journal import Entry, Journal, digest
from .lock import making
from .order import Note, Order, Outcome, Share, State
from .picture_file import check_memory, needed_memory, render_to
from .shots import Shot


def attempt(order: Order, share: Share, shot: Shot, note: Note, progress: StageProgress) -> Outcome:
    """Make a picture, or say why there is none; whatever goes wrong with one shot stops no other.

    note: is told what one should know beside the result. Only interrupts are raised.
    """
    try:
        return _make(order, share, shot, note, progress)
    except ForeignFileError as error:
        return Outcome("foreign" if shot.found else "failed", str(error))
    except PanchromaError as error:
        return Outcome("failed", str(error))
    except MemoryError:
        return Outcome("failed", "not enough memory for a picture of this size")
    except Exception as error:
        # So that one odd file does not cost a night's batch; `fault` says that it is ours to mend.
        return Outcome("failed", fault(error))


def _make(order: Order, share: Share, shot: Shot, note: Note, progress: StageProgress) -> Outcome:
    output = shot.output
    if not order.folder.is_dir():
        raise OutputError(f"{order.folder}: the output folder is not there; every machine at work has to see it under this name")
    if _state(shot.source) is None:
        order.read(shot.source)  # says what is wrong with it, before a folder is made for its picture
    if order.dry_run:
        if _standing(order, shot, digest(shot.source)).current is None:
            order.read(shot.source)
            return Outcome("planned", f"{shot.source} -> {output}", {"output": str(output), "dry_run": True})
        return Outcome("current", f"{output}: is current", {"output": str(output), "current": True, "dry_run": True})
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        with making(output, wait=share.last) as free:
            return _make_alone(order, share, shot, note, progress) if free else Outcome("postponed")
    except OSError as error:
        raise OutputError(f"{output}: cannot be written ({error.strerror or error})") from error


@dataclass(frozen=True)
class _Standing:
    """What is in the place of an output. current: what should be, by this run or one before; replace: it may be replaced; changed:
    it was made here, and somebody has worked on it since.
    """

    key: str
    current: State | None = None
    replace: bool = False
    changed: bool = False


def _standing(order: Order, shot: Shot, source_digest: str | None) -> _Standing:
    """Raises OutputError when something is there that must stay."""
    output, wanted = shot.output, order.key(shot.output, source_digest or "")
    if not output.exists():
        return _Standing(wanted, replace=order.overwrite)
    made = _journal(order.folder).of(order.name(output))
    of_this_run = bool(made) and made[-1].run == order.run  # by a process that died before it could say so
    if not (order.resume or of_this_run):
        if not order.overwrite:
            refuse_existing([output])
        return _Standing(wanted, replace=True)
    if not made and not order.overwrite:
        raise OutputError(f"{output}: exists already, and no render noted that it made it; --overwrite replaces it all the same")
    found = digest(output)
    if made and source_digest and (made[-1].key, made[-1].digest) == (wanted, found):
        return _Standing(wanted, "made" if of_this_run else "current")
    if made and not order.overwrite and _both_there(made[-1].source, shot.source):
        raise OutputError(f"{output}: is the picture of {made[-1].source}; use another output folder, or --overwrite")
    return _Standing(wanted, None, True, not order.overwrite and found not in {entry.digest for entry in made})


def _make_alone(order: Order, share: Share, shot: Shot, note: Note, progress: StageProgress) -> Outcome:
    """With the lock on the output in hand."""
    start = time.monotonic()
    output, source = shot.output, shot.source
    before, source_digest = _state(source), digest(source)
    standing = _standing(order, shot, source_digest)
    if standing.current:
        return Outcome(standing.current, f"{output}: is current", {"output": str(output), "current": True})
    with telling_compilation(note, progress):
        progress.stage("reading", 1)
        mosaic = order.read(source)
        if source_digest is None or _state(source) != before:
            raise InputError(f"{source}: has changed while it was read; render it again when it is complete")
        settings = order.settings
        if not share.last and needed_memory(mosaic, order.kind, settings) > share.memory:
            return Outcome("postponed")
        check_memory(mosaic, order.kind, settings, share.memory)
        if mosaic.calibration.noise is None:
            taken = "estimated from the shot" if settings.noise.estimate else "taken for none"
            note(f"{source}: the noise is unknown and {taken}; calibrate the camera for better colour")
        if standing.changed:
            note(f"{output}: has changed since it was made; it is kept as {_set_aside(output).name}")

        def sealed(part: Path) -> Callable[[], None]:
            absolute = os.path.abspath(source)  # noqa: PTH100 (without following links)
            entry = Entry(order.name(output), digest(part) or "", standing.key, order.run, absolute)
            return _NOTING.submit(_journal(order.folder).append, entry).result

        solved = render_to(
            output, mosaic, order.kind, settings, progress, exposure=order.exposure, overwrite=standing.replace, sealed=sealed
        )
    seconds = time.monotonic() - start
    rows, columns = mosaic.shape
    line = f"{output}: {columns} x {rows}, {order.kind.bits} bits, {order.kind.space}, {seconds:.1f} s"
    solvers = {name: asdict(each) for name, each in solved.items()}
    facts = {"output": str(output), "width": columns, "height": rows, "seconds": round(seconds, 3), "solvers": solvers}
    return Outcome("made", line, facts)


# Journal and picture go to the disk at the same time: for small pictures that is most of what a file costs.
_NOTING = ThreadPoolExecutor(1)


@lru_cache(maxsize=1)  # so that a process reads a long journal once
def _journal(folder: Path) -> Journal:
    return Journal(folder)


def _state(source: str) -> tuple[int, ...] | None:
    """What changes when a file does; None when there is none."""
    try:
        status = os.stat(source)  # noqa: PTH116 (Path takes no impossible names)
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


def _both_there(one: str, other: str) -> bool:
    """Whether these are two files, rather than one that has been moved."""
    try:
        return not Path(one).samefile(other)
    except (OSError, ValueError):
        return False


def _set_aside(path: Path) -> Path:
    """Give a file a second name, NAME.bak, NAME.bak2, ...; returns it. Nothing that has such a name already is touched."""
    for number in count(1):
        spare = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        try:
            os.link(path, spare)
        except FileExistsError:
            if spare.samefile(path):
                break
        except OSError:  # no hard links here (FAT, some network shares)
            if not spare.exists():
                path.rename(spare)
                break
        else:
            break
    return spare
