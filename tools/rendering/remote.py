"""Rendering on the workers of a dask scheduler, on any number of machines that see the same folders.

A lost worker costs no result: another one gets its shots, and finds in the journal what is made already.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from shared.errors import OutputError
from tools.host.cluster import Cluster, absolute_path
from tools.host.jobs import Job, Outcome
from tools.host.memory import allowed_memory
from tools.host.progress import Note, StageProgress

from .attempt import attempt
from .order import Order, Share
from .run import Pass


def passes(order: Order, client: Any, threads: int | None, memory: int | None, note: Note) -> list[Pass]:
    """The passes over a list of jobs by dask workers; on this machine alone `tools.rendering.run.passes` takes their place.

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
