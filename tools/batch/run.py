"""Render a list of shots, in one process or several."""

import random
from contextlib import ExitStack
from functools import lru_cache, partial

from ...shared.errors import PanchromaError
from ...shared.processors import available_threads, processors
from ...shared.writing import sweep
from .compilation import compile_ahead
from .console import Console
from .jobs import Job, counted, do_jobs, exit_code, file_status, possible_jobs
from .memory import allowed_memory, needed_memory
from .order import Order, attempt
from .parallel import follow, in_processes, one_by_one, possible_processes
from .progress import REMARKS, Note, StageProgress

_MANY = 2  # shots per processor from which on one process per processor pays
_MEASURED_SHOTS = 3  # files that are read to learn how much memory the largest shot needs


def render_all(
    order: Order, shots: list[Job], console: Console, *, jobs: int | None, memory: int | None
) -> int:
    """Render all shots that would replace nothing that must stay, with a line and a record for
    each; of several say then how many ended in which state.

    Returns the exit code.

    Parameters
    ----------
    order
        Settings of the run.
    shots
        Shots or bursts, and where their pictures go.
    console
        Shows results and progress; of a single shot, its stages.
    jobs
        Number of processes, 1 or more, fewer where memory is short; None = one for a few shots,
        otherwise one per processor. With one the work is done in this process.
    memory
        Bytes for all processes together; None = most of what is free.
    """
    possible = possible_jobs(shots, console, overwrite=order.may_replace)
    # commands that share a folder wait for a shot that another one renders: they should seldom meet
    if order.resume:
        random.shuffle(possible)
    several = len(possible) > 1
    # several processes send the same note: it is shown once
    note = lru_cache(REMARKS)(console.note)
    with ExitStack() as stack:
        progress = stack.enter_context(console.progress("render") if several else StageProgress())
        for folder in {shot.output.parent for shot in possible if not order.dry_run}:
            stack.callback(sweep, folder)  # what killed processes leave
        allowed = allowed_memory(memory)
        count = _processes(order, possible, jobs, allowed, note)
        threads_each = min(available_threads(), max(1, processors() // count))
        if count > 1:
            compile_ahead(count, StageProgress(note=note))
            remedy = "render it again with `resume=True`, and fewer processes"
            work = partial(attempt, order, allowed // count, 1)
            pool = in_processes(work, possible, count, note, remedy, threads_each)
            results = stack.enter_context(pool)
        else:
            show = console.progress if not several else partial(StageProgress, note=console.note)
            work = partial(attempt, order, allowed, threads_each)
            results = one_by_one(work, possible, lambda shot: show(shot.source))
        states = do_jobs(follow(results, possible, progress), console)
    states["failed"] += len(shots) - len(possible)
    if len(shots) > 1:
        console.note(counted(states))
    return exit_code(states)


def _processes(order: Order, shots: list[Job], jobs: int | None, memory: int, note: Note) -> int:
    """Choose the number of processes, see `render_all`."""
    count = processors()
    usual = count if len(shots) >= _MANY * count else 1
    most = min(usual if jobs is None else jobs, len(shots))
    if order.dry_run or most <= 1:
        return 1
    fitting = max(1, memory // _largest_need(order, shots))
    if jobs is not None and fitting < most:
        note(f"memory is enough for {fitting} at a time; `max_memory` sets how much may be used")
    return possible_processes(min(most, fitting), note)


def _largest_need(order: Order, shots: list[Job]) -> int:
    """Bytes that the largest shot needs, roughly. The largest files are read: they have the most
    pixels, or nearly.
    """
    sizes = {shot.source: status.st_size for shot in shots if (status := file_status(shot.source))}
    for source in sorted(sizes, key=sizes.__getitem__, reverse=True)[:_MEASURED_SHOTS]:
        try:
            return needed_memory(order.read(source), order.kind, order.settings)
        except (PanchromaError, MemoryError):
            continue
    return 1
