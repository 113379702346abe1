"""A list of shots and the processes that render them: what each may use, what is put off, what people and machines are told."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from shared.errors import PanchromaError
from tools.host import worker_pool
from tools.host.console import Console, StageProgress
from tools.host.countdown import Countdown
from tools.host.jobs import fail
from tools.host.memory import allowed_memory
from tools.host.processors import processors

from .attempt import attempt
from .order import Order, Outcome, Share
from .picture_file import needed_memory
from .shots import Shot

Pass = Callable[[Sequence[Shot]], Iterator[tuple[Shot, Outcome | None]]]
"""Attempts all shots; (shot, outcome) in the order they end, None when the shot has ended the process that had it."""

_MANY = 2  # shots per processor, from which on a process for each processor pays
_LARGEST = 3  # files that are looked into to know how much memory the largest shot needs


@dataclass(frozen=True)
class Hands:
    """Who works: processes, threads of each, and bytes of memory for all of them together."""

    workers: int
    threads: int
    memory: int

    @classmethod
    def of(cls, order: Order, shots: Sequence[Shot], workers: int | None, threads: int | None, memory: str | None) -> "Hands":
        """What is asked for; what is left open (None) as processors and memory bear it: one process for a few shots."""
        cores, allowed = processors(), allowed_memory(memory)
        if workers is None:
            workers = 1
            if len(shots) >= _MANY * cores:
                workers = max(1, min(cores // (threads or 1), allowed // _largest_need(order, shots)))
        workers = min(workers, max(1, len(shots)))
        return cls(workers, threads or max(1, cores // workers), allowed)


def _largest_need(order: Order, shots: Sequence[Shot]) -> int:
    """Bytes that the largest shot needs, roughly: of two files of one camera the larger has more pixels, or not much fewer."""
    for _, source in sorted(((_size(shot.source), shot.source) for shot in shots), reverse=True)[:_LARGEST]:
        try:
            return needed_memory(order.read(source), order.kind, order.settings)
        except (PanchromaError, MemoryError):
            continue
    return 1


def _size(source: str) -> int:
    try:
        return Path(source).stat().st_size
    except (OSError, ValueError):
        return 0


def passes(order: Order, hands: Hands, console: Console, count: int) -> list[Pass]:
    """How this machine goes through a list of so many: all at once, then one by one what was put off, with all the memory.

    The stages of a single one are shown.
    """

    def alone(last: bool, shots: Sequence[Shot]) -> Iterator[tuple[Shot, Outcome]]:
        for shot in shots:
            with console.progress(shot.source) if count == 1 else StageProgress() as progress:
                outcome = attempt(order, Share(hands.memory, last), shot, console.note, progress)
            yield shot, outcome

    def together(shots: Sequence[Shot]) -> Iterator[tuple[Shot, Outcome | None]]:
        work = partial(_attempt_unseen, order, Share(hands.memory // hands.workers))
        return worker_pool.run(work, shots, hands.workers, hands.threads, said_once(console.note))

    if hands.workers > 1:
        return [together, partial(alone, True)]
    return [partial(alone, True)] if count == 1 else [partial(alone, False), partial(alone, True)]


def _attempt_unseen(order: Order, share: Share, shot: Shot, note: Callable[[str], None]) -> Outcome:
    return attempt(order, share, shot, note, StageProgress())


def said_once(note: Callable[[str], None]) -> Callable[[str], None]:
    """Of what several processes say, each sentence once."""
    said: set[str] = set()

    def once(text: str) -> None:
        if text not in said:
            said.add(text)
            note(text)

    return once


def render_shots(shots: Sequence[Shot], through: Sequence[Pass], console: Console) -> bool:
    """Render them; a line and a record for each. Returns whether all went well.

    through: passes; each gets what the one before it has put off.
    """
    states: Counter[str] = Counter()
    countdown = Countdown(len(shots), len(shots))
    waiting = list(shots)
    with ExitStack() as stack:
        progress = StageProgress()
        if len(shots) > 1:
            progress = stack.enter_context(console.progress("render"))
            progress.stage("shots", len(shots))
        for attempt_all in through:
            put_off = []
            for shot, outcome in attempt_all(waiting):
                if outcome is not None and outcome.state == "postponed":
                    put_off.append(shot)
                    continue
                countdown.finished(1)
                progress.advance()
                progress.remark(str(countdown))
                states[_tell(shot, outcome, console)] += 1
            waiting = put_off
    if len(shots) > 1:
        console.note(", ".join(f"{states[state]} {_WORDS[state]}" for state in _WORDS if states[state]))
    return not states["failed"]


_WORDS = {"made": "made", "planned": "to be made", "current": "current", "foreign": "left alone", "failed": "failed"}
_LOST = (
    "the processes that rendered it were killed, most likely for want of memory: "
    "render it with --workers 1, or allow more with --max-memory"
)


def _tell(shot: Shot, outcome: Outcome | None, console: Console) -> str:
    """Say what has become of a shot; returns the state."""
    if outcome is None:
        outcome = Outcome("failed", _LOST)
    if outcome.state == "failed":
        fail(shot.source, (shot.output,), outcome.line, console)
    elif outcome.state == "foreign":
        console.note(outcome.line)
        console.record(source=shot.source, ok=True, foreign=True)
    else:
        console.say(outcome.line)
        console.record(source=shot.source, ok=True, **outcome.facts)
    return outcome.state
