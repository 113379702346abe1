"""The work of an evaluation: every scene at every noise level by every method, each result kept as
soon as it is made.

Results are files under a digest of all they depend on, so that an interrupted run goes on where it
stopped.

Several processes may do it; the user sees progress, failures and the memory limit.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import NamedTuple, TypeVar

from ...shared.errors import InputError, OutputError, PanchromaError
from ...shared.source import code_digest
from ...shared.writing import own_file, write_durably
from ..batch.console import Console
from ..batch.jobs import output_folder, reason
from ..batch.journal import key
from ..batch.memory import format_bytes
from ..batch.parallel import follow, in_processes, one_by_one, possible_processes
from ..batch.progress import StageProgress
from ..simulation.protocols import Protocol
from .cameras import CameraPair, Method, Tile
from .methods import Sources, find_method
from .metrics import Measures
from .scene_sets import Reading, SceneInfo, distinct, expand

FOLDER = "results"
SEED = 0  # of the noise, the same for every scene


class Case(NamedTuple):
    """One result: a scene at one noise level, by one method.

    Parameters
    ----------
    scene, level
        The scene and the noise.
    method
        Name of the method.
    tile
        Pattern of the sparse-colour camera; None for a Bayer camera's method.
    name
        Name of the result's file.
    """

    scene: SceneInfo
    level: Protocol
    method: str
    tile: Tile | None
    name: str

    @property
    def title(self) -> str:
        """Name for people."""
        pattern = f" {self.tile.name}" if self.tile else ""
        return f"{self.scene.name}, {self.level.text}: {self.method}{pattern}"


@dataclass(frozen=True)
class Study:
    """The scenes, methods, noise levels and patterns that are compared.

    Parameters
    ----------
    scenes
        Scenes under different names.
    methods
        Names of the methods.
    levels
        Noise levels in rising order.
    tiles
        Patterns of the sparse-colour camera, under different names.
    reading
        How scenes are read.
    sources
        Those of the networks and functions among the methods.
    """

    scenes: tuple[SceneInfo, ...]
    methods: tuple[str, ...]
    levels: tuple[Protocol, ...]
    tiles: tuple[Tile, ...]
    reading: Reading
    sources: Sources = ()

    @property
    def tile(self) -> Tile:
        """The pattern at which our methods are compared with the rivals: the paper's K = 6, if it
        is among them.
        """
        return next((tile for tile in self.tiles if tile.period == 6), self.tiles[0])

    @property
    def ours(self) -> str | None:
        """The method that represents us: the best renderer in the study."""
        ranked = ("best", "unlearned", "paper", "preview")
        return next((name for name in ranked if name in self.methods), None)

    @property
    def rivals(self) -> list[str]:
        """Methods of the Bayer sensor."""
        return [name for name in self.methods if not self.method(name).ours]

    def method(self, name: str) -> Method:
        """Return one of the methods."""
        return find_method(name, self.sources)

    def cases(self) -> Iterator[Case]:
        """Yield every result, in the order of the report."""
        for scene in self.scenes:
            for level in self.levels:
                for method in map(self.method, self.methods):
                    for tile in self.tiles if method.ours else (None,):
                        yield name_case(scene, level, method, tile)


@cache
def source_digest() -> str:
    """Digest of the modules and networks of this installation."""
    modules = (f"{package}/**/*.py" for package in ("shared", "device", "offline", "tools"))
    return code_digest(Path(__file__).parents[2], *modules, "offline/models/*.onnx")


def name_case(scene: SceneInfo, level: Protocol, method: Method, tile: Tile | None) -> Case:
    """Return a result with the name of its file: a digest of all it depends on, the source of
    Panchroma and its networks included.

    tile: None for a Bayer camera's method.
    """
    facts = {
        "source": source_digest(),
        "protocol": level.name,
        "level": level.level,
        "pattern": asdict(tile.pattern) if tile else None,
        "scene": scene.digest,
        "neutral": scene.neutral if method.balanced else None,
    }
    name = f"{key(**facts, **method.identity)[:32]}.npz"
    return Case(scene, level, method.name, tile, name)


def missing_cases(study: Study, folder: Path, *, anew: bool = False) -> tuple[list[Case], int]:
    """Return the results that are still to be made, equal ones once, and the number of those that
    are there already.

    Parameters
    ----------
    study
        The study.
    folder
        Folder of the evaluation.
    anew
        Make all results, whatever is there.
    """
    distinct = {case.name: case for case in study.cases()}
    missing = [case for case in distinct.values() if anew or _kept(folder, case) is None]
    return missing, len(distinct) - len(missing)


def remove_results(study: Study, folder: Path) -> None:
    """Remove the results of a study, where there are any.

    Raises OutputError.
    """
    for case in study.cases():
        path = folder / FOLDER / case.name
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: cannot be removed ({error.strerror or error})") from None


def work(study: Study, folder: Path, case: Case) -> list[str]:
    """Make and keep a result, in any process.

    Returns a line if it failed, or if a file is no longer what the result is named after; otherwise
    empty. Raises OutputError: the result cannot be kept.

    Parameters
    ----------
    study
        The study; its scenes are not used.
    folder
        Folder of the evaluation.
    case
        The result.
    """
    place = ""
    try:
        method = study.method(case.method)
        if name_case(case.scene, case.level, method, case.tile) != case:
            reason = "the source of Panchroma has changed since the evaluation began"
            raise InputError(f"{case.method}: {reason}; run it again with `resume=True`")
        truth = study.reading.scene(case.scene).rgb
        place = f"{case.scene.source}: {case.method}, {case.level.text}: "
        cameras = _cameras(case.scene, case.level, case.tile or study.tile, study.reading)
        measures = Measures.of(method.render(cameras), truth, study.reading.channels)
    except PanchromaError as error:
        return [f"{place}{error}"]
    except MemoryError:
        return [f"{case.scene.source}: {case.method}: not enough memory for a picture of this size"]
    write_durably(folder / FOLDER / case.name, measures.encode(), overwrite=True)
    return []


def collect(study: Study, folder: Path) -> dict[Case, Measures]:
    """Return all results that are there, in the order of the report."""
    return {case: kept for case in study.cases() if (kept := _kept(folder, case)) is not None}


def _kept(folder: Path, case: Case) -> Measures | None:
    """The result of an earlier run; None when there is none, or its file is damaged."""
    try:
        with own_file(folder / FOLDER / case.name, "rb") as file:
            return Measures.decode(file.read())
    except Exception:  # see `Measures.decode`
        return None


@lru_cache(maxsize=1)  # methods that come one after the other share their shots
def _cameras(scene: SceneInfo, level: Protocol, tile: Tile, reading: Reading) -> CameraPair:
    return CameraPair(level, SEED, reading.scene(scene).rgb, tile.pattern, scene.neutral)


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
        infos = self.attempt("reading scenes", reading.info, names, _USUAL_PIXELS)
        for source, info in zip(names, infos, strict=True):
            if isinstance(info, Exception):
                fault = reason(info)
            elif (needed := needed_memory(info.rows * info.columns)) > self.memory:
                remedy = "allow it with `max_memory`, or use `crop`"
                fault = f"needs about {format_bytes(needed)} of memory; {remedy}"
            else:
                scenes.append(info)
                continue
            failures.append(" ".join(f"{source}: {fault}".split()))
            self._report(source, failures[-1])
        self.console.notes((scene.source, scene.notes) for scene in scenes)
        scenes, remarks = distinct(scenes)
        self.console.note(*left_out, *remarks)
        if not scenes:
            self.console.error("no scene could be read; the lines above say why")
        return scenes, failures

    def measure(self, study: Study, folder: Path, todo: Sequence[Case]) -> list[str]:
        """Make and keep results.

        Returns a line for each that failed; it is shown to the user too.
        """
        output_folder(str(folder / FOLDER))
        pixels = max((case.scene.rows * case.scene.columns for case in todo), default=0)
        measure = partial(work, replace(study, scenes=()), folder)
        results = self.together("measuring", measure, todo, pixels)
        failures = list(dict.fromkeys(line for lines in results for line in lines))
        for line in failures:
            self._report(line.partition(": ")[0], line)
        return failures

    def together(
        self, title: str, function: Callable[[T], R], items: Sequence[T], pixels: int
    ) -> list[R]:
        """Results in the order of the items: see `attempt`.

        Raises InputError for the first that fails, after all have ended.
        """
        results = []
        for result in self.attempt(title, function, items, pixels):
            if isinstance(result, Exception):
                raise InputError(f"{title}: {result}") from result
            results.append(result)
        return results

    def attempt(
        self, title: str, function: Callable[[T], R], items: Sequence[T], pixels: int
    ) -> list[R | Exception]:
        """Results, or the exceptions of items that failed, in the order of the items.

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
        """
        if not items:
            return []
        ended = dict[T, R | Exception]()
        fitting, note = max(1, self.memory // needed_memory(pixels)), self.console.note
        count = possible_processes(min(self.jobs, fitting, len(items)), note)
        call = partial(_call, function)
        with ExitStack() as stack:
            progress = stack.enter_context(self.console.progress("evaluate"))
            if count == 1:
                results = one_by_one(call, items, lambda _: StageProgress(note=note))
            else:
                pool = in_processes(call, items, count, note, _REMEDY)
                results = stack.enter_context(pool)
            for item, result in follow(results, items, progress, title):
                if isinstance(result, Exception) and not isinstance(result, _FAILURES):
                    raise result
                ended[item] = result
        return [ended[item] for item in items]

    def _report(self, source: str, line: str) -> None:
        self.console.error(line)
        self.console.record(source=source, ok=False, error=line)


def _call(function: Callable[[T], R], item: T, listener: StageProgress) -> R:
    """Adapt `function(item)` to `function(item, listener)`."""
    return function(item)
