"""The slow judge: tiles before photographs, rendered by `best` and measured as `panchroma evaluate` does."""

from collections.abc import Sequence
from math import nan
from pathlib import Path

import numpy as np

from tools.camera.protocols import Protocol

from ..figures import TENTH_CHROMINANCE, WHOLE, WHOLE_CHROMINANCE, WHOLE_LUMINANCE, Figures
from ..scene_sets import Reading
from ..study import Study, collect, tasks
from ..team import Team
from ..tiles import Tile
from . import judge as fast

METHOD = "best"
SLOW = (WHOLE_LUMINANCE, WHOLE_CHROMINANCE, TENTH_CHROMINANCE, WHOLE)
"""What evaluate measures of luminance, colour, worst colour and whole images, in the order of the fast judge's figures."""


def photographed(
    tiles: Sequence[Tile],
    levels: Sequence[Protocol],
    sources: list[str],
    folder: Path,
    team: Team,
    reading: Reading,
    seed: int = 0,
    method: str = METHOD,
) -> Figures:
    """Measure tiles on scenes; what was measured before is kept in the folder. Raises InputError where nothing can be measured.

    levels: the light.
    sources: files and folders of scenes.
    reading: how they are read.
    seed: of the noise.
    method: name of the render.
    """
    scenes, _, _ = team.read(sources, folder, reading)
    study = Study(tuple(scenes), (method,), tuple(levels), tuple(tiles), seed, reading)
    team.measure(tasks(study, folder)[0])
    return Figures(study, collect(study, folder))


def slow_figures(measured: Figures, letters: Sequence[str]) -> tuple[fast.Figures, ...]:
    """What was measured of the tile with these rows under each light, dB; NaN where it failed.

    Where there are several sets of scenes it is the mean over these.
    """
    tile = next(each for each in measured.study.tiles if each.pattern.tile == tuple(letters))
    method, found = measured.study.methods[0], []
    for level in measured.study.levels:
        rows = [each for group in measured.sets if (each := group.figure(level, method, tile=tile))]
        values = (float(np.mean([criterion.of(each) for each in rows])) if rows else nan for criterion in SLOW)
        found.append(fast.Figures(*values))
    return tuple(found)


def spearman(one: Sequence[float], other: Sequence[float]) -> float:
    """Rank correlation of two lists of figures, -1 to 1; NaN where one does not vary. Equal figures share their mean rank."""
    from scipy.stats import rankdata

    with np.errstate(invalid="ignore"):
        return float(np.corrcoef(rankdata(one), rankdata(other))[0, 1])
