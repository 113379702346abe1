"""The work of an evaluation: every scene at every noise level by every method, each result kept as
soon as it is made.

Results are files under a digest of all they depend on, so that an interrupted run goes on where it
stopped.
"""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from ...shared.errors import InputError, OutputError, PanchromaError
from ...shared.writing import own_file, write_durably
from ..batch.cluster import source_digest
from ..simulation.noise import Protocol
from .cameras import CameraPair
from .measures import Measures
from .method import Method
from .methods import Sources, find_method
from .scene_sets import Reading, SceneInfo
from .tiles import Tile

FOLDER = "results"


class Cell(NamedTuple):
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
    seed
        Seed of the noise, the same for every scene.
    reading
        How scenes are read.
    sources
        Those of the networks and functions among the methods.
    """

    scenes: tuple[SceneInfo, ...]
    methods: tuple[str, ...]
    levels: tuple[Protocol, ...]
    tiles: tuple[Tile, ...]
    seed: int
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

    def cells(self) -> Iterator[Cell]:
        """Yield every result, in the order of the report."""
        for scene in self.scenes:
            for level in self.levels:
                for method in map(self.method, self.methods):
                    for tile in self.tiles if method.ours else (None,):
                        yield name_cell(scene, level, method, tile, self.seed)


def name_cell(
    scene: SceneInfo, level: Protocol, method: Method, tile: Tile | None, seed: int
) -> Cell:
    """Return a result with the name of its file: a digest of all it depends on, the source of
    Panchroma and its networks included.

    Parameters
    ----------
    tile : Tile | None
        None for a Bayer camera's method.
    """
    parts = {
        "source": source_digest(),
        "protocol": level.name,
        "level": level.level,
        "seed": seed if level.level else 0,  # without noise any seed is the same
        "pattern": asdict(tile.pattern) if tile else None,
        "scene": scene.digest,
        "neutral": scene.neutral if method.balanced else None,
    }
    text = json.dumps(parts | method.identity, sort_keys=True).encode()
    return Cell(scene, level, method.name, tile, f"{hashlib.sha256(text).hexdigest()[:32]}.npz")


def missing_cells(study: Study, folder: Path, *, anew: bool = False) -> tuple[list[Cell], int]:
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
    distinct = {cell.name: cell for cell in study.cells()}
    missing = [cell for cell in distinct.values() if anew or _kept(folder, cell) is None]
    return missing, len(distinct) - len(missing)


def remove_results(study: Study, folder: Path) -> None:
    """Remove the results of a study, where there are any.

    Raises OutputError.
    """
    for cell in study.cells():
        path = folder / FOLDER / cell.name
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: cannot be removed ({error.strerror or error})") from None


def work(study: Study, folder: Path, cell: Cell) -> list[str]:
    """Make and keep a result, in any process.

    Parameters
    ----------
    study
        The study; its scenes are not used.
    folder
        Folder of the evaluation.
    cell
        The result.

    Returns
    -------
    list of str
        A line if it failed, or if a file is no longer what the result is named after; otherwise
        empty.

    Raises
    ------
    OutputError
        The result cannot be kept.
    """
    place = ""
    try:
        method = study.method(cell.method)
        if name_cell(cell.scene, cell.level, method, cell.tile, study.seed) != cell:
            reason = "the process that measures has another source of Panchroma, or other packages"
            raise InputError(f"{cell.method}: {reason}; install the same ones")
        truth = study.reading.scene(cell.scene).rgb
        place = f"{cell.scene.source}: {cell.method}, {cell.level.text}: "
        tile = cell.tile or study.tile
        cameras = _cameras(cell.scene, cell.level, tile, study.seed, study.reading)
        measures = Measures.of(method.render(cameras), truth, study.reading.channels)
    except PanchromaError as error:
        return [f"{place}{error}"]
    except MemoryError:
        return [f"{cell.scene.source}: {cell.method}: not enough memory for a picture of this size"]
    write_durably(folder / FOLDER / cell.name, measures.encode(), overwrite=True)
    return []


def collect(study: Study, folder: Path) -> dict[Cell, Measures]:
    """Return all results that are there, in the order of the report."""
    return {cell: kept for cell in study.cells() if (kept := _kept(folder, cell)) is not None}


def _kept(folder: Path, cell: Cell) -> Measures | None:
    """The result of an earlier run; None when there is none, or its file is damaged."""
    try:
        with own_file(folder / FOLDER / cell.name, "rb") as file:
            return Measures.decode(file.read())
    except (OSError, InputError):
        return None


@lru_cache(maxsize=1)  # methods that come one after the other share their shots
def _cameras(
    scene: SceneInfo, level: Protocol, tile: Tile, seed: int, reading: Reading
) -> CameraPair:
    return CameraPair(level, seed, reading.scene(scene).rgb, tile.pattern, scene.neutral)
