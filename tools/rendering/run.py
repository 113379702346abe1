"""Render a list of shots on this machine: how many processes, how much memory for each, which shots are postponed."""

import hashlib
import os
from collections.abc import Sequence
from functools import cache, partial

from shared.errors import PanchromaError
from shared.processors import processors
from tools.host.console import Console
from tools.host.jobs import Job, JobWorkers, Work, file_status
from tools.host.memory import allowed_memory
from tools.host.processes import Processes
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
    note = cache(console.note)  # several processes send the same note: it is shown once
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
