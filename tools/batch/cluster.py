"""The workers of a dask scheduler as an executor: any number of machines that see the same folders.

When a worker is lost the scheduler gives its items to another one. A worker does one item at a
time: start one process per core, `dask worker --nthreads 1`. A worker that runs another source than
this program is refused, and ends the run.
"""

import logging
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from ...shared.errors import InputError, PanchromaError
from ...shared.source import code_digest
from ..io.versions import install_command
from .console import one_line
from .parallel import Executor, Function, P, R, call
from .progress import Note

_SECONDS = 20  # that a scheduler has to answer
# in a worker: an item uses several threads itself, and all the memory
_ONE_AT_A_TIME = threading.Lock()
_LOST = (OSError, RuntimeError, TimeoutError, CancelledError)  # raised by dask without a scheduler


class SchedulerGoneError(PanchromaError):
    """The scheduler has ended while it had work of ours."""


@contextmanager
def cluster(address: str, note: Note) -> Iterator[Executor]:
    """Connect to a scheduler; what is not finished at the end of the `with` block is cancelled.

    address: of the scheduler, tcp://HOST:PORT. note: called when there is no worker, for which this
    waits. Raises InputError: no scheduler answers, or a worker runs another source. Raises
    SchedulerGoneError: the scheduler ends.
    """
    try:
        from distributed import Client, KilledWorker
    except ModuleNotFoundError:
        raise InputError(
            "`scheduler` needs the package distributed; install it: "
            + install_command("all,cluster")
        ) from None
    for name in [
        name
        for name in logging.root.manager.loggerDict
        if name.startswith(("distributed", "tornado"))
    ]:
        logging.getLogger(name).setLevel(logging.CRITICAL)  # users are told here, in one line
    try:
        client = Client(address, timeout=_SECONDS)
    except Exception as error:  # each kind of address, and of server that is not dask, has its own
        raise InputError(
            f"{address}: no scheduler answers ({one_line(str(error))}); start one with "
            "`dask scheduler`, and workers with `dask worker`"
        ) from None
    executor, source = client.get_executor(pure=False), source_digest()
    remedy = "give its workers more memory, or fewer threads"
    try:
        if not client.nthreads():
            note(
                f"waiting for workers of {address}: start one per core with "
                f"`dask worker --nthreads 1 --host ADDRESS {address}` (ADDRESS: the worker's own)"
            )
            client.wait_for_workers(1)
        yield Executor(
            lambda function, item: executor.submit(_call, source, function, item),
            (KilledWorker,),
            remedy,
        )
    except _LOST:
        advice = "what is finished stays: start the scheduler, its workers and this command again"
        raise SchedulerGoneError(f"the scheduler {address} is gone; {advice}") from None
    finally:
        with suppress(*_LOST):
            executor.shutdown(wait=False)  # cancels
        with suppress(*_LOST):
            client.close()


def _call(source: str, function: "Function[P, R]", item: P) -> tuple[R | Exception, Sequence[str]]:
    """On a worker: see `parallel.call`. Raises InputError on a worker with another source."""
    if source != source_digest():
        other = f"a worker runs another source of Panchroma ({source_digest()}, here {source})"
        raise InputError(f"{other}; install this one there, and start its workers again")
    with _ONE_AT_A_TIME:
        return call(function, item)


@cache
def source_digest() -> str:
    """Digest of the modules and networks of this installation."""
    modules = (f"{package}/**/*.py" for package in ("shared", "device", "offline", "tools"))
    return code_digest(Path(__file__).parents[2], *modules, "offline/models/*.onnx")


def absolute_path(source: str) -> str:
    """The absolute path of a file, for other machines; what is not a file, such as a built-in
    scene, unchanged.
    """
    return os.path.abspath(source) if os.path.exists(source) else source  # noqa: PTH100, PTH110 (Path takes no impossible names)
