"""Render a list of shots on this machine: how many processes, how much memory for each, which shots are postponed."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial

from shared.errors import PanchromaError
from tools.host.console import Console
from tools.host.jobs import Job, JobWorkers, Work, file_status
from tools.host.memory import allowed_memory
from tools.host.processes import Processes
from tools.host.processors import processors
from tools.host.progress import StageProgress
from tools.host.work import Here

from .attempt import attempt
from .checks import needed_memory
from .compilation import compile_ahead
from .order import Order, Share

Pass = tuple[Work, JobWorkers]
"""What is done to each job, and how; the last one of several does the jobs that those before it have postponed."""

_MANY = 2  # shots per processor from which on one process per processor pays
_LARGEST = 3  # files that are read to learn how much memory the largest shot needs
_REMEDY = "render it with `workers=1`, or allow more with `max_memory`"


@dataclass(frozen=True)
class Resources:
    """What a run may use of this machine.

    workers: number of processes.
    threads: of each process.
    memory: bytes for all processes together.
    """

    workers: int
    threads: int
    memory: int

    @classmethod
    def of(cls, order: Order, jobs: Sequence[Job], workers: int | None, threads: int | None, memory: int | None) -> "Resources":
        """What the user asks for. What is left open (None) is chosen by processors and memory: one process for a few shots."""
        cores, allowed = processors(), allowed_memory(memory)
        if workers is None:
            workers = 1
            if len(jobs) >= _MANY * cores:
                workers = max(1, min(cores // (threads or 1), allowed // _largest_need(order, jobs)))
        workers = min(workers, max(1, len(jobs)))
        return cls(workers, threads or max(1, cores // workers), allowed)


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


def passes(order: Order, resources: Resources, console: Console, count: int) -> list[Pass]:
    """The passes of this machine over `count` jobs. The last one does postponed jobs one by one, each with all the memory.

    If there is only one job, the console shows its stages.
    """
    note = cache(console.note)  # several processes send the same note: it is shown once
    alone = Here(lambda job: console.progress(job.source) if count == 1 else StageProgress(note=console.note))
    last: Pass = partial(attempt, order, Share(resources.memory, True, resources.threads)), alone
    if count == 1:
        return [last]
    if resources.workers == 1:
        return [(partial(attempt, order, Share(resources.memory, False, resources.threads)), alone), last]
    if count:
        compile_ahead([order.settings], resources.workers, StageProgress(note=note))
    share = Share(resources.memory // resources.workers)
    return [(partial(attempt, order, share), Processes(resources.workers, note, _REMEDY, resources.threads)), last]
