"""Render a list of shots, on this machine or on others: how many processes, memory for each, which shots are postponed."""

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

from shared.errors import OutputError, PanchromaError
from shared.processors import processors
from tools.batch.cluster import Cluster, absolute_path
from tools.batch.console import Console
from tools.batch.jobs import Job, JobWorkers, Outcome, Work, file_status
from tools.batch.memory import allowed_memory
from tools.batch.processes import Processes
from tools.batch.progress import REMARKS, Note, StageProgress
from tools.batch.work import Here

from .attempt import attempt
from .checks import needed_memory
from .compilation import compile_ahead
from .order import Order, Share

Pass = tuple[Work, JobWorkers]
"""What is done to each job, and how; the last one of several does the jobs that those before it have postponed."""

_MANY = 2  # shots per processor from which on one process per processor pays
_LARGEST = 3  # files that are read to learn how much memory the largest shot needs
_REMEDY = "render it with `workers=1`, or allow more with `max_memory`"


def _largest_need(order: Order, jobs: Sequence[Job]) -> int:
    """Bytes that the largest shot needs, roughly. The largest files are read: they have the most pixels, or nearly."""
    for _, source in sorted(((_size(job.source), job.source) for job in jobs), reverse=True)[:_LARGEST]:
        try:
            return needed_memory(order.read(source), order.kind, order.settings)
        except (PanchromaError, MemoryError):
            continue
    return 1


def _size(source: str) -> int:
    status = file_status(source)
    return status.st_size if status else 0


def passes(
    order: Order, jobs: Sequence[Job], console: Console, *, workers: int | None, threads: int | None, memory: int | None
) -> list[Pass]:
    """The passes of this machine over some jobs. The last one does postponed jobs one by one, each with all the memory.

    workers: number of processes.
    threads: of each process.
    memory: bytes for all processes together.

    What is left open (None) is chosen by processors and memory: one process for a few shots. If there is only one job, the console
    shows its stages.
    """
    cores, allowed = processors(), allowed_memory(memory)
    if workers is None:
        many = len(jobs) >= _MANY * cores
        workers = max(1, min(cores // (threads or 1), allowed // _largest_need(order, jobs))) if many else 1
    workers = max(1, min(workers, len(jobs)))
    threads = threads or max(1, cores // workers)
    note = lru_cache(REMARKS)(console.note)  # several processes send the same note: it is shown once
    alone = Here(lambda job: console.progress(job.source) if len(jobs) == 1 else StageProgress(note=console.note))
    last: Pass = partial(attempt, order, Share(allowed, True, threads)), alone
    if len(jobs) == 1:
        return [last]
    if workers == 1:
        return [(partial(attempt, order, Share(allowed, False, threads)), alone), last]
    compile_ahead([order.settings], workers, StageProgress(note=note))
    share = Share(allowed // workers)
    return [(partial(attempt, order, share), Processes(workers, note, _REMEDY, threads)), last]


def shard_of(output: str, count: int) -> int:
    """The part, 1 to `count`, of a divided run that makes the picture with this path below the output folder.

    The path alone decides: machines agree without communication, and a new file does not change the part of any other.
    """
    return int.from_bytes(hashlib.sha256(os.fsencode(output)).digest()[:8], "big") % count + 1


def scheduled_passes(order: Order, client: Any, threads: int | None, memory: int | None, note: Note) -> list[Pass]:
    """The passes over a list of jobs by the workers of a dask scheduler, on any number of machines that see the same folders.

    A lost worker costs no result: another one gets its shots, and finds in the journal what is made already.

    order: settings of the run.
    client: of the dask scheduler.
    threads: number for each worker; None = as many as it was started with.
    memory: limit for each worker, bytes; None = most of its free memory.
    note: called with each different remark of the workers, and with each remark on them.

    Raises SchedulerGoneError when the scheduler ends.
    """
    order, cluster = replace(order, folder=order.folder.absolute()), Cluster(client, note)

    def elsewhere(
        work: Callable[[Job, StageProgress], Outcome], jobs: Sequence[Job], /
    ) -> Iterator[tuple[Job, Outcome | Exception]]:
        there = {_with_absolute_names(job): job for job in jobs}
        for named, result in cluster(work, list(there)):
            job = there[named]
            if isinstance(result, Outcome) and result.state == "made" and not job.output.exists():
                unseen = "was made where this machine does not see it; `output` must be a shared folder"
                yield job, OutputError(f"{job.output}: {unseen}")
            else:
                yield job, result

    return [(partial(_work, order, threads, memory, last), elsewhere) for last in (False, True)]


def _with_absolute_names(job: Job) -> Job:
    return replace(job, source=absolute_path(job.source), outputs=tuple(path.absolute() for path in job.outputs))


def _work(order: Order, threads: int | None, memory: int | None, last: bool, job: Job, listener: StageProgress) -> Outcome:
    """On a worker: see `attempt`."""
    from distributed import get_worker

    from offline import available_threads, use_threads

    use_threads(min(threads or get_worker().state.nthreads, available_threads()))  # counts for this thread alone
    return attempt(order, Share(allowed_memory(memory), last), job, listener)
