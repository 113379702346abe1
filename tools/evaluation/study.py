"""The work of an evaluation: every scene at every noise level by every method, each result kept as soon as it is made."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from shared.arrays import FloatArray
from shared.errors import PanchromaError

from .cache import FOLDER, Cache, key
from .cameras import CameraPair
from .measures import Measures
from .methods import DENOISING_SECONDS, Method, choose, methods
from .protocol import Protocol
from .scene_sets import Reading, SceneInfo

_MEASURING = 0.3  # seconds per megapixel, roughly


@dataclass(frozen=True)
class Cell:
    """One result: a scene at one noise level, by one method.

    scene: the scene.
    level: noise level, as in `Protocol`.
    method: its name.
    period: of the sparse-colour pattern; 0 for a rival.
    name: of the result in the cache.
    """

    scene: SceneInfo
    level: float
    method: str
    period: int
    name: str


@dataclass(frozen=True)
class Study:
    """What is compared.

    scenes: all under different names.
    methods: names.
    levels: in order of rising noise.
    periods: of the sparse-colour pattern, rising.
    protocol, reading: how scenes are photographed and read.
    """

    scenes: tuple[SceneInfo, ...]
    methods: tuple[str, ...]
    levels: tuple[float, ...]
    periods: tuple[int, ...]
    protocol: Protocol
    reading: Reading

    @property
    def period(self) -> int:
        """The period at which our methods are compared with the rivals: the paper's, if it is among them."""
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
    """Results that one process makes one after the other, because they share their preparation."""

    cells: tuple[Cell, ...]
    protocol: Protocol
    reading: Reading
    folder: Path

    @property
    def seconds(self) -> float:
        """Rough duration, for the time left."""
        chosen = [methods()[cell.method] for cell in self.cells]
        once = max(0, sum(method.denoise is not None for method in chosen) - 1)  # denoised samples are kept for the next method
        each = sum(method.seconds + _MEASURING for method in chosen)
        return (each - once * DENOISING_SECONDS) * self.cells[0].scene.megapixels

    @property
    def title(self) -> str:
        """Name for people."""
        first = self.cells[0]
        names = " ".join(dict.fromkeys(cell.method + (f" K={cell.period}" if cell.period else "") for cell in self.cells))
        return f"{first.scene.name}, {self.protocol.describe(first.level)}: {names}"


def tasks(study: Study, folder: Path) -> tuple[list[Task], int]:
    """What is still to be done, and the number of results that are there already. Equal results are made once."""
    cache = Cache(folder / FOLDER)
    distinct: dict[str, Cell] = {}
    for cell in study.cells():
        distinct.setdefault(cell.name, cell)
    missing = [cell for cell in distinct.values() if cache.get(cell.name) is None]
    todo: dict[tuple[str, float, str], list[Cell]] = {}
    for cell in missing:
        shared = "bm3d" if methods()[cell.method].denoise else cell.name
        todo.setdefault((cell.scene.digest, cell.level, shared), []).append(cell)
    pieces = [Task(tuple(cells), study.protocol, study.reading, folder) for cells in todo.values()]
    return pieces, len(distinct) - len(missing)


def work(task: Task) -> list[str]:
    """Make and keep the results of a task. Returns a line for each that failed. Raises OutputError when they cannot be kept."""
    cache = Cache(task.folder / FOLDER)
    failures = []
    for cell in task.cells:
        try:
            picture = render_cell(cell, task.protocol, task.reading)
            measures = Measures.of(picture, task.reading.truth(cell.scene.source))
        except PanchromaError as error:
            failures.append(f"{cell.scene.source}: {cell.method}, {task.protocol.describe(cell.level)}: {error}")
        except MemoryError:
            failures.append(f"{cell.scene.source}: {cell.method}: not enough memory for a picture of this size")
        else:
            cache.put(cell.name, measures)
    return failures


def render_cell(cell: Cell, protocol: Protocol, reading: Reading) -> FloatArray:
    """The picture behind a result, float32 (H, W, 3), scene units."""
    return methods()[cell.method].render(_cameras(cell.scene, cell.level, cell.period, protocol, reading))


@lru_cache(maxsize=1)  # the methods of a task share their denoised samples, which take by far the longest
def _cameras(scene: SceneInfo, level: float, period: int, protocol: Protocol, reading: Reading) -> CameraPair:
    return CameraPair(protocol, level, reading.truth(scene.source), period, scene.neutral)


def collect(study: Study, folder: Path) -> dict[Cell, Measures]:
    """All results that are there, in the order of the report."""
    cache = Cache(folder / FOLDER)
    found = ((cell, cache.get(cell.name)) for cell in study.cells())
    return {cell: measures for cell, measures in found if measures is not None}
