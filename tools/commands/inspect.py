"""Show what is in shots (pattern, levels, calibration, capture data) and in camera files.

Reading compares a shot's samples with their digest, and checks every field of a camera file.
--verify does this for whole archives.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ...shared import Mosaic, Shading, read_camera, read_dng
from ...shared.dng import read_preview, verify_dng
from ...shared.networks import network_for
from ...shared.processors import processors
from ..batch.console import Console
from ..batch.folders import DNGS, search
from ..batch.jobs import FAILED, Job, Outcome, do_jobs, run_jobs
from ..batch.parallel import follow, in_threads
from ..batch.progress import StageProgress
from .options import add, add_shots, pixel_limit

Rows = list[tuple[str, str]]
"""Names and values of a table for people."""

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
    searched = files.report(console)
    jobs = [Job(source.name, from_folder=source.from_folder) for source in files.sources]
    code = (_verify if arguments.verify else _show)(jobs, limit, console)
    return code if searched else FAILED


def _show(jobs: Sequence[Job], max_pixels: int, console: Console) -> int:
    """Show what is in each shot or camera file; returns the exit code."""

    def work(job: Job, listener: StageProgress) -> Outcome:
        source = job.source
        facts, rows = _camera(source) if _is_camera(source) else _shot(source, max_pixels)
        return Outcome(facts, (source, *(f"  {name:<14}{value}" for name, value in rows)))

    return run_jobs(jobs, work, console)


def _is_camera(source: str) -> bool:
    return source.lower().endswith(".json")


def _shot(source: str, max_pixels: int) -> tuple[dict[str, Any], Rows]:
    """Return the contents of a shot, for machines and for people."""
    facts = _facts(read_dng(source, max_pixels=max_pixels), len(read_preview(source)))
    return facts, _rows(facts)


def _verify(jobs: Sequence[Job], max_pixels: int, console: Console) -> int:
    """Check each file against its own digest, and count those that fail; returns the exit code."""

    def work(job: Job, listener: StageProgress) -> Outcome:
        if _is_camera(job.source):
            return Outcome({"calibration_id": read_camera(job.source).calibration.id})
        rows, columns = verify_dng(job.source, max_pixels=max_pixels)
        return Outcome({"width": columns, "height": rows, "digest": "shot"})

    jobs = list({job.source: job for job in jobs}.values())  # one named twice is checked once
    with console.progress("verify") as progress:
        results = in_threads(work, jobs, processors(), console.note)
        states = do_jobs(follow(results, jobs, progress), console)
    foreign = f", {states['foreign']} of other programs" if states["foreign"] else ""
    console.say(f"{states['made']} whole, {states['failed']} damaged or unreadable{foreign}")
    return FAILED if states["failed"] else 0


def _camera(source: str) -> tuple[dict[str, Any], Rows]:
    """Return the contents of a camera file, for machines and for people."""
    camera = read_camera(source)
    calibration, pattern, letters = camera.calibration, camera.pattern, "unknown"
    if pattern:
        name = f"{pattern.name}, " if pattern.name else ""
        letters = f"{name}{pattern.channels} period {pattern.period}: "
        letters += " ".join(pattern.letters_from())
    rows = {
        "sensor": f"{calibration.sensor or 'unnamed'}, calibration {calibration.id}",
        "pattern": letters,
        **_calibration(calibration.to_json()),
        "defects": f"{len(calibration.defects)} pixels",
    }
    rows["levels"] += f" ({calibration.bits} bits)"
    for part, facts in camera.measured.items():
        lists = {
            name: value if isinstance(value, list) else [value] for name, value in facts.items()
        }
        rows[f"{part}:"] = ", ".join(" ".join(map(str, [name, *lists[name]])) for name in lists)
    return {"camera": camera.to_json(), "calibration_id": calibration.id}, list(rows.items())


def _facts(mosaic: Mosaic, preview_bytes: int) -> dict[str, Any]:
    pattern, calibration = mosaic.pattern, mosaic.calibration
    clear = pattern.panchromatic_mask(mosaic.shape)
    panchromatic, read = mosaic.signal[clear], mosaic.evenly_shaded().signal[clear]
    metadata, network = mosaic.metadata, network_for(pattern)
    return {
        "width": mosaic.shape[1],
        "height": mosaic.shape[0],
        "pattern": {
            "name": pattern.name or None,
            "period": pattern.period,
            "channels": pattern.channels,
            "derived": None if pattern.derived is None else pattern.channels[pattern.derived],
            "letters": pattern.letters_from(),
            "light_efficiency": round(_light(mosaic), 3),
        },
        "learned": network.stem if network else None,
        "bits": calibration.bits,
        "mean_luminance": float(panchromatic.mean(dtype=np.float64)) if panchromatic.size else None,
        "saturated": float((read >= calibration.full_scale).mean()) if read.size else None,
        "calibration": calibration.to_json(),
        "calibration_id": calibration.id,
        "metadata": asdict(metadata) | {"taken": metadata.taken and metadata.taken.isoformat()},
        "preview_bytes": preview_bytes,
        "digest": "shot",
    }


def _light(mosaic: Mosaic) -> float:
    """Light that the sensor collects, relative to a Bayer sensor, whose pixels see a third of what
    panchromatic ones do.
    """
    pattern, full_scale = mosaic.pattern, mosaic.calibration.full_scale
    if pattern.channels == "RGB":
        return pattern.light_efficiency
    # Filters read 1 where panchromatic pixels read the full scale.
    colour = len(pattern.sites) / pattern.period**2
    return 3 * (1 - colour + colour / full_scale)


def _rows(facts: dict[str, Any]) -> Rows:
    """The facts as the rows of a table for people."""
    pattern, calibration = facts["pattern"], facts["calibration"]
    luminance = "unknown: no pixel is panchromatic"
    if facts["mean_luminance"] is not None:
        saturated = f"{100 * facts['saturated']:.2f} % saturated"
        luminance = f"mean {facts['mean_luminance']:.3f} scene units, {saturated}"
    name = f"{pattern['name']}, " if pattern["name"] else ""
    camera = f", from camera file {calibration['camera']}" if calibration["camera"] else ""
    size = f"{facts['width']} x {facts['height']} pixels, {facts['bits']} bits"
    light = f"{pattern['light_efficiency']:.2f} times the light of a Bayer sensor"
    derived = f"; {pattern['derived']} is what W sees beyond the others" * bool(pattern["derived"])
    sensor = f"{calibration['sensor'] or 'unnamed'}, calibration {facts['calibration_id']}{camera}"
    rows = {
        "network": facts["learned"] or "none for this pattern: rendered without learned colour",
        "luminance": luminance,
        **_calibration(calibration),
        "sensor": sensor,
        "preview": f"JPEG, {facts['preview_bytes'] / 1000:.0f} kB",
        **_capture(facts["metadata"]),
    }
    return [
        ("size", f"{size}; samples match their digest"),
        ("pattern", f"{name}period {pattern['period']}, {light}{derived}"),
        *(("", " ".join(row)) for row in pattern["letters"]),
        *rows.items(),
    ]


def _calibration(document: dict[str, Any]) -> dict[str, str]:
    """Rows that shots and camera files share."""
    lights = document.get("lights", ())
    estimated = ", estimated from the picture" if document.get("neutral_estimated") else ""
    colour = "calibrated" if lights or document["camera_to_xyz"] else "no matrix"
    rows = {
        "levels": f"black {_values(document['black_level'])}, white {document['white_level']}",
        "gamma": f"{_values(document['gamma'])}  ({document['channels']})",
        "noise": _noise(document["noise"]),
        "colour": f"{colour} under two lights" if lights else colour,
    }
    for light in lights:
        matrix = _matrix(light["camera_to_xyz"])
        rows[f"  {light['illuminant']}"] = f"{matrix}; white {_values(light['neutral'])}"
    neutral = _values(document["neutral"]) if document["neutral"] else "unknown"
    rows["neutral"] = neutral + estimated
    if "shading" in document:
        rows["shading"] = f"{Shading(**document['shading']).words}; undone"
    if "aberration" in document:
        rows["aberration"] = "lateral chromatic aberration of an earlier version; ignored"
    return rows


def _capture(metadata: dict[str, Any]) -> dict[str, str]:
    """Rows for the known capture data, with units."""
    seconds = metadata["exposure_time"]
    texts = ("make", "model", "lens", "artist", "copyright", "description")
    place, altitude = metadata["place"], metadata["altitude"]
    rows = {
        **{name: metadata[name] for name in texts},
        "taken": metadata["taken"] and f"{metadata['taken']}{metadata['zone']}",
        "place": place and "{:.6f}, {:.6f} (latitude, longitude)".format(*place),
        "altitude": altitude is not None and f"{altitude:g} m",
        "exposure": seconds and (f"1/{1 / seconds:.0f} s" if seconds < 0.4 else f"{seconds:g} s"),
        "aperture": metadata["f_number"] and f"f/{metadata['f_number']:g}",
        "ISO": metadata["iso"] and f"{metadata['iso']}",
        "focal length": metadata["focal_length"] and f"{metadata['focal_length']:g} mm",
        "orientation": metadata["orientation"] != 1 and f"{metadata['orientation']} (of TIFF)",
    }
    return {name: value for name, value in rows.items() if value}


def _noise(noise: dict[str, Any] | None) -> str:
    if noise is None:
        return "unknown"
    if not any(noise["shot"]):
        return f"sigma {_values(noise['read'])} scene units"
    shot, read = _values(noise["shot"]), _values(noise["read"])
    return f"variance = {shot} x signal + ({read})^2, scene units"


def _matrix(rows: Sequence[Sequence[float]]) -> str:
    return " / ".join(" ".join(f"{value:+.4f}" for value in row) for row in rows)


def _values(values: tuple[float, ...]) -> str:
    """The values; a single one where all are equal."""
    distinct = values[:1] if len(set(values)) == 1 else values
    return " ".join(f"{value:.6g}" for value in distinct)
