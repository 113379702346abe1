"""Work on the workers of a dask scheduler, on any number of machines that see the same folders.

When a worker is lost the scheduler gives its pieces to another one. A worker does one piece at a time: start one process per core,
`dask worker --nthreads 1`.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from shared.errors import InputError, PanchromaError

from .worker_pool import result_or_error

P = TypeVar("P")
R = TypeVar("R")

_SECONDS = 20  # that a scheduler has to answer
_AHEAD = 1000  # pieces submitted at a time: there may be a million
_ONE_AT_A_TIME = threading.Lock()  # in a worker: a piece uses several threads itself, and the memory is for one


@contextmanager
def connected(address: str | None, file: str | None) -> Iterator[Any]:
    """The client of the scheduler at `address`, or of the one that wrote `file`. Raises InputError when none answers."""
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise InputError("--scheduler needs the package distributed; install it: pip install -e '.[all,cluster]'") from None
    if not (address or Path(file or "").is_file()):  # dask would wait for it
        raise InputError(f"{file}: there is no such file; `dask scheduler --scheduler-file {file}` writes it")
    try:
        client = Client(address, timeout=_SECONDS, scheduler_file=None if address else file)
    except (OSError, ValueError, TimeoutError, ImportError, MemoryError) as error:  # a MemoryError: what answers is not dask
        raise InputError(
            f"{address or file}: no scheduler answers ({error}); start one with `dask scheduler`, and workers with `dask worker`"
        ) from None
    with client:
        yield client


def run(client: Any, work: Callable[[P], R], pieces: Sequence[P]) -> Iterator[tuple[P, R | BaseException]]:
    """Call `work` for each piece on the workers and yield (piece, result or exception), in the order in which they end.

    The result is an InputError for a piece that killed too many workers (dask's `allowed-failures`), or when the scheduler is gone.
    """
    from distributed import KilledWorker, as_completed

    waiting = iter(pieces)
    at_work: dict[Any, P] = {}

    def submit(count: int) -> list[Any]:
        begun = {client.submit(_locked, work, piece, pure=False): piece for piece in islice(waiting, count)}
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
                error = InputError("the scheduler is gone; start it and this command again, what is finished is kept")
            elif isinstance(error, KilledWorker):
                error = InputError(
                    "its workers were killed, most likely for want of memory; give them more memory, or fewer threads"
                )
            yield piece, error
    finally:
        if at_work:
            client.cancel(list(at_work))


def _locked(work: Callable[[P], R], piece: P) -> R | PanchromaError | MemoryError:
    with _ONE_AT_A_TIME:
        return result_or_error(work, piece)  # dask would log what is raised


def everywhere(source: str) -> str:
    """The absolute path of a file, for other machines; what is not a file, such as a built-in scene, unchanged."""
    return os.path.abspath(source) if os.path.exists(source) else source  # noqa: PTH100, PTH110 (Path takes no impossible names)
