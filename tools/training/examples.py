"""Examples to learn from: pictures as the camera would have rendered them without the network, and
the truth.

A picture is varied first, because photographs to learn from are sharper and cleaner than a camera
RAW: other optics, white balance, exposure, and a little noise of its own. Then it is simulated and
rendered up to the network.
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...offline import BEST, Band, measure, use_threads
from ...offline.pipeline import run_row_stages
from ...offline.stages.colour_network import Residuals, Superpixels
from ...offline.version import ALGORITHM
from ...shared import CfaPattern, DoubleArray, FloatArray, InputError, Mosaic, SensorCalibration
from ...shared.arrays import Pair
from ...shared.writing import durable_file
from ..batch.progress import StageProgress
from ..simulation.load import load_scene
from ..simulation.sensor import simulate_additive
from .drawings import drawing, page

Examples = tuple[list[Path], list[Path]]
"""Files of examples to learn from, and of those kept back."""
DRAWN = "drawn"
"""The name of a source that is a drawing instead of a file."""
PAGE = "page"
"""The name of a source that is a page of print."""
_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".npy", ".dng"}
_KEPT_BACK = 20  # one source in this many is kept back, to measure the loss
# share without noise, and its range otherwise, drawn logarithmically
_CLEAN, _SIGMAS = 1 / 3, (0.003, 0.04)
_BLURS = (0.0, 0.4, 0.6, 0.8)  # pixels: standard deviations of optics
_SOFTENED = 0.7  # share of pages of print that are varied; the others are as sharp as drawn
_WHITE = 0.35  # standard deviation of the logarithm of each channel's gain
_OWN_NOISE = 2e-5  # largest shot noise of a picture itself, variance per scene unit
_KIND = np.float16  # what is kept on the disk: off by 5e-4 of a value at most


def photographs(folders: Sequence[str]) -> list[str]:
    """The paths of all photographs in these folders or below; those of a folder are ordered by
    name.
    """
    paths = (path for folder in folders for path in sorted(Path(folder).rglob("*")))
    return [str(path) for path in paths if path.suffix.lower() in _SUFFIXES and path.is_file()]


def kept_back(sources: Sequence[str]) -> list[bool]:
    """Select the sources that are kept back from learning; a photograph that is given twice is on
    one side.
    """
    places = enumerate(sources)
    made = DRAWN, PAGE
    numbers = (place if source in made else sources.index(source) for place, source in places)
    return [number % _KEPT_BACK == _KEPT_BACK // 2 for number in numbers]


def claim(folder: Path, plan: dict[str, Any], settings: str) -> None:
    """Make the folder of a training, with its plan.

    Parameters
    ----------
    settings : str
        What the plan has besides sources, in words.

    Raises
    ------
    InputError
        When another training has begun there, or one by another version.
    """
    document, begun = json.dumps(plan | {"algorithm": ALGORITHM}, indent=1), folder / "plan.json"
    folder.mkdir(exist_ok=True)
    if begun.exists() and begun.read_text(encoding="utf-8") != document:
        fault = f"holds another training (other sources, {settings} or version)"
        raise InputError(f"{folder}: {fault}; give another folder, or remove it")
    begun.write_text(document, encoding="utf-8")


def make_examples(
    make: Callable[..., Sequence[NDArray[Any]]],
    sources: Sequence[str],
    seeds: Sequence[tuple[int, ...]],
    folder: Path,
    jobs: int,
    progress: StageProgress,
) -> Examples:
    """Write the examples of sources that are not in a folder yet.

    Parameters
    ----------
    make : Callable[..., Sequence[NDArray[Any]]]
        Makes an example from a source and a `seed`.
    seeds : Sequence[tuple[int, ...]]
        One for each example of a source, the last number of which names it; the number of the
        source follows.
    """
    examples: Examples = [], []
    tasks = []
    for number, (source, is_kept) in enumerate(zip(sources, kept_back(sources), strict=True)):
        for seed in seeds:
            path = folder / f"{seed[-1]}-{number:05d}.npz"
            examples[is_kept].append(path)
            if not path.exists():
                tasks.append((make, source, (*seed, number), path))
    in_processes(_write, tasks, jobs, progress)
    return examples


def _write(make: Callable[..., Any], source: str, seed: tuple[int, ...], path: Path) -> None:
    with durable_file(path, overwrite=True) as file:
        np.savez(file, *make(source, seed=seed))


def in_processes(
    function: Callable[..., Any], tasks: Sequence[Any], jobs: int, progress: StageProgress
) -> list[Any]:
    """Return what a function makes of each task, its arguments, in processes of one thread each."""
    progress.stage("examples", len(tasks))
    context, results = get_context("spawn"), []
    with ProcessPoolExecutor(jobs, context, initializer=use_threads, initargs=(1,)) as pool:
        for result in pool.map(function, *zip(*tasks, strict=True)):
            results.append(result)
            progress.advance()
    return results


def read_example(path: Path) -> list[NDArray[Any]]:
    """Arrays of an example."""
    with np.load(path) as arrays:
        return list(arrays.values())


def pictured(source: str, random: np.random.Generator) -> FloatArray:
    """A picture file, a drawing (`DRAWN`) or a page of print (`PAGE`), varied, (H, W, 3)."""
    if source == DRAWN:
        return varied(drawing(random), random)
    if source == PAGE:
        return varied(page(random), random) if random.random() < _SOFTENED else page(random)
    return varied(load_scene(source).rgb, random)


def photographed(
    source: str, patterns: Sequence[CfaPattern], clean: float, random: np.random.Generator
) -> tuple[FloatArray, Mosaic]:
    """A picture, varied, (H, W, 3), and a shot of it with one of the patterns, which begins
    anywhere. source: as for `pictured`.

    Parameters
    ----------
    clean : float
        The share of shots without noise.
    """
    scene = pictured(source, random)
    sigma = 0.0 if random.random() < clean else float(np.exp(random.uniform(*np.log(_SIGMAS))))
    pattern = patterns[int(random.integers(len(patterns)))]
    down, across = random.integers(pattern.period, size=2).tolist()
    pattern = replace(pattern, origin=(down, across))
    return scene, simulate_additive(scene, pattern, SensorCalibration(), sigma, random)


def make_example(source: str, pattern: CfaPattern, seed: tuple[int, ...]) -> list[FloatArray]:
    """Inputs and target of the network for h x w superpixels of K x K pixels. The same arguments
    give the same bytes.

    Parameters
    ----------
    source : str
        As for `pictured`.
    pattern : CfaPattern
        Its tile; where in the frame that begins is random.

    Returns
    -------
    picture : FloatArray
        float16 (3, h K, w K), gamma times red, green and blue, rendered without the network.
    truth : FloatArray
        float16, the same of the scene.
    error : FloatArray
        float16 (S, h, w), at S sites.
    variance : FloatArray
        float32 (1, h, w). See `offline.stages.colour_network.Residuals`.
    """
    random = np.random.default_rng(seed)
    scene, mosaic = photographed(source, [pattern], _CLEAN, random)
    settings = replace(BEST, learned=replace(BEST.learned, used=False))
    measured = measure(mosaic, settings)
    corrected = Band.joined(list(run_row_stages(measured, settings)))
    grid = Superpixels(measured.sites)
    # superpixels that lie wholly inside the frame
    rows, columns = ((1, count - 1) for count in grid.shape)
    error, variance, _ = Residuals(grid, corrected, measured).of(rows, columns)
    truth = Band(0, np.ones(mosaic.shape, np.float32), scene)
    pictures = (_picture(grid, band, rows, columns) for band in (corrected, truth))
    kept: list[FloatArray] = [planes.astype(_KIND) for planes in (*pictures, error)]
    return [*kept, variance[None]]


def _picture(grid: Superpixels, band: Band, rows: Pair, columns: Pair) -> FloatArray:
    """Return R, G and B of the pixels of some superpixels, (3, h K, w K)."""
    weights = np.eye(3, dtype=np.float32)
    pixels = grid.cut(band, np.ones(3, np.float32), (rows, columns), weights)
    down, across = pixels.shape[2:]
    parted = pixels.reshape(3, grid.period, grid.period, down, across)
    return parted.transpose(0, 3, 1, 4, 2).reshape(3, down * grid.period, -1)


def varied(scene: FloatArray, random: np.random.Generator) -> FloatArray:
    """A scene, (H, W, 3), seen otherwise: mirrored, through a softer lens, under other light,
    exposed otherwise, a little noisy.
    """
    from scipy.ndimage import gaussian_filter

    for axis in (0, 1):
        scene = np.flip(scene, axis) if random.random() < 0.5 else scene
    scene = scene.transpose(1, 0, 2) if random.random() < 0.5 else scene
    blur = random.choice(_BLURS)
    scene = gaussian_filter(scene, (blur, blur, 0))
    gains = np.exp(random.normal(0, _WHITE, 3))
    bright = min(1.0, 1 / max(float(np.quantile(scene, 0.999)), 1e-3))
    bright *= 2 ** random.uniform(-1.5, 0)
    light: DoubleArray = scene * (gains / gains.max() * bright)
    if random.random() < 0.5:
        deviation = np.sqrt(1e-7 + light * random.uniform(0, _OWN_NOISE))
        light = light + random.normal(0, 1, light.shape) * deviation
    return np.ascontiguousarray(light.clip(0), np.float32)
