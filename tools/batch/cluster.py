"""Work on the workers of a dask scheduler, on any number of machines that see the same folders.

When a worker is lost the scheduler gives its pieces to another one. A worker does one piece at a time: start one process per core,
`dask worker --nthreads 1`. A worker that runs another source than this program is refused, and ends the run.
"""

import hashlib
import json
import logging
import os
import platform
import threading
import time
from asyncio import CancelledError
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError as FutureCancelledError
from concurrent.futures import wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from shared.errors import InputError, PanchromaError
from shared.reading import read_text
from tools.io.ahead import promised
from tools.io.versions import package_version

from .console import OUR_PACKAGES, once_each, one_line
from .progress import REMARKS, Note, StageProgress
from .signals import raise_lost_signal
from .work import portable, result_or_error

P = TypeVar("P")
R = TypeVar("R")

_SECONDS = 20  # that a scheduler has to answer
_LARGEST_FILE = 1 << 20  # bytes of a scheduler's file; one with thousands of workers has less
_AHEAD = 1000  # pieces submitted at a time: there may be a million
_POLL = 1.0  # seconds without a result after which the scheduler is looked at
_INSTALL = "install this one there, and start its workers again"
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
    ended = promised(connect)
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
    """A way to work (`tools.batch.work.Workers`): by the workers of a dask scheduler.

    Work, pieces and results are pickled. The result of a piece that killed too many workers (dask's `allowed-failures`) is an
    InputError.

    client: see `connected`.
    note: called with each remark of the work, once, and with those on workers: which have other versions, and that there are none.
    """

    def __init__(self, client: Any, note: Note) -> None:
        self._client, self._note = client, lru_cache(REMARKS)(note)  # several workers have the same to say
        self._address: str = client.scheduler.address

    def __call__(self, work: Callable[[P, StageProgress], R], pieces: Sequence[P], /) -> Iterator[tuple[P, R | Exception]]:
        """See `Workers`. Raises SchedulerGoneError when the scheduler ends, InputError for a worker with another Panchroma."""
        unfinished = len(pieces)
        try:
            if pieces:
                self._check_workers()
            for piece, result in self._results(work, iter(pieces)):
                unfinished -= 1
                yield piece, result
        except _LOST:
            raise SchedulerGoneError(
                f"the scheduler {self._address} is gone, and {unfinished} of {len(pieces)} pieces of work are not finished; what "
                "is finished stays: start the scheduler, its workers and this command again"
            ) from None

    def _check_workers(self) -> None:
        """Wait until there are workers, with a note to the user, and ask each what it runs."""
        command = f"`dask worker --nthreads 1 --host ADDRESS {self._address}`"
        while not self._client.nthreads():
            if self._client.status != "running":
                raise RuntimeError(self._client.status)
            self._note(f"waiting for workers of {self._address}: start one per core with {command} (ADDRESS: the worker's own)")
            raise_lost_signal()
            time.sleep(_POLL)
        answers = self._client.run(program, on_error="return").items()
        there = ((address, answer) for address, answer in answers if not isinstance(answer, OSError))  # otherwise it has left
        for line in once_each((f"worker {address}", _judged(address, answer)) for address, answer in there):
            self._note(line)

    def _results(self, work: Callable[[P, StageProgress], R], waiting: Iterator[P]) -> Iterator[tuple[P, R | Exception]]:
        """Yield (piece, result) as pieces end. Raises one of `_LOST` when the scheduler is gone."""
        from distributed import KilledWorker

        at_work: dict[Any, P] = {}
        ended: SimpleQueue[Any] = SimpleQueue()
        try:
            while True:
                for piece in islice(waiting, _AHEAD - len(at_work)):
                    future = self._client.submit(_done, program().source, work, piece, pure=False)
                    at_work[future] = piece
                    future.add_done_callback(ended.put)
                if not at_work:
                    return
                raise_lost_signal()
                try:
                    future = ended.get(timeout=_POLL)
                except Empty:
                    if self._client.status != "running":
                        raise RuntimeError(self._client.status) from None
                    continue
                piece = at_work.pop(future)
                if future.status == "finished":
                    result, notes = future.result()
                    for text in notes:
                        self._note(text)
                elif future.status != "error":
                    raise RuntimeError(future.status)
                elif isinstance(future.exception(), KilledWorker):
                    result = InputError(
                        "its workers were killed, most likely for want of memory; give them more memory, or fewer threads"
                    )
                else:  # `_done` raises nothing but what says that the worker came later, and runs something else
                    raise InputError(f"a worker was refused: {one_line(str(future.exception()))}; {_INSTALL}")
                yield piece, result
        finally:
            if at_work:
                with suppress(*_LOST):
                    self._client.cancel(list(at_work))


def _judged(address: str, answer: object) -> str:
    """A remark on a worker that answers so, "" = none. Raises InputError for one that runs another source."""
    if not isinstance(answer, Program):
        reason = one_line(f"{type(answer).__name__}: {answer}")
        raise InputError(f"worker {address}: has no Panchroma, or another one ({reason}); {_INSTALL}")
    check_source(answer.source, f"worker {address}: ")
    here = dict(program().versions)
    other = [f"{name} {there} (here {here[name]})" for name, there in answer.versions if there != here[name]]
    return f"has {', '.join(other)}: its results may differ from those made here in the last bits" if other else ""


def check_source(source: str, who: str = "") -> None:
    """Raise InputError, which begins with `who`, if this is not the digest of the source that this process runs."""
    if source != program().source:
        raise InputError(f"{who}runs another source of Panchroma ({source}, here {program().source}); {_INSTALL}")


def _done(source: str, work: Callable[[P, StageProgress], R], piece: P) -> tuple[R | Exception, Sequence[str]]:
    """On a worker: the result, and notes. Raises InputError on a worker with another source, which came after all were asked."""
    check_source(source)
    notes: list[str] = []
    with _ONE_AT_A_TIME:
        return portable(result_or_error(work, piece, StageProgress(note=notes.append))), notes  # dask would log what is raised


def absolute_path(source: str) -> str:
    """The absolute path of a file, for other machines; what is not a file, such as a built-in scene, unchanged."""
    return os.path.abspath(source) if os.path.exists(source) else source  # noqa: PTH100, PTH110 (Path takes no impossible names)
