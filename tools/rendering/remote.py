"""Rendering on the workers of a dask scheduler, on any number of machines that see the same folders.

A lost worker costs no result: another one gets its shots, and finds in the journal what is made already.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

from tools.host.cluster import everywhere, run
from tools.host.jobs import reason
from tools.host.memory import allowed_memory

from .attempt import attempt
from .order import Note, Order, Outcome, Share
from .run import Pass
from .shots import Shot


def passes(order: Order, client: Any, threads: int | None, memory: int | None, note: Note) -> list[Pass]:
    """The passes over a list of shots by dask workers; on this machine alone `tools.rendering.run.passes` takes their place.

    order: settings of the run.
    client: of the dask scheduler.
    threads: number for each worker; None = as many as it was started with.
    memory: limit for each worker, bytes; None = most of its free memory.
    note: called with each different remark of the workers, and with each remark on them.

    Raises SchedulerGoneError when the scheduler ends.
    """
    order = replace(order, folder=order.folder.absolute())
    once = cache(note)  # several workers have the same to say: once is enough
    return [partial(_pass, client, partial(_work, order, threads, memory, last), note, once) for last in (False, True)]


def _pass(
    client: Any, work: Callable[[Shot], tuple[Outcome, list[str]]], note: Note, once: Note, shots: Sequence[Shot]
) -> Iterator[tuple[Shot, Outcome]]:
    here = {Shot(everywhere(shot.source), shot.output.absolute(), shot.found): shot for shot in shots}
    for there, result in run(client, work, list(here), note):
        shot = here[there]
        if isinstance(result, BaseException):
            yield shot, Outcome("failed", reason(result))
            continue
        outcome, notes = result
        for text in notes:
            once(text)
        if outcome.state == "made" and not shot.output.exists():
            outcome = Outcome("failed", f"{shot.output}: was made where this machine does not see it; -o must be a shared folder")
        yield shot, outcome


def _work(order: Order, threads: int | None, memory: int | None, last: bool, shot: Shot) -> tuple[Outcome, list[str]]:
    """On a worker: the outcome, and remarks for the user."""
    from distributed import get_worker

    from offline import available_threads, use_threads

    notes: list[str] = []
    use_threads(min(threads or get_worker().state.nthreads, available_threads()))  # counts for this thread alone
    return attempt(order, Share(allowed_memory(memory), last), shot, notes.append), notes
