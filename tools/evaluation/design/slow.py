"""The slow judge: tiles before photographs, rendered by `best` and measured as `panchroma evaluate` does."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from shared.errors import InputError
from tools.camera.protocols import Protocol

from ..criteria import CRITERIA
from ..figures import Figures
from ..scene_sets import Reading
from ..study import Study, collect, tasks
from ..team import Team
from ..tiles import Tile

METHOD = "best"
SLOW = tuple(
    next(each for each in CRITERIA if each.figure == name)
    for name in ("psnr_luminance", "psnr_chrominance", "chrominance_q10", "psnr")
)
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
    results = collect(study, folder)
    if not results:
        raise InputError("nothing could be measured; the lines above say why")
    return Figures(study, results)


def slow_figures(measured: Figures, letters: Sequence[str]) -> list[tuple[float, ...]]:
    """What was measured of the tile with these rows under each light, in the order of `SLOW`: dB; NaN where it failed.

    Where there are several sets of scenes it is the mean over these.
    """
    tile = next(each for each in measured.study.tiles if each.pattern.tile == tuple(letters))
    method, found = measured.study.methods[0], []
    for level in measured.study.levels:
        rows = [each for group in measured.sets if (each := group.figure(level, method, tile=tile))]
        found.append(tuple(float(np.mean([criterion.of(each) for each in rows])) if rows else float("nan") for criterion in SLOW))
    return found


def spearman(one: Sequence[float], other: Sequence[float]) -> float:
    """Rank correlation of two lists of figures, -1 to 1; NaN where one does not vary. Equal figures share their mean rank."""
    from scipy.stats import rankdata

    first, second = rankdata(one), rankdata(other)
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        return float("nan")
    return float(np.corrcoef(first, second)[0, 1])
