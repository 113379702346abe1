"""Workers and the person who waits for them: progress, failures, the limit of memory."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from shared.errors import InputError, PanchromaError
from tools.host.console import Console
from tools.host.countdown import Countdown
from tools.host.workers import need, processes, run

from .scene_sets import Reading, SceneInfo
from .study import Task, work

T = TypeVar("T")
R = TypeVar("R")

_TENTHS = 10  # steps of a bar per unit of work


@dataclass(frozen=True)
class Team:
    """At most `jobs` processes, which together use `memory` bytes; the workers of a dask `client`, if given, measure."""

    console: Console
    jobs: int
    memory: int
    client: Any = None

    def read(self, sources: Sequence[str], reading: Reading) -> tuple[list[SceneInfo], list[str]]:
        """The scenes that can be read, in the order given; and a line for each that cannot, which the person has seen."""
        found: dict[str, SceneInfo] = {}
        failures = []
        # Sizes are not known yet: as many at a time as there is memory for what a camera makes.
        count = max(1, processes(self.jobs, self.memory, _USUAL_PIXELS))
        for source, info in self._follow("reading scenes", partial(_read, reading), sources, lambda _: 1.0, count):
            if not isinstance(info, SceneInfo):
                failures.append(self._fail(source, info))
            elif (needed := need(info.rows * info.columns)) > self.memory:
                failures.append(self._fail(source, _too_large(needed)))
            else:
                found[source] = info
        scenes = [found[source] for source in sources if source in found]
        self._notes(scenes)
        return scenes, failures

    def measure(self, todo: Sequence[Task]) -> list[str]:
        """Do the work, results into the cache; a line for each result that could not be made, which the person has seen."""
        failures = []
        pixels = max((cell.scene.rows * cell.scene.columns for task in todo for cell in task.cells), default=0)
        count = max(1, processes(self.jobs, self.memory, pixels))
        by: Callable[..., Any] = run
        if self.client is not None:
            from tools.host.cluster import run_quietly

            by = partial(run_quietly, self.client)
        for task, outcome in self._follow("measuring", work, todo, lambda task: task.seconds, count, by):
            if isinstance(outcome, BaseException):
                raise InputError(f"{task.title}: {outcome}") from outcome
            for _, line in outcome.failures:
                self.console.error(line)
                failures.append(line)
        return failures

    def together(self, title: str, each: Callable[[T], R], pieces: Sequence[T], pixels: int) -> list[R]:
        """Results of `each`, in the order of the pieces, on scenes of at most so many pixels. Raises the first error."""
        results: dict[int, R] = {}
        numbered = list(enumerate(pieces))
        count = max(1, processes(self.jobs, self.memory, pixels))
        for (index, _), result in self._follow(title, partial(_second, each), numbered, lambda _: 1.0, count):
            if isinstance(result, PanchromaError | MemoryError):
                raise InputError(f"{title}: {result}") from result
            results[index] = result
        return [results[index] for index in range(len(pieces))]

    def _follow(
        self,
        title: str,
        each: Callable[[T], R],
        pieces: Sequence[T],
        length: Callable[[T], float],
        count: int,
        by: Callable[[Callable[[T], R], Sequence[T], int], Iterable[tuple[T, R | PanchromaError | MemoryError]]] = run,
    ) -> "list[tuple[T, R | PanchromaError | MemoryError]]":
        if not pieces:
            return []
        ended = []
        countdown = Countdown(sum(map(length, pieces)), len(pieces))
        with self.console.progress("evaluate") as progress:
            progress.stage(title, round(_TENTHS * sum(map(length, pieces))))
            for piece, result in by(each, pieces, count):
                countdown.finished(length(piece))
                progress.advance(round(_TENTHS * length(piece)))
                progress.remark(str(countdown))
                ended.append((piece, result))
        return ended

    def _notes(self, scenes: Sequence[SceneInfo]) -> None:
        """What is to be known of the scenes, each note once."""
        noted: dict[str, list[str]] = {}
        for scene in scenes:
            for note in scene.notes:
                noted.setdefault(note, []).append(scene.source)
        for note, (first, *more) in noted.items():
            self.console.note(f"{first}{f' and {len(more)} more' if more else ''}: {note}")

    def _fail(self, source: str, error: object) -> str:
        said = "not enough memory for a picture of this size" if isinstance(error, MemoryError) else str(error)
        line = " ".join(f"{source}: {said}".split())
        self.console.error(line)
        self.console.record(source=source, ok=False, error=line)
        return line


_USUAL_PIXELS = 6_000_000


def _too_large(needed: int) -> InputError:
    return InputError(f"needs about {needed / 2**30:.1f} GB of memory; allow them with --max-memory, or use --crop")


def _read(reading: Reading, source: str) -> SceneInfo:
    return reading.info(source)


def _second(each: Callable[[T], R], numbered: tuple[int, T]) -> R:
    return each(numbered[1])
