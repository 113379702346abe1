"""The same unit of work on the workers of a dask scheduler, on any number of machines that see the same folders.

A worker that is lost costs nothing but time: the scheduler gives what it had to another, whose lock and journal tell it what is
made already. Workers render one shot at a time, with their threads: start one process per core, `dask worker --nthreads 1`.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from shared.errors import InputError, PanchromaError

from . import workers

P = TypeVar("P")
R = TypeVar("R")

_SECONDS = 20  # to answer, for a scheduler
_AHEAD = 1000  # shots that the scheduler knows of: it may be given a million
ALONE = threading.Lock()  # in a worker: the kernels share out their own threads, and its memory is for one shot


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


def run(client: Any, work: Callable[[P], R], pieces: Sequence[P]) -> Iterator[tuple[P, R | BaseException]]:
    """Do `work` on each piece, wherever there is a worker; (piece, result or what was raised), in the order in which they end.

    InputError stands for a piece that ended as many workers as the scheduler grants it, and for a scheduler that is gone.
    """
    from distributed import KilledWorker, as_completed

    waiting = iter(pieces)
    at_work: dict[Any, P] = {}

    def submit(count: int) -> list[Any]:
        begun = {client.submit(work, piece, pure=False): piece for piece in islice(waiting, count)}
        at_work.update(begun)
        return list(begun)

    ended = as_completed(submit(_AHEAD))
    try:
        for future in ended:
            piece = at_work.pop(future)
            for following in submit(1):
                ended.add(following)
            if future.status == "finished":
                yield piece, future.result()
                continue
            error = future.exception() if future.status == "error" else None
            if error is None:
                error = InputError("the scheduler is gone; start it again, and run the command again: what is finished is kept")
            elif isinstance(error, KilledWorker):
                error = InputError("the workers that had it died, most likely for want of memory: give them more, or fewer threads")
            yield piece, error
    finally:
        if at_work:
            client.cancel(list(at_work))


def run_quietly(client: Any, work: Callable[[P], R], pieces: Sequence[P], count: int) -> Iterator[tuple[P, R | BaseException]]:
    """`run` as `evaluation.workers.run` does it; one piece at a time in each worker, however many there are (not `count`)."""
    return run(client, partial(_alone, work), pieces)


def _alone(work: Callable[[P], R], piece: P) -> "R | PanchromaError | MemoryError":
    with ALONE:
        return workers.attempt(work, piece)


def everywhere(source: str) -> str:
    """The name of a file wherever a process runs; what is no file, such as a built-in scene, as it is."""
    return os.path.abspath(source) if os.path.exists(source) else source  # noqa: PTH100, PTH110 (Path takes no impossible names)
