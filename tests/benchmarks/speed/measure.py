"""the three measurements: speeds in turns, the preview, and growth with size.

Each prints a table for people and returns its figures for `--json`.
"""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from typing import Any

from offline import RenderSettings, render, render_bands
from shared import Mosaic
from shared.dng import decode_dng, encode_dng
from tools.evaluation.presets import PRESETS
from tools.host.console import Console
from tools.pictures.previews import Previews
from tools.rendering.compilation import announced_compilation, compile_ahead

from .files import FileTiming, measure_files, render_file
from .material import Material
from .preview import measure_preview
from .rivals import RIVALS, limit_threads
from .rounds import StageClock, Timing, alternate
from .tables import preview_lines, scaling_lines, speed_lines

_SCALES = (1, 3)
FILE_TO_FILE = "DNG to 16-bit TIFF"


def measure_speeds(material: Material, rounds: int, threads: int, console: Console) -> dict[str, Any]:
    """Time everything in turns on one frame: presets and their stages, files, and the rivals that are installed."""
    limit_threads(threads)
    clocks = {name: StageClock() for name in PRESETS}
    works: dict[str, Callable[[], object]] = {}
    with console.progress("bench") as progress, announced_compilation(console.note, progress), ExitStack() as stack:
        compile_ahead(list(PRESETS.values()), threads, console.note, progress)
        progress.stage("scene", 1)
        mosaic, shot, saved = material.mosaic, material.shot, stack.enter_context(material.saved_shot())
        for name, settings in PRESETS.items():
            works[name] = partial(clocks[name].run, partial(render, mosaic, settings, clocks[name]))
            works[f"{name}, band by band"] = partial(_render_by_bands, mosaic, settings)
            works[f"{name}, {FILE_TO_FILE}"] = partial(render_file, saved, settings)
        picture = Previews()(shot)
        data = encode_dng(shot, picture)
        works |= {"DNG, writing": partial(encode_dng, shot, picture), "DNG, reading": partial(decode_dng, data)}
        ours = list(works)
        works |= {rival.name: rival.prepare(material) for rival in RIVALS if rival.installed}
        progress.stage("rounds", (rounds + 1) * len(works))
        seconds = alternate(works, rounds, progress.advance)
    timings = {name: Timing(each, material.pixels) for name, each in seconds.items()}
    stages = {name: clock.seconds(rounds) for name, clock in clocks.items()}
    stage_timings = {
        name: {stage: Timing(each, material.pixels) for stage, each in found.items()} for name, found in stages.items()
    }
    rivals = {rival.name: timings.get(rival.name) for rival in RIVALS}
    rows, columns = material.shape
    title = f"{columns} x {rows}, {material.pixels / 1e6:.1f} megapixels, {rounds} rounds, arrays in memory but for files"
    console.say("", title, *speed_lines({name: timings[name] for name in ours}, stage_timings, rivals))
    return {
        "pixels": material.pixels,
        "seconds": seconds,
        "stages": stages,
        "times_as_fast_as": {
            name: {rival: timings[name].times_as_fast_as(each) if each else None for rival, each in rivals.items()}
            for name in PRESETS
        },
    }


def _render_by_bands(mosaic: Mosaic, settings: RenderSettings) -> None:
    deque(render_bands(mosaic, settings), maxlen=0)


def measure_previews(material: Material, frames: int, threads: int, console: Console) -> dict[str, Any]:
    """Time the camera's preview at each scale, each in an isolated process."""
    with console.progress("bench") as progress:
        progress.stage("preview", 1)
        found = measure_preview(material, _SCALES, frames, threads)
    console.say("", *preview_lines(found))
    return {"preview": [asdict(each) for each in found]}


def measure_growth(sizes: Sequence[Material], threads: int, console: Console) -> dict[str, Any]:
    """Measure how time and memory grow with the size, from file to file, each size in an isolated process."""
    timings: dict[str, list[FileTiming]] = {preset: [] for preset in PRESETS}
    with console.progress("bench") as progress:
        for preset in PRESETS:
            for material in sizes:
                progress.stage(f"{preset}, {material.pixels / 1e6:.1f} MP", 1)
                timings[preset].append(measure_files(material, preset, threads))
    console.say("", *scaling_lines(timings))
    return {"scaling": {preset: [asdict(each) for each in found] for preset, found in timings.items()}}
