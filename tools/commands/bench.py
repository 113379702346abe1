"""How fast is it, here? The renderer and its stages, the preview, the files, and what others make of a Bayer mosaic of that size.

Arrays are in memory, everything in turns, several rounds after one that does not count; ratios are medians of the rounds' ratios.
With several sizes: how time and memory grow from one DNG to one TIFF, each size in a process of its own.
"""

import argparse
import os
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

from shared.errors import InputError
from tools.host.console import Console, StageProgress
from tools.host.processors import THREAD_VARIABLES

if TYPE_CHECKING:
    from tools.evaluation.speed.files import FileTiming
    from tools.evaluation.speed.material import Material

_MEGAPIXELS, _ROUNDS, _FRAMES = 3.2, 9, 100
_PREVIEW_MEGAPIXELS, _SCALES = 12.0, (1, 3)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `panchroma bench`."""
    parser.add_argument(
        "--megapixels",
        nargs="+",
        type=float,
        default=[_MEGAPIXELS],
        metavar="N",
        help="size of the frame; with several: how time and memory grow",
    )
    parser.add_argument("--rounds", type=int, default=_ROUNDS, metavar="N", help="rounds; each measures everything once")
    parser.add_argument(
        "--frames", type=int, default=_FRAMES, metavar="N", help=f"number of previews of {_PREVIEW_MEGAPIXELS:g} MP"
    )
    parser.add_argument("-j", "--threads", type=int, metavar="N", help="threads, for rivals too (default, and most: one per core)")
    parser.add_argument("--json", action="store_true", help="print one JSON object with every figure to stdout")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    for option in ("rounds", "frames"):
        if getattr(arguments, option) < 1:
            raise InputError(f"--{option} is {getattr(arguments, option)}, expected 1 or more")
    from offline import threads

    used = threads()
    # For the peers, which are loaded later. Numba is at work already and takes no other number.
    os.environ.update({name: str(used) for name in THREAD_VARIABLES if not name.startswith("NUMBA")})

    from tools.evaluation.speed.environment import environment
    from tools.evaluation.speed.material import Material, frame_shape
    from tools.evaluation.speed.tables import environment_lines

    sizes = [Material(frame_shape(megapixels)) for megapixels in arguments.megapixels]
    facts = environment(used)
    console.say("\n".join(environment_lines(facts)))
    if len(sizes) > 1:
        found = _scaling(sizes, used, console)
    else:
        preview = Material(frame_shape(min(_PREVIEW_MEGAPIXELS, 4 * arguments.megapixels[0])))
        found = {
            **_speeds(sizes[0], arguments.rounds, used, console),
            **_preview(preview, arguments.frames, used, console),
        }
    console.record(environment=facts, **found)
    return 0


def _speeds(material: "Material", rounds: int, threads: int, console: Console) -> dict[str, Any]:
    """Everything in turns, on one frame."""
    from offline import render, render_bands
    from shared.dng import decode_dng, encode_dng
    from tools.evaluation.speed.peers import PEERS, limit_threads
    from tools.evaluation.speed.presets import presets
    from tools.evaluation.speed.rounds import StageClock, Timing, alternate
    from tools.evaluation.speed.tables import speed_lines
    from tools.host.compilation import announced_compilation
    from tools.pictures.previews import Previews

    limit_threads(threads)
    clocks: dict[str, StageClock] = {}
    works: dict[str, Callable[[], object]] = {}
    with console.progress("bench") as progress, announced_compilation(console.note, progress):
        progress.stage("scene", 1)
        mosaic, shot = material.mosaic, material.shot
        for name, settings in presets().items():
            clocks[name] = StageClock()
            works[name] = partial(clocks[name].run, partial(render, mosaic, settings, clocks[name]))
            works[f"{name}, band by band"] = partial(_exhaust, render_bands, mosaic, settings)
        picture = Previews()(shot)
        data = encode_dng(shot, picture)
        works |= {"DNG, writing": partial(encode_dng, shot, picture), "DNG, reading": partial(decode_dng, data)}
        ours = list(works)
        works |= {peer.name: peer.prepare(material) for peer in PEERS if peer.installed}
        progress.stage("rounds", (rounds + 1) * len(works))
        seconds = alternate(works, rounds, progress.advance)
    timings = {name: Timing(each, material.pixels) for name, each in seconds.items()}
    parts = {
        name: {stage: Timing(each, material.pixels) for stage, each in clock.seconds(rounds).items()}
        for name, clock in clocks.items()
    }
    peers = {peer.name: timings.get(peer.name) for peer in PEERS}
    rows, columns = material.shape
    title = f"{columns} x {rows}, {material.pixels / 1e6:.1f} megapixels, {rounds} rounds, arrays in memory"
    console.say("\n".join(["", title, *speed_lines({name: timings[name] for name in ours}, parts, peers)]))
    return {
        "pixels": material.pixels,
        "seconds": {name: list(each.seconds) for name, each in timings.items()},
        "stages": {name: {stage: list(each.seconds) for stage, each in found.items()} for name, found in parts.items()},
        "times_as_fast_as": {
            name: {peer: timings[name].times_as_fast_as(each) if each else None for peer, each in peers.items()} for name in parts
        },
    }


def _exhaust(bands: Callable[..., Any], *arguments: Any) -> None:
    for _ in bands(*arguments):
        pass


def _preview(material: "Material", frames: int, threads: int, console: Console) -> dict[str, Any]:
    """The camera's side, each scale in a process of its own."""
    from tools.evaluation.speed.preview import measure_preview
    from tools.evaluation.speed.tables import preview_lines

    with console.progress("bench") as progress:
        progress.stage("preview", 1)
        found = measure_preview(material, _SCALES, frames, threads)
    console.say("\n".join(["", *preview_lines(found)]))
    return {"preview": [asdict(each) for each in found]}


def _scaling(sizes: "list[Material]", threads: int, console: Console) -> dict[str, Any]:
    """How time and memory grow."""
    from tools.evaluation.speed.files import measure_files
    from tools.evaluation.speed.presets import presets
    from tools.evaluation.speed.tables import scaling_lines

    def measured(preset: str, progress: StageProgress) -> "list[FileTiming]":
        found = []
        for material in sizes:
            progress.stage(f"{preset}, {material.pixels / 1e6:.1f} MP", 1)
            found.append(measure_files(material, preset, threads))
        return found

    with console.progress("bench") as progress:
        timings = {preset: measured(preset, progress) for preset in presets()}
    console.say("\n".join(["", *scaling_lines(timings)]))
    return {"scaling": {preset: [asdict(each) for each in found] for preset, found in timings.items()}}
