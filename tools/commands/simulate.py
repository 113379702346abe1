"""Photograph scenes with a simulated sparse-colour camera: each becomes a shot, a DNG; --truth
saves the scene beside it.

A SCENE is a camera RAW (each 2 x 2 Bayer quad becomes one pixel with all three colours), a linear
DNG (three samples per pixel, of render or a raw developer), a 16- or 32-bit linear picture (TIFF,
PNG, EXR, NPY), an 8-bit picture (sRGB, made linear), or drawn: builtin:WIDTHxHEIGHT;
chart:WIDTHxHEIGHT, a ColorChecker to calibrate with; flat:WIDTHxHEIGHT, even light;
dark:WIDTHxHEIGHT, none.

With --pattern a scene may have other channels than red, green and blue: an EXR by their names, a
TIFF (samples or pages) or NPY in the order of the pattern's letters. Filters C, M and Y are made
from red, green and blue.

--burst N makes a hand-held series of each scene, STEM-1.dng, STEM-2.dng ...; the first frame is the
reference, which has not moved.
"""

import argparse
import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from hashlib import sha256
from pathlib import Path

import numpy as np

from ...shared.dng import encode_dng
from ...shared.errors import InputError
from ...shared.series import frame_name
from ...shared.writing import write_durably
from ..batch.console import Console
from ..batch.folders import plan, search
from ..batch.in_memory import camera_preview
from ..batch.jobs import Job, Outcome, output_folder, planned
from ..batch.journal import digest
from ..batch.order import Keep, do_kept
from ..batch.progress import StageProgress
from ..io.development import Development
from ..io.kind import PictureKind, write_picture
from ..simulation import simulated_camera
from ..simulation.lens import Lens
from ..simulation.load import ENDINGS, TRUTH, TRUTH_PICTURE, is_drawn, load_scene, set_aside
from ..simulation.protocols import chosen_protocol
from ..simulation.simulated_camera import Exposed, SimulatedBurst, SimulatedCamera, SimulatedFrame
from . import options
from .options import SENSOR_BITS, add, amount, camera_of, count, numbers, pixel_limit

_TRUTH_MEASURED, _TRUTH_SHOWN = PictureKind("tif", 32, "camera"), PictureKind("png", 8, "srgb")

USAGE = "SCENE ... -o DIR"
EXAMPLE = "panchroma simulate IMG_0001.CR2 -o shots --sigma 0.01 --truth"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma simulate`."""
    drawn = "builtin:WIDTHxHEIGHT, chart:WIDTHxHEIGHT"
    scenes = f"camera RAW, picture, {drawn}, or a folder with pictures in it or below"
    parser.add_argument("scenes", metavar="SCENE", nargs="+", help=scenes)
    add(parser, "output", help="folder for STEM.dng (subfolders are kept), created if missing")
    sensor = parser.add_argument_group("the camera")
    add(sensor, "camera", "pattern", "channels", "origin")
    add(sensor, "sensor-bits", help=f"{SENSOR_BITS} (default: 12, or those of the camera)")
    raw = "STEM.raw, the samples alone, to try `capture` with (pixel format u16, and their bits)"
    samples = f"dng (the default), or raw: {raw}"
    sensor.add_argument("-f", "--format", choices=("dng", "raw"), default="dng", help=samples)
    light = parser.add_argument_group("light and noise (default: none)")
    add(light, "sigma", "light", "seed")
    tint = "with PERCENT less of the first channel and as much more of the last one"
    shading = f"a lens whose corners are STOPS darker, {tint}"
    stops = numbers(example="2,15")
    light.add_argument("--shading", metavar="STOPS,PERCENT", type=stops, help=shading)
    burst = parser.add_argument_group("a burst: a hand-held series of each scene")
    frames = "make N frames, STEM-1.dng to STEM-N.dng; the first has not moved"
    burst.add_argument("--burst", metavar="N", type=count, help=frames)
    motion = "largest displacement of the others (default: 0)"
    burst.add_argument("--motion", metavar="PIXELS", type=amount, default=0.0, help=motion)
    stated = "the files state it as exposure time (default: all are exposed alike)"
    bracket = f"exposure of each frame in stops, such as 0,-2,2; {stated}"
    stops = numbers(example="0,-2,2")
    burst.add_argument("--bracket", metavar="EV,EV,...", type=stops, default=(), help=bracket)
    reduced = "make one pixel from N x N of the scene, after the burst's motion (default: 1)"
    parser.add_argument("--reduce", metavar="N", type=count, default=1, help=reduced)
    add(parser, "linear")
    truth = (
        "also write what the shot sees, under its light and exposure, as STEM.truth.tif, float32, "
        f"scene units of a render, and as STEM{TRUTH_PICTURE}, sRGB, to look at; of a burst what "
        "its first frame sees, the reference (burst --reference STEM-1.dng), and the motion of "
        "the others"
    )
    parser.add_argument("--truth", action="store_true", help=truth)
    options.add_file_run(parser, "scenes")
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Write a shot of each scene; returns the exit code."""
    protocol, level = chosen_protocol(arguments.sigma, arguments.light)
    noise = protocol() if level is None else protocol(level)
    is_series = arguments.burst is not None
    burst = SimulatedBurst.of(arguments.burst, arguments.motion, arguments.bracket)
    lens = Lens.of(arguments.shading)
    measured, pattern = camera_of(arguments)
    if measured:
        lens.check(measured.calibration, arguments.camera)
    camera = SimulatedCamera(pattern, measured, noise, bits=arguments.sensor_bits, lens=lens)
    folder = output_folder(arguments.output, dry_run=arguments.dry_run)
    stated = arguments.camera and digest(arguments.camera)
    run = options.file_run(arguments, folder, camera=stated, pattern=asdict(pattern))
    load = partial(load_scene, max_pixels=pixel_limit(), channels=pattern.channels)

    def names(source: str) -> list[str]:
        stem = source.replace(":", "-") if is_drawn(source) else Path(source).stem
        numbered = [frame_name(stem, number + 1, burst.frames) for number in range(burst.frames)]
        beside = (TRUTH, TRUTH_PICTURE, ".motion.json")[: 2 + is_series] if arguments.truth else ()
        shots = [f"{shot}.{arguments.format}" for shot in (numbered if is_series else [stem])]
        return [*shots, *(f"{stem}{ending}" for ending in beside)]

    def work(job: Job, progress: StageProgress, keep: Keep) -> Outcome:
        shots, beside = job.outputs[: burst.frames], job.outputs[burst.frames :]
        motions: dict[str, SimulatedFrame] = {}
        missing: tuple[str, ...] = ()
        progress.stage("reading", 1)
        scene = load(job.source, linear=arguments.linear)
        if run.dry_run:
            return planned(job)
        hand = noise_of(arguments.seed, shots[0].with_suffix(".motion").relative_to(folder))
        frames = simulated_camera.burst_frames(scene.rgb, burst, hand, arguments.reduce)
        progress.stage("sampling and writing", burst.frames)
        for shot, frame in zip(shots, frames, strict=True):
            seeded = shot.relative_to(folder).with_suffix(".dng")  # a raw frame is that of its shot
            exposed = camera.shoot(scene, noise_of(arguments.seed, seeded), frame)
            mosaic = exposed.mosaic
            if arguments.format == "raw":  # samples alone
                samples = mosaic.codes.astype("<u2").tobytes()
            else:
                samples = encode_dng(mosaic, camera_preview(mosaic))
            write_durably(shot, samples, **keep(shot))
            if not motions and beside:
                missing = _write_truth(exposed, beside[:2], keep)
            motions[shot.name] = replace(frame, rgb=frame.rgb[:0].copy())  # without its light
            progress.advance()
        for path in beside[2:]:
            moved = simulated_camera.motion_text(motions, mosaic.shape)
            write_durably(path, moved.encode(), **keep(path))
        notes.append((job.source, (*scene.notes, *missing)))
        rows, columns = mosaic.shape
        size = f"{columns} x {rows}, period {pattern.period}, {mosaic.calibration.bits} bits"
        written = [str(path) for path in job.outputs if not (missing and path == beside[1])]
        facts = {"outputs": written, "width": columns, "height": rows}
        if is_series:
            facts["reference"] = str(shots[0])
        return Outcome(facts, tuple(f"{shot}: {size}" for shot in shots))

    scenes = search(arguments.scenes, ENDINGS, output=folder, is_file=is_drawn, set_aside=set_aside)
    failed = scenes.report(console)
    notes: list[tuple[str, tuple[str, ...]]] = []
    jobs = plan(scenes.sources, names, folder, dry_run=run.dry_run)
    code = do_kept(run, jobs, work, console, show=console.progress, threads=arguments.jobs)
    console.notes(notes)
    return code or failed


def _write_truth(exposed: Exposed, paths: Sequence[Path], keep: Keep) -> tuple[str, ...]:
    """Write the truth of a shot as a measurement and as a picture; returns a remark if its channels
    have no colours to show.
    """
    mosaic = exposed.mosaic
    for path, kind in zip(paths, (_TRUTH_MEASURED, _TRUTH_SHOWN), strict=True):
        development = Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata)
        try:
            kind.kept_as.check(development)
        except InputError:
            kept = keep(path)
            if kept["overwrite"]:
                path.unlink(missing_ok=True)  # the picture of an earlier scene
            if not path.exists():
                kept["on_complete"](path)()  # `--resume` need not look for it
            colours = f"the colours of the channels {mosaic.pattern.channels}"
            return (f"no {TRUTH_PICTURE}: {colours} are unknown, or those of no light",)
        write_picture(path, [exposed.truth], development, **keep(path))
    return ()


def noise_of(seed: int, name: str | Path) -> np.random.Generator:
    """The source of noise of one shot: the same for the same seed and name below the output folder,
    another one for any other.

    Do not draw all shots of a run from one generator: the noise of a shot would depend on the shots
    before it.
    """
    return np.random.default_rng([seed, *sha256(os.fsencode(name)).digest()])
