"""Render a list of shots: how many processes, how much memory for each, which shots are postponed, what the user is told."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, partial

from shared.errors import PanchromaError
from tools.host import worker_pool
from tools.host.console import Console
from tools.host.countdown import Countdown
from tools.host.jobs import fail, file_status, identity, refuse_existing, refuse_loss
from tools.host.memory import allowed_memory
from tools.host.processors import processors
from tools.host.progress import StageProgress
from tools.host.signals import raise_lost_signal
from tools.rendering.compilation import compile_ahead

from .attempt import attempt
from .order import Order, Outcome, Share
from .picture_file import needed_memory
from .shots import Shard, Shot

Pass = Callable[[Sequence[Shot]], Iterator[tuple[Shot, Outcome]]]
"""Attempts all shots and yields (shot, outcome) in the order in which they end."""

_MANY = 2  # shots per processor from which on one process per processor pays
_LARGEST = 3  # files that are read to learn how much memory the largest shot needs
_REMEDY = "render it with `workers=1`, or allow more with `max_memory`"
_WORDS = {"made": "made", "planned": "to be made", "current": "up to date", "foreign": "left alone", "failed": "failed"}


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
    def of(cls, order: Order, shots: Sequence[Shot], workers: int | None, threads: int | None, memory: int | None) -> "Resources":
        """What the user asks for. What is left open (None) is chosen by processors and memory: one process for a few shots."""
        cores, allowed = processors(), allowed_memory(memory)
        if workers is None:
            workers = 1
            if len(shots) >= _MANY * cores:
                workers = max(1, min(cores // (threads or 1), allowed // _largest_need(order, shots)))
        workers = min(workers, max(1, len(shots)))
        return cls(workers, threads or max(1, cores // workers), allowed)


def _largest_need(order: Order, shots: Sequence[Shot]) -> int:
    """Bytes that the largest shot needs, roughly. The largest files are read: they have the most pixels, or nearly."""
    for _, source in sorted(((_size(shot.source), shot.source) for shot in shots), reverse=True)[:_LARGEST]:
        try:
            return needed_memory(order.read(source), order.kind, order.settings)
        except (PanchromaError, MemoryError):
            continue
    return 1


def _size(source: str) -> int:
    status = file_status(source)
    return status.st_size if status else 0


def passes(order: Order, resources: Resources, console: Console, count: int) -> list[Pass]:
    """The passes of this machine over `count` shots. The last one renders postponed shots one by one, each with all the memory.

    If there is only one shot, the console shows its stages.
    """

    def one_by_one(last: bool, shots: Sequence[Shot]) -> Iterator[tuple[Shot, Outcome]]:
        for shot in shots:
            raise_lost_signal()
            with console.progress(shot.source) if count == 1 else StageProgress() as progress:
                outcome = attempt(order, Share(resources.memory, last, resources.threads), shot, console.note, progress)
            yield shot, outcome

    def by_workers(shots: Sequence[Shot]) -> Iterator[tuple[Shot, Outcome]]:
        work = partial(attempt, order, Share(resources.memory // resources.workers))
        note, threads = cache(console.note), resources.threads  # several processes have the same to say: once is enough
        if shots:
            compile_ahead([order.settings], resources.workers, note, StageProgress())
        for shot, result in worker_pool.run(work, shots, resources.workers, note=note, remedy=_REMEDY, threads=threads):
            yield shot, result if isinstance(result, Outcome) else Outcome("failed", str(result))

    if resources.workers > 1:
        return [by_workers, partial(one_by_one, True)]
    return [partial(one_by_one, True)] if count == 1 else [partial(one_by_one, False), partial(one_by_one, True)]


def possible_shots(found: Sequence[Shot], shard: Shard, order: Order, console: Console) -> tuple[list[Shot], bool]:
    """The shots of the shard whose pictures would replace nothing that must stay, and whether that is all of them.

    Each other one is reported as failed. Of two shots with the same output the first gets it, whichever shards they belong to.
    """
    inputs = {identity(name) for shot in found for name in shot.files} - {None}
    planned: dict[str, str] = {}
    possible, all_well = [], True
    for shot in found:
        try:
            refuse_loss(shot.source, shot.outputs, inputs, planned)
            if not shard.has(order.name(shot.output)):
                continue
            if not (order.overwrite or order.resume):
                refuse_existing(shot.outputs)
        except PanchromaError as error:
            all_well = False
            fail(shot.source, shot.outputs, str(error), console)
        else:
            possible.append(shot)
    return possible, all_well


def render_shots(shots: Sequence[Shot], through: Sequence[Pass], console: Console) -> bool:
    """Render shots, with a line and a record for each. Returns whether none has failed.

    through: the passes; each gets what the one before it postponed.
    """
    states: Counter[str] = Counter()
    all_well = True
    countdown = Countdown(len(shots), len(shots))
    waiting = list(shots)
    with ExitStack() as stack:
        progress = StageProgress()
        if len(shots) > 1:
            progress = stack.enter_context(console.progress("render"))
            progress.stage("shots", len(shots))
        for attempt_all in through:
            postponed = []
            for shot, outcome in attempt_all(waiting):
                if outcome.state == "postponed":
                    postponed.append(shot)
                    continue
                countdown.finished(1)
                progress.advance()
                progress.remark(str(countdown))
                states[outcome.state] += 1
                all_well = all_well and outcome.state != "failed" and not outcome.errors
                _report(shot, outcome, console)
            waiting = postponed
    if len(shots) > 1:
        console.note(", ".join(f"{states[state]} {_WORDS[state]}" for state in _WORDS if states[state]))
    return all_well


def _report(shot: Shot, outcome: Outcome, console: Console) -> None:
    if outcome.state == "failed":
        fail(shot.source, (*shot.files, *shot.outputs), outcome.line, console)
    elif outcome.state == "foreign":
        console.note(outcome.line)
        console.record(source=shot.source, ok=True, foreign=True)
    else:
        for line in outcome.errors:
            console.error(line)
        console.say(outcome.line)
        console.record(source=shot.source, ok=True, **outcome.facts)
