"""The processes that do an evaluation's work, and what the user sees of it: progress, failures, the memory limit."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from shared.errors import InputError, PanchromaError
from tools.host import worker_pool
from tools.host.console import Console
from tools.host.countdown import Countdown
from tools.host.jobs import reason
from tools.host.memory import format_bytes
from tools.host.worker_pool import Note

from .scene_sets import Reading, SceneInfo
from .study import Task, work

T = TypeVar("T")
R = TypeVar("R")

_PROCESS_BYTES = 250 * 2**20  # with the libraries
_PIXEL_BYTES = 400  # in the hungriest method and its measurement; twice what was measured
_USUAL_PIXELS = 6_000_000  # of a scene that has not been read yet
_TENTHS = 10  # steps of a progress bar per unit of work
_REMEDY = "run again with a smaller -j or --max-memory; what was finished is kept"


def needed_memory(pixels: int) -> int:
    """Bytes that one process needs for a scene of `pixels` pixels, roughly."""
    return _PROCESS_BYTES + _PIXEL_BYTES * pixels


@dataclass(frozen=True)
class Team:
    """Does the work of an evaluation in several processes.

    console: shows progress, notes and failures.
    jobs: largest number of processes.
    memory: bytes for all of them together; it reduces their number.
    client: of a dask scheduler, whose workers then do the work instead.
    """

    console: Console
    jobs: int
    memory: int
    client: Any = None

    def processes(self, pixels: int) -> int:
        """How many processes fit into the memory when the largest scene has `pixels` pixels; at least 1."""
        return max(1, min(self.jobs, self.memory // needed_memory(pixels)))

    def read(self, sources: Sequence[str], reading: Reading) -> tuple[list[SceneInfo], list[str]]:
        """The scenes that can be read, in the given order, and a line for each source that cannot; it is shown to the user too."""
        scenes, failures = [], []
        for source, info in self._follow("reading scenes", reading.info, sources, _USUAL_PIXELS):
            if not isinstance(info, SceneInfo):
                failures.append(self._fail(source, info))
            elif (needed := needed_memory(info.rows * info.columns)) > self.memory:
                error = InputError(f"needs about {format_bytes(needed)} of memory; allow it with --max-memory, or use --crop")
                failures.append(self._fail(source, error))
            else:
                scenes.append(info)
        self.console.notes((scene.source, scene.notes) for scene in scenes)
        return scenes, failures

    def measure(self, todo: Sequence[Task]) -> list[str]:
        """Do the tasks, which keep their results. Returns a line for each result that failed; it is shown to the user too."""
        failures = []
        pixels = max((cell.scene.rows * cell.scene.columns for task in todo for cell in task.cells), default=0)
        for task, outcome in self._follow("measuring", work, todo, pixels, lambda task: task.seconds):
            if isinstance(outcome, BaseException):
                raise InputError(f"{task.title}: {outcome}") from outcome
            for line in outcome:
                self.console.error(line)
            failures += outcome
        return failures

    def together(self, title: str, each: Callable[[T], R], pieces: Sequence[T], pixels: int) -> list[R]:
        """Results of `each`, in the order of `pieces`. Raises InputError for the first that fails.

        title: names the work for the user.
        each: a function of a module, or a `partial` of one.
        pieces: hashable.
        pixels: of the largest scene that a piece needs.
        """
        results = []
        for _, result in self._follow(title, each, pieces, pixels):
            if isinstance(result, BaseException):
                raise InputError(f"{title}: {result}") from result
            results.append(result)
        return results

    def _follow(
        self, title: str, each: Callable[[T], R], pieces: Sequence[T], pixels: int, length: Callable[[T], float] = lambda _: 1.0
    ) -> "list[tuple[T, R | PanchromaError | MemoryError]]":
        """(piece, result or error) of each piece, in their order; `length` is a piece's share of the work."""
        if not pieces:
            return []
        ended = {}
        total = sum(map(length, pieces))
        countdown = Countdown(total, len(pieces))
        with self.console.progress("evaluate") as progress:
            progress.stage(title, round(_TENTHS * total))
            for piece, result in self._run(each, pieces, pixels):
                countdown.finished(length(piece))
                progress.advance(round(_TENTHS * length(piece)))
                progress.remark(str(countdown))
                ended[piece] = result
        return [(piece, ended[piece]) for piece in pieces]

    def _run(self, each: Callable[[T], R], pieces: Sequence[T], pixels: int) -> "Iterable[tuple[T, Any]]":
        if self.client is not None:
            from tools.host import cluster

            return cluster.run(self.client, each, pieces, self.console.note)
        silent, count = partial(_without_note, each), self.processes(pixels)
        return worker_pool.run(silent, pieces, count, note=self.console.note, remedy=_REMEDY)

    def _fail(self, source: str, error: PanchromaError | MemoryError) -> str:
        line = " ".join(f"{source}: {reason(error)}".split())
        self.console.error(line)
        self.console.record(source=source, ok=False, error=line)
        return line


def _without_note(each: Callable[[T], R], piece: T, note: Note) -> R:
    return each(piece)
