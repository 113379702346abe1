"""The work of an evaluation: every scene at every noise level by every method, each result kept as soon as it is made."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

from shared.arrays import FloatArray
from shared.errors import InputError, PanchromaError
from tools.scenes.scene import RGB

from .cache import FOLDER, Cache, key
from .cameras import CameraPair
from .measures import Measures
from .methods import DENOISING_SECONDS, Method, choose, methods
from .protocol import Protocol
from .scene_sets import Reading, SceneInfo
from .tiles import Tile, best_known, filters_of

_MEASURING = 0.3  # seconds per megapixel, roughly


@dataclass(frozen=True)
class Cell:
    """One result: a scene at one noise level, by one method.

    scene: the scene.
    level: noise level, as in `Protocol`.
    method: its name.
    tile: the pattern of the sparse-colour camera; None for a Bayer camera's method.
    name: of the result in the cache.
    """

    scene: SceneInfo
    level: float
    method: str
    tile: Tile | None
    name: str

    @property
    def pattern(self) -> str:
        """Name of the pattern; "" for a Bayer camera's method."""
        return self.tile.name if self.tile else ""


@dataclass(frozen=True)
class Study:
    """What is compared.

    scenes: all under different names.
    methods: names.
    levels: in order of rising noise.
    tiles: the patterns of the sparse-colour camera, under different names.
    protocol, reading: how scenes are photographed and read.
    """

    scenes: tuple[SceneInfo, ...]
    methods: tuple[str, ...]
    levels: tuple[float, ...]
    tiles: tuple[Tile, ...]
    protocol: Protocol
    reading: Reading

    @property
    def tile(self) -> Tile:
        """The pattern at which our methods are compared with the rivals: the paper's, if it is among them."""
        return best_known(self.tiles)

    def light(self, tile: Tile) -> float | None:
        """Light that a pattern collects, as a multiple of a Bayer sensor's, of the first scene that it can photograph."""
        return next((tile.light(scene.channels) for scene in self.scenes if tile.sees(scene.channels)), None)

    @property
    def periods(self) -> tuple[int, ...]:
        """K of those patterns that are the paper's, rising."""
        return tuple(tile.period for tile in self.tiles if tile.period)

    def cells(self) -> Iterator[Cell]:
        """Every result, in the order of the report; a scene is left out for cameras whose filters it has no channels for."""
        for scene in self.scenes:
            for level in self.levels:
                for method in choose(list(self.methods)):
                    for tile in self.cameras(method):
                        if can_photograph(tile, scene.channels):
                            yield self.cell(scene, level, method, tile)

    def cameras(self, method: Method) -> tuple[Tile | None, ...]:
        """The patterns whose shots a method renders; (None,) for a Bayer camera's method."""
        return self.tiles if method.sparse else (None,)

    def remarks(self) -> tuple[list[str], list[str]]:
        """What the user should know about filters that are made from others, and which scenes a camera cannot photograph."""
        made, found, by_channels = [], [], {scene.channels: scene.name for scene in self.scenes}
        for channels, name in by_channels.items():
            if channels != RGB and any(not methods()[method].sparse for method in self.methods):
                found.append(f"scenes with the channels {channels}, such as {name}: no Bayer camera photographs them")
            for tile in self.tiles:
                try:
                    made += [f"{tile.name}: {note}" for note in filters_of(tile.pattern, channels).notes]
                except InputError as error:
                    found.append(f"{name}, and others with these channels, without {tile.name}: {error}")
        return made, found

    def cell(self, scene: SceneInfo, level: float, method: Method, tile: Tile | None) -> Cell:
        """One result, with its name in the cache. tile: None for a Bayer camera's method."""
        noisy = level or self.protocol.kind == "sensor"
        name = key(
            scene=scene.digest,
            channels=scene.channels,
            neutral=scene.neutral if method.balanced else None,
            protocol=asdict(self.protocol if noisy else replace(self.protocol, seed=0)),  # without noise any seed is the same
            level=level,
            pattern=asdict(tile.pattern) if tile else None,
            method=method.identity(),
        )
        return Cell(scene, level, method.name, tile, name)


def can_photograph(tile: Tile | None, channels: str) -> bool:
    """Whether the sparse-colour camera with this pattern, None: the Bayer camera, can photograph scenes with these channels."""
    return tile.sees(channels) if tile else channels == RGB


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
        names = " ".join(dict.fromkeys(cell.method + (f" {cell.pattern}" if cell.tile else "") for cell in self.cells))
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
            measures = Measures.of(picture, task.reading.truth(cell.scene.source), cell.scene.channels)
        except PanchromaError as error:
            failures.append(f"{cell.scene.source}: {cell.method}, {task.protocol.describe(cell.level)}: {error}")
        except MemoryError:
            failures.append(f"{cell.scene.source}: {cell.method}: not enough memory for a picture of this size")
        else:
            cache.put(cell.name, measures)
    return failures


def render_cell(cell: Cell, protocol: Protocol, reading: Reading) -> FloatArray:
    """The picture behind a result, float32 (H, W, N), scene units."""
    return methods()[cell.method].render(_cameras(cell.scene, cell.level, cell.tile or Tile.of_period(6), protocol, reading))


@lru_cache(maxsize=1)  # the methods of a task share their denoised samples, which take by far the longest
def _cameras(scene: SceneInfo, level: float, tile: Tile, protocol: Protocol, reading: Reading) -> CameraPair:
    return CameraPair(protocol, level, reading.truth(scene.source), tile.pattern, scene.neutral, channels=scene.channels)


def collect(study: Study, folder: Path) -> dict[Cell, Measures]:
    """All results that are there, in the order of the report."""
    cache = Cache(folder / FOLDER)
    found = ((cell, cache.get(cell.name)) for cell in study.cells())
    return {cell: measures for cell, measures in found if measures is not None}
