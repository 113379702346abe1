"""The processes that do an evaluation's work, and what the user sees of it: progress, failures, the memory limit."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from ...shared.errors import InputError, PanchromaError
from ..batch.cluster import cluster
from ..batch.console import Console
from ..batch.jobs import reason
from ..batch.memory import format_bytes
from ..batch.parallel import follow, one_by_one, processes
from ..batch.progress import StageProgress
from .scene_sets import Reading, SceneInfo, distinct, expand
from .study import Cell, Study, work

T = TypeVar("T")
R = TypeVar("R")

_PROCESS_BYTES = 250 * 2**20  # with the libraries
_PIXEL_BYTES = 400  # in the hungriest method and its measurement; twice what was measured
_USUAL_PIXELS = 6_000_000  # of a scene that has not been read yet
_REMEDY = "run again with fewer processes or a smaller `max_memory`; what was finished is kept"


def needed_memory(pixels: int) -> int:
    """Bytes that one process needs for a scene of `pixels` pixels, roughly."""
    return _PROCESS_BYTES + _PIXEL_BYTES * pixels


@dataclass(frozen=True)
class Team:
    """Does the work of an evaluation in several processes.

    console: shows progress, notes and failures.
    jobs: largest number of processes.
    memory: bytes for all of them together; it reduces their number.
    scheduler: address of a dask scheduler, whose workers then do the work instead.
    """

    console: Console
    jobs: int
    memory: int
    scheduler: str | None = None

    def processes(self, pixels: int) -> int:
        """How many processes fit into the memory when the largest scene has `pixels` pixels; at least 1."""
        return max(1, min(self.jobs, self.memory // needed_memory(pixels)))

    def read(self, sources: Sequence[str], output: Path, reading: Reading) -> tuple[list[SceneInfo], list[str], list[str]]:
        """The scenes that can be read, each once, in the given order; a line for each source that cannot, and one for each that is
        left out. The user is shown the lines, too.

        sources: files, and folders of them.
        output: a folder that is not searched.
        Raises InputError as `expand` does, and where no scene can be read.
        """
        names, left_out = expand(sources, output)
        scenes, failures = [], []
        for source, info in self._follow("reading scenes", reading.info, names, _USUAL_PIXELS):
            if not isinstance(info, SceneInfo):
                failures.append(self._fail(source, info))
            elif (needed := needed_memory(info.rows * info.columns)) > self.memory:
                error = InputError(f"needs about {format_bytes(needed)} of memory; allow it with `max_memory`, or use `crop`")
                failures.append(self._fail(source, error))
            else:
                scenes.append(info)
        self.console.notes((scene.source, scene.notes) for scene in scenes)
        scenes, remarks = distinct(scenes)
        left_out += remarks
        for remark in left_out:
            self.console.note(remark)
        if not scenes:
            raise InputError("no scene could be read; a scene is a camera RAW, a picture, or builtin:WIDTHxHEIGHT")
        return scenes, failures, left_out

    def measure(self, study: Study, folder: Path, todo: Sequence[Cell]) -> list[str]:
        """Make and keep results. Returns a line for each that failed; it is shown to the user too."""
        pixels = max((cell.scene.rows * cell.scene.columns for cell in todo), default=0)
        found = self.together("measuring", partial(work, replace(study, scenes=()), folder.absolute()), todo, pixels, study.seconds)
        failures = list(dict.fromkeys(line for lines in found for line in lines))
        for line in failures:
            self.console.error(line)
        return failures

    def together(
        self, title: str, each: Callable[[T], R], pieces: Sequence[T], pixels: int, length: Callable[[T], float] = lambda _: 1.0
    ) -> list[R]:
        """Results of `each`, in the order of `pieces`. Raises InputError for the first that fails.

        title: names the work for the user.
        each: a function of a module, or a `partial` of one.
        pieces: hashable.
        pixels: of the largest scene that a piece needs.
        length: share of a piece in the work.
        """
        results = []
        for _, result in self._follow(title, each, pieces, pixels, length):
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
        ended: dict[T, R | PanchromaError | MemoryError] = {}
        count, call = min(self.processes(pixels), len(pieces)), partial(_alone, each)
        with ExitStack() as stack:
            progress = stack.enter_context(self.console.progress("evaluate"))
            if self.scheduler is not None:
                results = stack.enter_context(cluster(self.scheduler, self.console.note)).run(call, pieces, self.console.note)
            elif count > 1:
                results = stack.enter_context(processes(count, _REMEDY)).run(call, pieces, self.console.note)
            else:
                results = one_by_one(call, pieces, lambda _: StageProgress(note=self.console.note))
            for piece, result in follow(results, pieces, progress, title, length):
                if isinstance(result, Exception) and not isinstance(result, PanchromaError | MemoryError):
                    raise result
                ended[piece] = result
        return [(piece, ended[piece]) for piece in pieces]

    def _fail(self, source: str, error: PanchromaError | MemoryError) -> str:
        line = " ".join(f"{source}: {reason(error)}".split())
        self.console.error(line)
        self.console.record(source=source, ok=False, error=line)
        return line


def _alone(each: Callable[[T], R], piece: T, listener: StageProgress) -> R:
    """A function of a piece, as work that has nothing to say."""
    return each(piece)
