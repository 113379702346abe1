"""The work of an evaluation: every scene at every noise level by every method, each result kept as soon as it is made.

Results are files under a digest of all they depend on, so that an interrupted run goes on where it stopped.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from shared.arrays import FloatArray
from shared.errors import InputError, OutputError, PanchromaError
from shared.writing import own_file, write_durably
from tools.io.scene import RGB
from tools.simulation.protocols import Protocol

from .cameras import CameraPair
from .measures import Measures
from .method import Method
from .methods import Networks, find_method
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

    def method(self, name: str) -> Method:
        """One of the methods."""
        return find_method(name, self.networks)

    @property
    def ours(self) -> str | None:
        """The method that represents us: the best renderer in the study."""
        return next((name for name in ("best", "unlearned", "paper", "preview") if name in self.methods), None)

    @property
    def rivals(self) -> list[str]:
        """Methods of the Bayer sensor."""
        return [name for name in self.methods if not self.method(name).ours]

    def cameras(self, method: str) -> tuple[Tile | None, ...]:
        """The patterns whose shots a method renders; (None,) for a Bayer camera's method."""
        return self.tiles if self.method(method).ours else (None,)

    def cells(self) -> Iterator[Cell]:
        """Every result, in the order of the report; a scene is left out for cameras whose filters it has no channels for."""
        for scene in self.scenes:
            for level in self.levels:
                for name in self.methods:
                    for tile in self.cameras(name):
                        if can_photograph(tile, scene.channels):
                            yield name_cell(scene, level, self.method(name), tile, self.seed)

    def remarks(self) -> tuple[list[str], list[str]]:
        """What the user should know about filters that are made from others, and which scenes a camera cannot photograph."""
        made, found, by_channels = [], [], {scene.channels: scene.name for scene in self.scenes}
        for channels, name in by_channels.items():
            if channels != RGB and self.rivals:
                found.append(f"scenes with the channels {channels}, such as {name}: no Bayer camera photographs them")
            for tile in self.tiles:
                try:
                    made += [f"{tile.name}: {note}" for note in filters_of(tile.pattern, channels).notes]
                except InputError as error:
                    found.append(f"{name}, and others with these channels, without {tile.name}: {error}")
        return made, found


def name_cell(scene: SceneInfo, level: Protocol, method: Method, tile: Tile | None, seed: int) -> Cell:
    """One result, with its name in the cache, a digest of all it depends on. tile: None for a Bayer camera's method."""
    parts = {
        "measuring": MEASURING,
        "protocol": level.identity,
        "level": level.level,
        "seed": seed if level.noisy else 0,  # without noise any seed is the same
        "pattern": asdict(tile.pattern) if tile else None,
        "scene": scene.digest,
        "channels": scene.channels,
        "neutral": scene.neutral if method.balanced else None,
    }
    text = json.dumps(parts | method.identity, sort_keys=True)
    return Cell(scene, level, method.name, tile, f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz")


def can_photograph(tile: Tile | None, channels: str) -> bool:
    """Whether the sparse-colour camera with this pattern, None: the Bayer camera, can photograph scenes with these channels."""
    return tile.sees(channels) if tile else channels == RGB


@dataclass(frozen=True)
class Task:
    """The work for one result, in any process."""

    cell: Cell
    seed: int
    reading: Reading
    folder: Path
    networks: Networks = ()

    @property
    def seconds(self) -> float:
        """Rough duration on one core: the share of a task in the work, for the time left. It foretells nothing by itself."""
        return (find_method(self.cell.method, self.networks).seconds + _SECONDS) * self.cell.scene.megapixels

    @property
    def title(self) -> str:
        """Name for people."""
        pattern = f" {self.cell.pattern}" if self.cell.tile else ""
        return f"{self.cell.scene.name}, {self.cell.level.text}: {self.cell.method}{pattern}"


def tasks(study: Study, folder: Path, *, anew: bool = False) -> tuple[list[Task], int]:
    """What is still to be done, and the number of results that are there already. Equal results are made once.

    anew: make all of them, whatever is there.
    """
    cache = Cache(folder / FOLDER)
    distinct: dict[str, Cell] = {}
    for cell in study.cells():
        distinct.setdefault(cell.name, cell)
    missing = [cell for cell in distinct.values() if anew or cache.get(cell.name, Measures.decode) is None]
    todo = [Task(cell, study.seed, study.reading, folder, study.networks) for cell in missing]
    return todo, len(distinct) - len(missing)


def work(task: Task) -> list[str]:
    """Make and keep the result of a task. Raises OutputError when it cannot be kept.

    Returns a line if it failed, or if a file is no longer what the result is named after.
    """
    cell, place = task.cell, ""
    try:
        method, truth = _checked(task)
        place = f"{cell.scene.source}: {cell.method}, {cell.level.text}: "
        picture = method.render(_cameras(cell.scene, cell.level, cell.tile or Tile.of_period(6), task.seed, task.reading))
        measures = Measures.of(picture, truth, cell.scene.channels)
    except PanchromaError as error:
        return [f"{place}{error}"]
    except MemoryError:
        return [f"{cell.scene.source}: {cell.method}: not enough memory for a picture of this size"]
    Cache(task.folder / FOLDER).put(cell.name, measures.encode())
    return []


def _checked(task: Task) -> tuple[Method, FloatArray]:
    """The method of a task, and the light of its scene, as they are here and now.

    Raises InputError, naming the file, unless they are what the result is named after.
    """
    cell = task.cell
    method = find_method(cell.method, task.networks)
    if name_cell(cell.scene, cell.level, method, cell.tile, task.seed) != cell:
        packages = ", ".join(("Panchroma", *method.packages))
        raise InputError(f"{cell.method}: the process that measures has other versions of {packages}; install the same ones")
    try:
        return method, task.reading.scene(cell.scene.source, cell.scene.digest).rgb
    except InputError as error:
        raise InputError(f"{cell.scene.source}: {error}") from None


@lru_cache(maxsize=1)  # methods that come one after the other share their shots
def _cameras(scene: SceneInfo, level: Protocol, tile: Tile, seed: int, reading: Reading) -> CameraPair:
    light = reading.scene(scene.source, scene.digest).rgb
    return CameraPair(level, seed, light, tile.pattern, scene.neutral, channels=scene.channels)


def collect(study: Study, folder: Path) -> dict[Cell, Measures]:
    """All results that are there, in the order of the report. Raises InputError where there is none."""
    cache = Cache(folder / FOLDER)
    found = {cell: measures for cell in study.cells() if (measures := cache.get(cell.name, Measures.decode)) is not None}
    if not found:
        raise InputError("nothing could be measured; the lines above say why")
    return found
