"""Show what is in shots (pattern, levels, calibration, capture data) and in camera files.

Reading compares a shot's samples with their digest, and checks every field of a camera file.
--verify does this for whole archives.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ...shared import CaptureMetadata, CfaPattern, SensorCalibration, read_camera, read_dng
from ...shared.dng import read_preview, verify_dng
from ...shared.networks import network_for
from ...shared.processors import processors
from ..batch.console import Console
from ..batch.folders import DNGS, search
from ..batch.jobs import Job, Outcome, do_jobs, exit_code, run_jobs
from ..batch.parallel import follow, in_threads
from .options import add, add_shots, pixel_limit

_UNITS = {"exposure_time": " s", "focal_length": " mm", "altitude": " m"}

Contents = tuple[dict[str, Any], dict[str, str]]
"""Facts of a file for machines, and rows of a table for people, of which empty ones are left out.
"""

USAGE = "SHOT ..."
EXAMPLE = "panchroma inspect shots --verify"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma inspect`."""
    add_shots(parser, "a camera.json, ")
    verify = "check each file against its digest, and only count the whole ones and name the others"
    parser.add_argument("--verify", action="store_true", help=verify)
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Show or verify the files; returns the exit code."""
    files, limit = search(arguments.shots, DNGS), pixel_limit()
    failed = files.report(console)
    jobs = [Job(source.name, from_folder=source.from_folder) for source in files.sources]

    def work(job: Job, _: object) -> Outcome:
        source = job.source
        facts, rows = _camera(source) if _is_camera(source) else _shot(source, limit)
        shown = (f"  {name:<14}{value}" for name, value in rows.items() if value)
        return Outcome(facts, (source, *shown))

    done = _verify(jobs, limit, console) if arguments.verify else run_jobs(jobs, work, console)
    return done or failed


def _is_camera(source: str) -> bool:
    return source.lower().endswith(".json")


def _verify(jobs: Sequence[Job], max_pixels: int, console: Console) -> int:
    """Check each file against its own digest, and count those that fail; returns the exit code."""

    def work(job: Job, _: object) -> Outcome:
        if _is_camera(job.source):
            return Outcome({"calibration_id": read_camera(job.source).calibration.id})
        rows, columns = verify_dng(job.source, max_pixels=max_pixels)
        return Outcome({"width": columns, "height": rows, "digest": "shot"})

    with console.progress("verify") as progress:
        results = in_threads(work, jobs, processors(), console.note)
        states = do_jobs(follow(results, jobs, progress), console)
    foreign = f", {states['foreign']} of other programs" if states["foreign"] else ""
    console.say(f"{states['made']} whole, {states['failed']} damaged or unreadable{foreign}")
    return exit_code(states)


def _camera(source: str) -> Contents:
    camera = read_camera(source)
    calibration = camera.calibration
    rows = {
        "sensor": f"{calibration.sensor or 'unnamed'}, calibration {calibration.id}",
        "pattern": _pattern(camera.pattern) if camera.pattern else "unknown",
        **_calibration(calibration),
        "defects": f"{len(calibration.defects)} pixels",
    }
    for name, facts in camera.measured.items():
        rows[f"{name}:"] = ", ".join(f"{fact} {value}" for fact, value in facts.items())
    return {"camera": camera.to_json(), "calibration_id": calibration.id}, rows


def _shot(source: str, max_pixels: int) -> Contents:
    mosaic, preview_bytes = read_dng(source, max_pixels=max_pixels), len(read_preview(source))
    pattern, calibration, metadata = mosaic.pattern, mosaic.calibration, mosaic.metadata
    clear, network = pattern.panchromatic_mask(mosaic.shape), network_for(pattern)
    mean = saturated = None
    luminance = "unknown: no pixel is panchromatic"
    if clear.any():
        mean = float(mosaic.signal[clear].mean(dtype=np.float64))
        saturated = float((mosaic.evenly_shaded().signal[clear] >= calibration.full_scale).mean())
        luminance = f"mean {mean:.3f} scene units, {100 * saturated:.2f} % saturated"
    # A Bayer sensor's pixels see a third of what panchromatic ones do. Filters read 1 where
    # panchromatic pixels read the full scale.
    light = pattern.light_efficiency(3 / calibration.full_scale)
    (height, width), camera = mosaic.shape, calibration.camera
    facts = {
        "width": width,
        "height": height,
        "pattern": {
            "name": pattern.name or None,
            "period": pattern.period,
            "channels": pattern.channels,
            "derived": None if pattern.derived is None else pattern.channels[pattern.derived],
            "letters": pattern.letters_from(),
            "light_efficiency": round(light, 3),
        },
        "learned": network.stem if network else None,
        "bits": calibration.bits,
        "mean_luminance": mean,
        "saturated": saturated,
        "calibration": calibration.to_json(),
        "calibration_id": calibration.id,
        "metadata": asdict(metadata) | {"taken": metadata.taken and metadata.taken.isoformat()},
        "preview_bytes": preview_bytes,
        "digest": "shot",
    }
    rows = {
        "size": f"{width} x {height} pixels; samples match their digest",
        "pattern": _pattern(pattern),
        "light": f"{light:.2f} times that of a Bayer sensor",
        "network": network.stem if network else "none for this pattern: rendered without",
        "luminance": luminance,
        **_calibration(calibration),
        "sensor": f"{calibration.sensor or 'unnamed'}, calibration {calibration.id}",
        "camera file": camera,
        "preview": f"JPEG, {preview_bytes / 1000:.0f} kB" if preview_bytes else "removed",
        **_capture(metadata),
    }
    return facts, rows


def _pattern(pattern: CfaPattern) -> str:
    name = f"{pattern.name}, " if pattern.name else ""
    text = f"{name}{pattern.channels} period {pattern.period}: {'/'.join(pattern.letters_from())}"
    if pattern.derived is not None:
        text += f"; {pattern.channels[pattern.derived]} is what W sees beyond the others"
    return text


def _calibration(calibration: SensorCalibration) -> dict[str, str]:
    """Rows that shots and camera files share."""
    lights, neutral, noise = calibration.lights or (), "unknown", "unknown"
    colour = "calibrated" if calibration.camera_to_xyz else "no matrix"
    if calibration.noise:
        shot, read = _values(calibration.noise.shot), _values(calibration.noise.read)
        noise = f"variance = {shot} x signal + ({read})^2, scene units"
    if calibration.neutral:
        estimated = ", estimated from the picture" if calibration.neutral_estimated else ""
        neutral = _values(calibration.neutral) + estimated
    black, bits = _values(calibration.black_level), calibration.bits
    rows = {
        "levels": f"black {black}, white {calibration.white_level} ({bits} bits)",
        "gamma": f"{_values(calibration.gamma)}  ({calibration.channels})",
        "noise": noise,
        "colour": f"{colour} under two lights" if lights else colour,
        "neutral": neutral,
    }
    for light in lights:
        matrix = " / ".join(map(_values, light.camera_to_xyz))
        rows[f"  {light.illuminant}"] = f"{matrix}; white {_values(light.neutral)}"
    if calibration.shading:
        rows["shading"] = f"{calibration.shading.words}; undone"
    return rows


def _capture(metadata: CaptureMetadata) -> dict[str, str]:
    """Rows for the known capture data, with units."""
    known = [(name, value) for name, value in vars(metadata).items() if value is not None]
    rows = {name.replace("_", " "): f"{value}{_UNITS.get(name, '')}" for name, value in known}
    if metadata.exposure_time and metadata.exposure_time < 0.4:
        rows["exposure time"] = f"1/{1 / metadata.exposure_time:.0f} s"
    return rows


def _values(values: Sequence[float]) -> str:
    """The values; a single one where all are equal."""
    distinct = values[:1] if len(set(values)) == 1 else values
    return " ".join(f"{value:.6g}" for value in distinct)
