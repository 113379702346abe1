"""The processes that do an evaluation's work, and what the user sees of it: progress, failures, the
memory limit.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from ...shared.errors import InputError, PanchromaError
from ..batch.cluster import cluster
from ..batch.console import Console
from ..batch.jobs import output_folder, reason
from ..batch.memory import format_bytes
from ..batch.parallel import follow, one_by_one, possible_processes, processes
from ..batch.progress import StageProgress
from .scene_sets import Reading, SceneInfo, distinct, expand
from .study import FOLDER, Case, Study, work

T = TypeVar("T")
R = TypeVar("R")

_PROCESS_BYTES = 250 * 2**20  # with the libraries
_PIXEL_BYTES = 400  # in the hungriest method and its measurement; twice what was measured
_USUAL_PIXELS = 6_000_000  # of a scene that has not been read yet
_FAILURES = PanchromaError, MemoryError  # of one scene or result; any other exception is a fault
_REMEDY = "run again with fewer processes or a smaller `max_memory`; what was finished is kept"


def needed_memory(pixels: int) -> int:
    """Bytes that one process needs for a scene of `pixels` pixels, roughly."""
    return _PROCESS_BYTES + _PIXEL_BYTES * pixels


@dataclass(frozen=True)
class Team:
    """Does the work of an evaluation in several processes.

    Attributes
    ----------
    console : Console
        Shows progress, notes and failures.
    jobs : int
        Largest number of processes.
    memory : int
        Bytes for all of them together; it reduces their number.
    """

    console: Console
    jobs: int
    memory: int

    def read(
        self, sources: Sequence[str], output: Path, reading: Reading
    ) -> tuple[list[SceneInfo], list[str]]:
        """The scenes that can be read, each once, in the given order; a line for each source that
        cannot. The user is shown the lines, and what is left out, too.

        sources: files, and folders of them. output: a folder that is not searched. Raises
        InputError as `expand` does.
        """
        names, left_out = expand(sources, output)
        scenes, failures = [], list[str]()
        read: Callable[[str], SceneInfo | str] = reading.info
        results = self.together("reading scenes", read, names, _USUAL_PIXELS, failed=self._fail)
        for source, info in zip(names, results, strict=True):
            if isinstance(info, str):
                failures.append(info)
            elif (needed := needed_memory(info.rows * info.columns)) > self.memory:
                remedy = "allow it with `max_memory`, or use `crop`"
                error = InputError(f"needs about {format_bytes(needed)} of memory; {remedy}")
                failures.append(self._fail(source, error))
            else:
                scenes.append(info)
        self.console.notes((scene.source, scene.notes) for scene in scenes)
        scenes, remarks = distinct(scenes)
        self.console.note(*left_out, *remarks)
        if not scenes:
            expected = "a scene is a camera RAW, a picture, or builtin:WIDTHxHEIGHT"
            self.console.error(f"no scene could be read; {expected}")
        return scenes, failures

    def measure(
        self, study: Study, folder: Path, todo: Sequence[Case], scheduler: str | None = None
    ) -> list[str]:
        """Make and keep results.

        Returns a line for each that failed; it is shown to the user too. scheduler: address of a
        dask scheduler, whose workers do the work instead of processes here.
        """
        output_folder(str(folder / FOLDER))
        pixels = max((case.scene.rows * case.scene.columns for case in todo), default=0)
        measure = partial(work, replace(study, scenes=()), folder.absolute())
        results = self.together("measuring", measure, todo, pixels, scheduler)
        failures = list(dict.fromkeys(line for lines in results for line in lines))
        for line in failures:
            self.console.error(line)
            self.console.record(source=line.partition(": ")[0], ok=False, error=line)
        return failures

    def together(
        self,
        title: str,
        function: Callable[[T], R],
        items: Sequence[T],
        pixels: int,
        scheduler: str | None = None,
        failed: Callable[[T, Exception], R] | None = None,
    ) -> list[R]:
        """Results in the order of the items.

        Raises InputError for the first that fails, after all have ended.

        Parameters
        ----------
        title : str
            Names the work for the user.
        function : Callable[[T], R]
            Called for each item: of a module, or a `partial` of one.
        items : Sequence[T]
            Hashable.
        pixels : int
            Of the largest scene that an item needs.
        scheduler : str | None, optional
            See `measure`.
        failed : Callable[[T, Exception], R] | None, optional
            Called in the end for each item that failed, and its result. None = it is an error.
        """

        def refuse(_: T, error: Exception) -> R:
            raise InputError(f"{title}: {error}") from error

        if not items:
            return []
        ended, failed = dict[T, R | Exception](), failed or refuse
        fitting, note = max(1, self.memory // needed_memory(pixels)), self.console.note
        count = min(self.jobs, fitting, len(items))
        count = count if scheduler else possible_processes(count, note)
        call = partial(_call, function)
        with ExitStack() as stack:
            progress = stack.enter_context(self.console.progress("evaluate"))
            if scheduler is None and count == 1:
                results = one_by_one(call, items, lambda _: StageProgress(note=note))
            else:
                pool = cluster(scheduler, note) if scheduler else processes(count, _REMEDY)
                results = stack.enter_context(pool).run(call, items, note)
            for item, result in follow(results, items, progress, title):
                if isinstance(result, Exception) and not isinstance(result, _FAILURES):
                    raise result
                ended[item] = result
        ends = [(item, ended[item]) for item in items]
        return [failed(item, end) if isinstance(end, Exception) else end for item, end in ends]

    def _fail(self, source: str, error: Exception) -> str:
        line = " ".join(f"{source}: {reason(error)}".split())
        self.console.error(line)
        self.console.record(source=source, ok=False, error=line)
        return line


def _call(function: Callable[[T], R], item: T, listener: StageProgress) -> R:
    """Adapt `function(item)` to `function(item, listener)`."""
    return function(item)
