"""Rendering on the workers of a dask scheduler, on any number of machines that see the same folders.

A worker that is lost costs nothing but time: the scheduler gives what it had to another, whose lock and journal tell it what is
made already. Workers render one shot at a time, with their threads: start one process per core, `dask worker --nthreads 1`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from shared.errors import InputError
from tools.host.cluster import ALONE, everywhere, run
from tools.host.console import StageProgress, fault
from tools.host.memory import allowed_memory

from .attempt import attempt
from .order import Note, Order, Outcome, Share
from .run import Pass, said_once
from .shots import Shot


def passes(order: Order, client: Any, threads: int | None, memory: str | None, note: Note) -> list[Pass]:
    """How the workers go through a list. memory: of each worker; threads: of each, by default those it was started with."""
    everywhere = replace(order, folder=order.folder.absolute())
    once = said_once(note)
    return [partial(_through, client, partial(_work, everywhere, threads, memory, last), once) for last in (False, True)]


def _through(
    client: Any, work: Callable[[Shot], tuple[Outcome, list[str]]], note: Note, shots: Sequence[Shot]
) -> Iterator[tuple[Shot, Outcome]]:
    given = {_everywhere(shot): shot for shot in shots}
    for there, result in run(client, work, list(given)):
        shot = given[there]
        if isinstance(result, BaseException):
            yield shot, Outcome("failed", str(result) if isinstance(result, InputError) else fault(result))
            continue
        outcome, notes = result
        for text in notes:
            note(text)
        if outcome.state == "made" and not shot.output.exists():
            outcome = Outcome("failed", f"{shot.output}: was made where this machine does not see it; -o must be a shared folder")
        yield shot, outcome


def _everywhere(shot: Shot) -> Shot:
    return Shot(everywhere(shot.source), shot.output.absolute(), shot.found)


def _work(order: Order, threads: int | None, memory: str | None, last: bool, shot: Shot) -> tuple[Outcome, list[str]]:
    """In a worker."""
    from distributed import get_worker

    from offline import available_threads, use_threads

    notes: list[str] = []
    with ALONE:
        use_threads(min(threads or get_worker().state.nthreads, available_threads()))  # of this thread of the worker
        outcome = attempt(order, Share(allowed_memory(memory), last), shot, notes.append, StageProgress())
    return outcome, notes
