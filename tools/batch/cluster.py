"""The same unit of work on the workers of a dask scheduler, on any number of machines that see the same folders.

A worker that is lost costs nothing but time: the scheduler gives what it had to another, whose lock and journal tell it what is
made already. Workers render one shot at a time, with their threads: start one process per core, `dask worker --nthreads 1`.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from shared.errors import InputError

from ..console import StageProgress, fault
from ..memory import allowed_memory
from .run import Pass, said_once
from .sources import Shot
from .task import Note, Order, Outcome, Share, attempt

_SECONDS = 20  # to answer, for a scheduler
_AHEAD = 1000  # shots that the scheduler knows of: it may be given a million
_ALONE = threading.Lock()  # in a worker: the kernels share out their own threads, and its memory is for one shot


@contextmanager
def connected(address: str | None, file: str | None) -> Iterator[Any]:
    """The client of a scheduler, by its address or by the file that it wrote. Raises InputError when none answers."""
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise InputError("--scheduler needs the package distributed; install it: pip install -e '.[all,cluster]'") from None
    try:
        client = Client(address, timeout=_SECONDS) if address else Client(scheduler_file=_existing(file), timeout=_SECONDS)
    except (OSError, ValueError, TimeoutError, ImportError) as error:
        raise InputError(
            f"{address or file}: no scheduler answers ({error}); start one with `dask scheduler`, and workers with `dask worker`"
        ) from None
    with client:
        yield client


def _existing(file: str | None) -> str:
    if file is None or not Path(file).is_file():  # dask would wait for it
        raise InputError(f"{file}: there is no such file; `dask scheduler --scheduler-file {file}` writes it")
    return file


def passes(order: Order, client: Any, threads: int | None, memory: str | None, note: Note) -> list[Pass]:
    """How the workers go through a list. memory: of each worker; threads: of each, by default those it was started with."""
    everywhere = replace(order, folder=order.folder.absolute())
    once = said_once(note)
    return [partial(_through, client, partial(_work, everywhere, threads, memory, last), once) for last in (False, True)]


def _through(
    client: Any, work: Callable[[Shot], tuple[Outcome, list[str]]], note: Note, shots: Sequence[Shot]
) -> Iterator[tuple[Shot, Outcome | None]]:
    from distributed import as_completed

    waiting = iter(shots)
    at_work: dict[Any, Shot] = {}

    def submit(count: int) -> list[Any]:
        begun = {client.submit(work, _everywhere(shot), pure=False): shot for shot in islice(waiting, count)}
        at_work.update(begun)
        return list(begun)

    ended = as_completed(submit(_AHEAD))
    try:
        for future in ended:
            shot = at_work.pop(future)
            for following in submit(1):
                ended.add(following)
            outcome, notes = _result(future)
            for text in notes:
                note(text)
            if outcome is not None and outcome.state == "made" and not shot.output.exists():
                outcome = Outcome(
                    "failed", f"{shot.output}: was made where this machine does not see it; -o must be a shared folder"
                )
            yield shot, outcome
    finally:
        if at_work:
            client.cancel(list(at_work))


def _result(future: Any) -> tuple[Outcome | None, list[str]]:
    """What a worker has said; None for a shot that has ended as many workers as the scheduler grants it."""
    from distributed import KilledWorker

    if future.status == "finished":
        outcome, notes = future.result()
        return outcome, notes
    if future.status != "error":
        return Outcome("failed", "the scheduler is gone; start it again, and go on with --resume"), []
    error = future.exception()
    return (None if isinstance(error, KilledWorker) else Outcome("failed", fault(error))), []


def _everywhere(shot: Shot) -> Shot:
    """With names that do not depend on where a process runs."""
    return Shot(os.path.abspath(shot.source), shot.output.absolute(), shot.found)  # noqa: PTH100 (Path takes no impossible names)


def _work(order: Order, threads: int | None, memory: str | None, last: bool, shot: Shot) -> tuple[Outcome, list[str]]:
    """In a worker."""
    from distributed import get_worker

    from offline.kernels.compile import available_threads, use_threads

    notes: list[str] = []
    with _ALONE:
        use_threads(min(threads or get_worker().state.nthreads, available_threads()))  # of this thread of the worker
        outcome = attempt(order, Share(allowed_memory(memory), last), shot, notes.append, StageProgress())
    return outcome, notes
