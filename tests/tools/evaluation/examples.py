"""Small scenes and studies."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from panchroma.shared import CfaPattern, FloatArray
from panchroma.tools.batch.console import Console
from panchroma.tools.evaluation.cameras import Tile
from panchroma.tools.evaluation.figures import Figures
from panchroma.tools.evaluation.scene_sets import Reading
from panchroma.tools.evaluation.study import FOLDER, Study, Team, collect, missing_cases, work
from panchroma.tools.simulation.protocols import PaperProtocol

KODAK = Tile.named(CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW"), "")


def small_scene(rows: int, columns: int, seed: int) -> FloatArray:
    """A scene of soft blobs with one edge in luminance and one in colour, float32 (rows,
    columns, 3).
    """
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    rgb = gaussian_filter(rng.random((rows, columns, 3)), (3, 3, 0.3))
    rgb = 0.2 + 0.5 * (rgb - rgb.min()) / np.ptp(rgb)
    rgb[:, columns // 2 :] *= 0.5
    rgb[rows // 2 :, :, 2] *= 0.6
    return rgb.astype(np.float32)


def pair(rows: int = 60, columns: int = 70, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """A noisy rendering of a random scene, and that scene."""
    rng = np.random.default_rng(seed)
    truth = rng.random((rows, columns, 3))
    return (truth + rng.normal(0, 0.05, truth.shape)).astype(np.float32), truth.astype(np.float32)


def study_of(
    folder: Path,
    methods: tuple[str, ...] = ("paper", "bilinear", "dlmmse"),
    count: int = 2,
    **changes: object,
) -> Study:
    """A study of `count` small scenes, which are written to `folder`."""
    (folder / FOLDER).mkdir(exist_ok=True)
    scenes = []
    for seed in range(count):
        path = folder / f"scene{seed}.npy"
        if not path.exists():
            np.save(path, small_scene(78, 90 + 12 * seed, seed))
        scenes.append(Reading().info(str(path)))
    levels, tiles = PaperProtocol.levels((0.0, 0.03)), (Tile.named(CfaPattern.bayer(6)),)
    study = Study(tuple(scenes), methods, levels, tiles, Reading())
    return replace(study, **changes)  # type: ignore[arg-type]


def measured(study: Study, folder: Path) -> Figures:
    """Make all results of a study in this process."""
    for case in missing_cases(study, folder)[0]:
        assert work(study, folder, case) == []
    return Figures(study, collect(study, folder))


def alone() -> Team:
    """A team of this process only, with enough memory."""
    return Team(Console(), 1, 2**40)
