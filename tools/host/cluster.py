"""Work on the workers of a dask scheduler, on any number of machines that see the same folders.

When a worker is lost the scheduler gives its pieces to another one. A worker does one piece at a time: start one process per core,
`dask worker --nthreads 1`. Only workers that run the source of this program get work.
"""

import hashlib
import json
import logging
import math
import os
import platform
import threading
import time
from asyncio import CancelledError
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError as FutureCancelledError
from concurrent.futures import Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from shared.errors import InputError, PanchromaError
from shared.reading import read_text

from .console import OUR_PACKAGES, one_line
from .progress import Note, StageProgress
from .signals import raise_lost_signal
from .versions import package_version
from .work import portable, result_or_error

P = TypeVar("P")
R = TypeVar("R")

_SECONDS = 20  # that a scheduler has to answer
_LARGEST_FILE = 1 << 20  # bytes of a scheduler's file; one with thousands of workers has less
_AHEAD = 1000  # pieces submitted at a time: there may be a million
_POLL = 1.0  # seconds without a result after which the scheduler is looked at
_LOOK = 5.0  # seconds between two looks at the workers
_SAY = 60.0  # seconds between two lines that say that workers are missing
_ONE_AT_A_TIME = threading.Lock()  # in a worker: a piece uses several threads itself, and the memory is for one
_PACKAGES = ("numpy", "numba", "scipy", "onnxruntime")  # another version of them may change a picture's last bits
_LOST = (OSError, RuntimeError, TimeoutError, CancelledError, FutureCancelledError)  # by which dask says that a scheduler is gone


class SchedulerGoneError(PanchromaError):
    """The scheduler has ended while it had work of ours."""


@dataclass(frozen=True)
class Program:
    """What a process runs: a digest of Panchroma's source, and the versions of Python and of the packages that count."""

    source: str
    versions: tuple[tuple[str, str | None], ...]


@cache
def program() -> Program:
    """The program of this process."""
    versions = ((name, package_version(name)) for name in _PACKAGES)
    return Program(source_digest(Path(__file__).parents[2]), (("Python", platform.python_version()), *versions))


def source_digest(root: Path) -> str:
    """Digest of all files of our packages below a folder, but of texts (*.md) and compiled code: 16 hexadecimal digits."""
    total = hashlib.sha256()
    for path in sorted(path for package in OUR_PACKAGES for path in (root / package).rglob("*") if path.is_file()):
        if path.suffix != ".md" and "__pycache__" not in path.parts:
            total.update(path.relative_to(root).as_posix().encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()[:16]


@contextmanager
def connected(address: str | None, file: str | None) -> Iterator[Any]:
    """The client of the scheduler at `address`, or of the one that wrote `file`. Raises InputError when none answers."""
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise InputError("`scheduler` needs the package distributed; install it: pip install -e '.[all,cluster]'") from None
    address = address or _written_address(file or "")
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what users should know is said here, in one line
    try:
        client = _in_time(partial(Client, address, timeout=_SECONDS))
    except Exception as error:  # deliberately every class: each kind of address, and whatever answers that is not dask, has its own
        raise InputError(
            f"{file or address}: no scheduler answers ({one_line(str(error))}); start one with `dask scheduler`, and workers with "
            "`dask worker`"
        ) from None
    try:
        yield client
    finally:
        with suppress(*_LOST):
            client.close()


def _in_time(connect: Callable[[], R]) -> R:
    """The result of `connect`, or its error. dask alone would wait for ever for what takes connections and is silent."""
    ended: Future[R] = Future()

    def work() -> None:
        try:
            ended.set_result(connect())
        except BaseException as error:
            ended.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    if not wait([ended], _SECONDS + _POLL).done:
        raise TimeoutError(f"silent for {_SECONDS} s")
    return ended.result()


def _written_address(file: str) -> str:
    """The address that `dask scheduler --scheduler-file` wrote. Raises InputError for any other file; dask would wait for one."""
    if not Path(file).exists():
        raise InputError(f"{file}: there is no such file; `dask scheduler --scheduler-file {file}` writes it")
    try:
        address = json.loads(read_text(file, _LARGEST_FILE, "the file of a dask scheduler"))["address"]
        if not (isinstance(address, str) and address):
            raise TypeError(address)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except (ValueError, LookupError, TypeError, RecursionError):
        raise InputError(
            f"{file}: holds no address of a scheduler; give the file that `dask scheduler --scheduler-file` wrote"
        ) from None
    return address


class Cluster:
    """A way to work (`tools.host.work.Workers`): by the workers of a dask scheduler.

    Work, pieces and results are pickled. The result of a piece that killed too many workers (dask's `allowed-failures`) is an
    InputError.

    client: see `connected`.
    note: called with each remark of the work, once, and with those on workers: which are refused or have other versions, and that
        there are none.
    """

    def __init__(self, client: Any, note: Note) -> None:
        self._client, self._note, self._once = client, note, cache(note)  # several workers have the same to say

    def __call__(self, work: Callable[[P, StageProgress], R], pieces: Sequence[P], /) -> Iterator[tuple[P, R | Exception]]:
        """See `Workers`. Raises SchedulerGoneError when the scheduler ends."""
        if not pieces:
            return
        workers, unfinished = _Workers(self._client, self._note), len(pieces)
        try:
            workers.wait()
            for piece, result, notes in self._results(work, iter(pieces), workers):
                for text in notes:
                    self._once(text)
                unfinished -= 1
                yield piece, result
        except _LOST:
            raise SchedulerGoneError(
                f"the scheduler {workers.address} is gone, and {unfinished} of {len(pieces)} pieces of work are not finished; what "
                "is finished stays: start the scheduler, its workers and this command again"
            ) from None

    def _results(
        self, work: Callable[[P, StageProgress], R], waiting: Iterator[P], workers: "_Workers"
    ) -> Iterator[tuple[P, R | Exception, Sequence[str]]]:
        """Yield (piece, result, notes) as pieces end. Raises one of `_LOST` when the scheduler is gone."""
        from distributed import KilledWorker

        at_work: dict[Any, tuple[P, list[str] | None]] = {}  # and the workers that may do it, None = all
        ended: SimpleQueue[Any] = SimpleQueue()

        def submit(again: Iterable[P] = ()) -> None:
            only = workers.allowed()
            for piece in islice(chain(again, waiting), _AHEAD - len(at_work)):
                future = self._client.submit(_locked, program().source, work, piece, pure=False, workers=only)
                at_work[future] = piece, only
                future.add_done_callback(ended.put)

        try:
            submit()
            while at_work:
                raise_lost_signal()
                try:
                    future = ended.get(timeout=_POLL)
                except Empty:
                    workers.look()
                    stuck = [future for future, (_, only) in at_work.items() if only and workers.fit.isdisjoint(only)]
                    if workers.fit and stuck:  # the workers that they were meant for have left
                        self._client.cancel(stuck)
                        submit([at_work.pop(future)[0] for future in stuck])
                    continue
                if future not in at_work:
                    continue
                piece, _ = at_work.pop(future)
                if future.status not in ("finished", "error"):
                    raise RuntimeError(future.status)
                result, notes = future.result() if future.status == "finished" else (future.exception(), ())
                if isinstance(result, _Refused) or (isinstance(result, Exception) and workers.look(again=True)):
                    workers.look(again=isinstance(result, _Refused))
                    submit([piece])
                    continue
                if isinstance(result, KilledWorker):
                    result = InputError(
                        "its workers were killed, most likely for want of memory; give them more memory, or fewer threads"
                    )
                submit()
                yield piece, result, notes
        finally:
            if at_work:
                with suppress(*_LOST):
                    self._client.cancel(list(at_work))


class _Workers:
    """The workers of a scheduler, and which of them are fit: those that run this program's source.

    address: of the scheduler.
    fit: addresses of the fit workers that were there at the last look.
    """

    def __init__(self, client: Any, note: Note) -> None:
        self._client, self._note = client, note
        self._known: dict[str, bool] = {}  # address -> whether it is fit
        self._there: set[str] = set()
        self._looked = self._said = -math.inf
        self.address: str = client.scheduler.address
        self.fit: set[str] = set()

    def wait(self) -> None:
        """Wait until there is a fit worker, with a note to the user."""
        while not self.fit:
            self._looked = -math.inf
            self.look()
            if not self.fit:
                time.sleep(_POLL)

    def allowed(self) -> list[str] | None:
        """The workers that may have work: None = all, those that come later too; as long as one is unfit only these."""
        return sorted(self.fit) if self._there - self.fit else None

    def look(self, *, again: bool = False) -> bool:
        """Ask workers that have come what they run, every few seconds at most. Returns whether one of them is unfit.

        again: ask all, at once.

        Raises RuntimeError when the scheduler is gone.
        """
        if self._client.status != "running":
            raise RuntimeError(self._client.status)
        if not again and time.monotonic() - self._looked < _LOOK:
            return False
        self._looked = time.monotonic()
        self._there = set(self._client.nthreads())
        before, self._known = self._known, {} if again else {each: self._known[each] for each in self._there & self._known.keys()}
        new = sorted(self._there - self._known.keys())
        remarks: dict[str, list[str]] = {}
        for address, answer in self._client.run(program, workers=new, on_error="return").items() if new else ():
            if isinstance(answer, OSError):  # it has left
                continue
            self._known[address], remark = _judged(answer)
            if remark and before.get(address) != self._known[address]:
                remarks.setdefault(remark, []).append(address)
        for remark, (first, *more) in remarks.items():
            self._note(f"worker {first}{f' and {len(more)} more' if more else ''}: {remark}")
        self.fit = {address for address in self._there if self._known.get(address)}
        if not self.fit and time.monotonic() - self._said >= _SAY:
            self._said = time.monotonic()
            command = f"dask worker --nthreads 1 --host ADDRESS {self.address}"
            self._note(f"waiting for workers of {self.address}: start one per core with `{command}` (ADDRESS: the worker's own)")
        return any(not self._known.get(address, True) for address in new)


def _judged(answer: object) -> tuple[bool, str]:
    """Whether a worker that answers so is fit, and a remark for the user."""
    if not isinstance(answer, Program):
        reason = one_line(f"{type(answer).__name__}: {answer}")
        return False, f"refused, because it has no Panchroma, or another one ({reason}); install this one there, and start it again"
    if answer.source != program().source:
        return False, (
            f"refused, because it runs another source of Panchroma ({answer.source}, here {program().source}); install this one "
            "there, and start it again"
        )
    here = dict(program().versions)
    other = [f"{name} {there} (here {here[name]})" for name, there in answer.versions if there != here[name]]
    return True, f"has {', '.join(other)}: its results may differ from those made here in the last bits" if other else ""


class _Refused:
    """In place of the result of a piece that a worker with another source has got."""


def _locked(source: str, work: Callable[[P, StageProgress], R], piece: P) -> tuple[R | Exception | _Refused, Sequence[str]]:
    """On a worker: the result, and notes."""
    if source != program().source:  # it came after the others had been asked
        return _Refused(), ()
    notes: list[str] = []
    with _ONE_AT_A_TIME:
        return portable(result_or_error(work, piece, StageProgress(note=notes.append))), notes  # dask would log what is raised


def absolute_path(source: str) -> str:
    """The absolute path of a file, for other machines; what is not a file, such as a built-in scene, unchanged."""
    return os.path.abspath(source) if os.path.exists(source) else source  # noqa: PTH100, PTH110 (Path takes no impossible names)
