"""The work of an evaluation: every scene at every noise level by every method, each result kept as soon as it is there."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from shared.arrays import FloatArray
from shared.errors import PanchromaError

from .cache import FOLDER, Cache, key
from .measures import Measures
from .methods import DENOISING_SECONDS, Method, choose, denoise, render_bayer, render_sparse
from .protocol import Protocol
from .scene_sets import Reading, SceneInfo

_MEASURING = 0.3  # seconds per megapixel, roughly


@dataclass(frozen=True)
class Cell:
    """One result: a scene at a level by a method; period: of a method of ours, 0 for a rival. name: in the cache."""

    scene: SceneInfo
    level: float
    method: str
    period: int
    name: str


@dataclass(frozen=True)
class Study:
    """What is compared. levels: in order of rising noise; periods: of our sensor; the first is the one that meets the rivals."""

    scenes: tuple[SceneInfo, ...]
    methods: tuple[str, ...]
    levels: tuple[float, ...]
    periods: tuple[int, ...]
    protocol: Protocol
    reading: Reading

    @property
    def period(self) -> int:
        """The period at which our methods meet the rivals: the paper's, where it is among them."""
        return 6 if 6 in self.periods else self.periods[0]

    def cells(self) -> Iterator[Cell]:
        """Every result, in the order of the report."""
        for scene in self.scenes:
            for level in self.levels:
                for method in choose(list(self.methods)):
                    for period in self.periods if method.ours else (0,):
                        yield self.cell(scene, level, method, period)

    def cell(self, scene: SceneInfo, level: float, method: Method, period: int) -> Cell:
        """One result, with its name in the cache."""
        name = key(
            scene=scene.digest,
            neutral=scene.neutral if method.balanced else None,
            protocol=self.protocol.kind,
            seed=self.protocol.seed if level or self.protocol.kind == "sensor" else 0,
            level=level,
            period=period,
            method=method.identity(),
        )
        return Cell(scene, level, method.name, period, name)


@dataclass(frozen=True)
class Task:
    """Results that one process makes one after the other, for they share their preparation."""

    cells: tuple[Cell, ...]
    protocol: Protocol
    reading: Reading
    folder: Path

    @property
    def seconds(self) -> float:
        """How long it takes, roughly: for the time left, not for a promise."""
        each = sum(_method(cell).seconds + _MEASURING for cell in self.cells)
        again = max(0, sum(_method(cell).denoised for cell in self.cells) - 1)  # what is denoised is kept for the next method
        return (each - again * DENOISING_SECONDS) * self.cells[0].scene.megapixels

    @property
    def title(self) -> str:
        """For people."""
        first = self.cells[0]
        names = " ".join(dict.fromkeys(cell.method + (f" K={cell.period}" if cell.period else "") for cell in self.cells))
        return f"{first.scene.name}, {self.protocol.describe(first.level)}: {names}"


def tasks(study: Study, folder: Path) -> tuple[list[Task], int]:
    """What is still to be done, and how many results are there already. Equal results are made once."""
    cache = Cache(folder / FOLDER)
    todo: dict[tuple[str, float, str], list[Cell]] = {}
    there = 0
    seen: set[str] = set()
    for cell in study.cells():
        if cell.name in seen:
            continue
        seen.add(cell.name)
        if cache.has(cell.name) and cache.get(cell.name) is not None:
            there += 1
            continue
        shared = "bm3d" if _method(cell).denoised else cell.name
        todo.setdefault((cell.scene.digest, cell.level, shared), []).append(cell)
    return [Task(tuple(cells), study.protocol, study.reading, folder) for cells in todo.values()], there


@dataclass(frozen=True)
class Outcome:
    """Of a task: what went wrong with single results, by their names."""

    task: Task
    failures: tuple[tuple[str, str], ...] = ()


def work(task: Task) -> Outcome:
    """Make the results of a task and keep them. Raises OutputError when they cannot be kept."""
    cache = Cache(task.folder / FOLDER)
    failures = []
    for cell in task.cells:
        try:
            picture = render_cell(cell, task.protocol, task.reading)
            measures = Measures.of(picture, task.reading.truth(cell.scene.source))
        except PanchromaError as error:
            failures.append((cell.name, f"{cell.scene.source}: {cell.method}, {task.protocol.describe(cell.level)}: {error}"))
            continue
        except MemoryError:
            failures.append((cell.name, f"{cell.scene.source}: {cell.method}: not enough memory for a picture of this size"))
            continue
        cache.put(cell.name, measures)
    return Outcome(task, tuple(failures))


def render_cell(cell: Cell, protocol: Protocol, reading: Reading) -> FloatArray:
    """The picture behind a result: float32 (H, W, 3), scene units."""
    method = _method(cell)
    truth = reading.truth(cell.scene.source)
    if method.ours:
        return render_sparse(method, protocol.sparse_shot(truth, cell.level, cell.period), protocol.gain(cell.level))
    denoised = _denoised(cell.scene.source, cell.level, protocol, reading) if method.denoised else None
    return render_bayer(method, protocol.bayer_shot(truth, cell.level), cell.scene.neutral, denoised)


@lru_cache(maxsize=1)  # by far the longest part of the methods that share it
def _denoised(source: str, level: float, protocol: Protocol, reading: Reading) -> FloatArray:
    return denoise(protocol.bayer_shot(reading.truth(source), level))


def collect(study: Study, folder: Path) -> dict[Cell, Measures]:
    """All results that are there, in the order of the report."""
    cache = Cache(folder / FOLDER)
    known: dict[str, Measures] = {}
    results = {}
    for cell in study.cells():
        measures = known.get(cell.name) or cache.get(cell.name)
        if measures is not None:
            known[cell.name] = measures
            results[cell] = measures
    return results


def _method(cell: Cell) -> Method:
    return choose([cell.method])[0]
