"""The work of an evaluation: every scene at every noise level by every method, each result kept as soon as it is made.

Results are files under a digest of all they depend on, so that an interrupted run goes on where it stopped.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from shared.arrays import FloatArray
from shared.errors import InputError, OutputError, PanchromaError
from shared.writing import own_file, write_durably
from tools.io.scene import RGB
from tools.simulation.noise import Protocol

from .cameras import CameraPair
from .measures import Measures
from .method import Method
from .methods import Networks, choose, method_of, methods
from .rivals.denoising import SECONDS as DENOISING_SECONDS
from .scene_sets import Reading, SceneInfo
from .tiles import Tile, filters_of

T = TypeVar("T")

FOLDER = "results"
MEASURING = 2
"""Version of the way from the light of a scene to figures: cameras, noise, filters, measures. Raise it whenever figures change.

A result is kept under versions: this one, those of the protocol and of the method (of ours: of the renderer and its settings, or of
the preview), and those of the packages that the method needs. Whoever changes code so that figures differ raises the number beside
it, or the old figures stay; a test compares figures with those that the numbers stand for.
"""
_SECONDS = 0.3  # per megapixel, to measure a picture, roughly


@dataclass(frozen=True)
class Cache:
    """The results in one folder, one file each."""

    folder: Path

    def get(self, name: str, decode: Callable[[bytes], T]) -> T | None:
        """What `decode` makes of the file of this name; None when there is no such file, or it is damaged (`decode` raises)."""
        try:
            with own_file(self.folder / name, "rb") as file:
                return decode(file.read())
        except (OSError, ValueError, TypeError, InputError):
            return None

    def put(self, name: str, data: bytes) -> None:
        """Keep a result; the file is complete or absent. Raises OutputError as `write_durably` does."""
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.folder}: the folder cannot be made ({error.strerror or error})") from None
        write_durably(self.folder / name, data, overwrite=True)

    def remove(self, names: Iterable[str]) -> None:
        """Remove results, where there are any. Raises OutputError."""
        for name in names:
            try:
                (self.folder / name).unlink(missing_ok=True)
            except OSError as error:
                raise OutputError(f"{self.folder / name}: cannot be removed ({error.strerror or error})") from None


@dataclass(frozen=True)
class Cell:
    """One result: a scene at one noise level, by one method.

    scene: the scene.
    level: the noise.
    method: its name.
    tile: the pattern of the sparse-colour camera; None for a Bayer camera's method.
    name: of the result in the cache.
    """

    scene: SceneInfo
    level: Protocol
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
    seed: of the noise, the same for every scene.
    reading: how scenes are read.
    networks: those among the methods.
    """

    scenes: tuple[SceneInfo, ...]
    methods: tuple[str, ...]
    levels: tuple[Protocol, ...]
    tiles: tuple[Tile, ...]
    seed: int
    reading: Reading
    networks: Networks = ()

    @property
    def protocol(self) -> type[Protocol]:
        """The kind of noise."""
        return type(self.levels[0])

    @property
    def tile(self) -> Tile:
        """The pattern at which our methods are compared with the rivals: the paper's K = 6, if it is among them."""
        return next((tile for tile in self.tiles if tile.period == 6), self.tiles[0])

    def light(self, tile: Tile) -> float | None:
        """Light that a pattern collects, as a multiple of a Bayer sensor's, of the first scene that it can photograph."""
        return next((tile.light(scene.channels) for scene in self.scenes if tile.sees(scene.channels)), None)

    @property
    def ours(self) -> str | None:
        """The method that represents us: the best renderer in the study."""
        return next((name for name in ("best", "unlearned", "paper", "preview") if name in self.methods), None)

    @property
    def rivals(self) -> list[str]:
        """Methods of the Bayer sensor."""
        return [name for name in self.methods if not methods()[name].sparse]

    def tile_of(self, method: str, tile: Tile | None = None) -> Tile | None:
        """The pattern of the shots that a method renders, by default the study's own; None for a Bayer camera's method."""
        return (tile or self.tile) if methods()[method].sparse else None

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

    def cell(self, scene: SceneInfo, level: Protocol, method: Method, tile: Tile | None) -> Cell:
        """One result, with its name in the cache. tile: None for a Bayer camera's method."""
        return _cell(scene, level, method, tile, self.seed)


def _cell(scene: SceneInfo, level: Protocol, method: Method, tile: Tile | None, seed: int) -> Cell:
    neutral = scene.neutral if method.balanced else None
    name = result_name(method, level, tile, seed, scene=scene.digest, channels=scene.channels, neutral=neutral)
    return Cell(scene, level, method.name, tile, f"{name}.npz")


def result_name(method: Method, level: Protocol, tile: Tile | None, seed: int, **scene: Any) -> str:
    """Name of a kept result, without an ending. scene: JSON values that tell scenes apart."""
    parts = {
        "measuring": MEASURING,
        "protocol": level.identity,
        "level": level.level,
        "seed": seed if level.noisy else 0,  # without noise any seed is the same
        "pattern": asdict(tile.pattern) if tile else None,
    }
    text = json.dumps(parts | method.identity | scene, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def can_photograph(tile: Tile | None, channels: str) -> bool:
    """Whether the sparse-colour camera with this pattern, None: the Bayer camera, can photograph scenes with these channels."""
    return tile.sees(channels) if tile else channels == RGB


@dataclass(frozen=True)
class Task:
    """Results that one process makes one after the other, because they share their preparation."""

    cells: tuple[Cell, ...]
    seed: int
    reading: Reading
    folder: Path
    networks: Networks = ()

    @property
    def seconds(self) -> float:
        """Rough duration on one core: the share of a task in the work, for the time left. It foretells nothing by itself."""
        chosen = [methods()[cell.method] for cell in self.cells]
        once = max(0, sum(method.denoise is not None for method in chosen) - 1)  # denoised samples are kept for the next method
        each = sum(method.seconds + _SECONDS for method in chosen)
        return (each - once * DENOISING_SECONDS) * self.cells[0].scene.megapixels

    @property
    def title(self) -> str:
        """Name for people."""
        first = self.cells[0]
        names = " ".join(dict.fromkeys(cell.method + (f" {cell.pattern}" if cell.tile else "") for cell in self.cells))
        return f"{first.scene.name}, {first.level.text}: {names}"


def tasks(study: Study, folder: Path, *, anew: bool = False) -> tuple[list[Task], int]:
    """What is still to be done, and the number of results that are there already. Equal results are made once.

    anew: make all of them, whatever is there.
    """
    cache = Cache(folder / FOLDER)
    distinct: dict[str, Cell] = {}
    for cell in study.cells():
        distinct.setdefault(cell.name, cell)
    missing = [cell for cell in distinct.values() if anew or cache.get(cell.name, Measures.decode) is None]
    todo: dict[tuple[str, Protocol, str], list[Cell]] = {}
    for cell in missing:
        shared = "bm3d" if methods()[cell.method].denoise else cell.name
        todo.setdefault((cell.scene.digest, cell.level, shared), []).append(cell)
    pieces = [Task(tuple(cells), study.seed, study.reading, folder, study.networks) for cells in todo.values()]
    return pieces, len(distinct) - len(missing)


def work(task: Task) -> list[str]:
    """Make and keep the results of a task. Raises OutputError when they cannot be kept.

    Returns a line for each that failed, and one for a file that is no longer what its results are named after.
    """
    cache = Cache(task.folder / FOLDER)
    failures = []
    for cell in task.cells:
        place = ""
        try:
            truth = _truth(cell, task)
            place = f"{cell.scene.source}: {cell.method}, {cell.level.text}: "
            picture = render_cell(cell, task.seed, task.reading)
            measures = Measures.of(picture, truth, cell.scene.channels)
        except PanchromaError as error:
            failures.append(f"{place}{error}")
        except MemoryError:
            failures.append(f"{cell.scene.source}: {cell.method}: not enough memory for a picture of this size")
        else:
            cache.put(cell.name, measures.encode())
    return list(dict.fromkeys(failures))


def _truth(cell: Cell, task: Task) -> FloatArray:
    """The light of a result's scene, as it is read here and now. Raises InputError, naming the file, unless the result is named
    after what is read, and after the method that is used here.
    """
    method = method_of(cell.method, task.networks)
    if _cell(cell.scene, cell.level, method, cell.tile, task.seed) != cell:
        packages = ", ".join(("Panchroma", *method.packages))
        raise InputError(f"{cell.method}: the process that measures has other versions of {packages}; install the same ones")
    try:
        return task.reading.scene(cell.scene.source, cell.scene.digest).rgb
    except InputError as error:
        raise InputError(f"{cell.scene.source}: {error}") from None


def render_cell(cell: Cell, seed: int, reading: Reading) -> FloatArray:
    """The picture behind a result, float32 (H, W, N), scene units, and what it states (see `Method.render`)."""
    cameras = _cameras(cell.scene, cell.level, cell.tile or Tile.of_period(6), seed, reading)
    return methods()[cell.method].render(cameras)


@lru_cache(maxsize=1)  # the methods of a task share their denoised samples, which take by far the longest
def _cameras(scene: SceneInfo, level: Protocol, tile: Tile, seed: int, reading: Reading) -> CameraPair:
    return CameraPair(
        level, seed, reading.scene(scene.source, scene.digest).rgb, tile.pattern, scene.neutral, channels=scene.channels
    )


def collect(study: Study, folder: Path) -> dict[Cell, Measures]:
    """All results that are there, in the order of the report. Raises InputError where there is none."""
    cache = Cache(folder / FOLDER)
    found = {cell: measures for cell in study.cells() if (measures := cache.get(cell.name, Measures.decode)) is not None}
    if not found:
        raise InputError("nothing could be measured; the lines above say why")
    return found
