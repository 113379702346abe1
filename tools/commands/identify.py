"""Find out which pattern of colour filters a sensor has, from one raw frame of a scene with light
and colours.

FILE is a shot, a DNG or camera RAW of any maker, a grey TIFF, PNG or NPY with the samples, or, with
--size and --pixel-format, a raw frame or stream (- is standard input), of which the first frame
counts. Sites with one filter read the same in every scene, and panchromatic ones (W) are the
brightest. Which of two colours is red and which is blue only a picture of something known tells.
Filters for C, M and Y have the letters G, R and B: put their own in place of those.
"""

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from ...shared import CodeArray, InputError
from ...shared.pattern import PANCHROMATIC
from ...shared.writing import write_durably
from ..batch.console import Console
from ..batch.folders import Source, once, plan
from ..batch.jobs import Job, Outcome, output_folder, run_jobs
from ..capture.frame_source import STREAM, SourceOptions, first_frame
from ..capture.identity import UNKNOWN, facts_of
from ..capture.layouts import likely_reading
from ..io.camera_raw import NO_RAW
from ..io.illustrations import tile_map
from ..simulation.load import sensor_samples
from .frame_options import add_layout, options_of
from .options import add, pixel_limit

USAGE = "FILE ..."
EXAMPLE = "panchroma identify frame.raw --size 4056x3040 --pixel-format SRGGB12_CSI2P --stride 6112"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma identify`."""
    files = "a raw frame: shot, DNG, camera RAW, grey TIFF or PNG, raw stream"
    parser.add_argument("files", metavar="FILE", nargs="+", help=files)
    add_layout(parser, "files without a header (rpicam-raw prints all this when it starts)")
    shown = "how bright each site of the tile is, and its letter"
    picture = f"folder for NAME-tile.png: {shown}; created if missing"
    add(parser, "output", required=False, help=picture)
    add(parser, "overwrite", "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Identify the pattern of each file; returns the exit code."""

    def work(job: Job, _: object) -> Outcome:
        options = options_of(arguments, job.source)
        described = options != SourceOptions(job.source) or job.source == STREAM
        hint = "size, format or stride may be another" if described else ""
        data, layout = first_frame(options) if described else (b"", None)
        codes = layout.unpack(data) if layout else _in_file(job.source, pixel_limit())

        def likely() -> str:
            return "; " + (likely_reading(data, layout) or hint) if layout else ""

        try:
            facts = facts_of(codes)
        except InputError as error:
            raise InputError(f"{error}{likely()}") from None
        errors = []
        if facts["name"] is None:
            own = "if it is the sensor's own, put its letters in place of those found"
            unnamed = f"the tile has no name that Panchroma knows; {own}"
            errors.append(f"{job.source}: {unnamed}{likely()}")
        rows = _rows(facts)
        if job.outputs:
            picture = tile_map(facts["letters"], np.array(facts["light"]))
            write_durably(job.output, picture, overwrite=arguments.overwrite)
            facts["output"] = str(job.output)
            rows.append(("picture", facts["output"]))
        lines = (f"  {name:<14}{value}" for name, value in rows)
        return Outcome(facts, (job.source, *lines), tuple(errors))

    sources = once(Source(name) for name in arguments.files)
    jobs = [Job(source.name) for source in sources]
    if arguments.output is not None:
        folder = output_folder(arguments.output)
        jobs = plan(sources, lambda name: [f"{Path(name).stem}-tile.png"], folder, dry_run=False)
    return run_jobs(jobs, work, console, overwrite=arguments.overwrite)


def _in_file(source: str, max_pixels: int) -> CodeArray:
    try:
        return sensor_samples(Path(source), max_pixels)
    except InputError as error:
        is_unknown = str(error).startswith(NO_RAW.partition("{")[0])
        more = "; a frame without a header needs --size and --pixel-format" * is_unknown
        raise InputError(f"{error}{more}") from None


def _rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """The facts as the rows of a table for people."""
    first, *others = facts["letters"]
    period = facts["period"]
    rows = [
        ("period", f"{period} pixels, {facts['certainty']:.0f} standard errors from chance"),
        ("panchromatic", f"{len(facts['panchromatic'])} of {period**2} sites"),
        ("letters", f"{first}   from the first pixel on"),
        *(("", row) for row in others),
        ("name", facts["name"] or "none that Panchroma knows"),
    ]
    if UNKNOWN in "".join(facts["letters"]):
        doubts = "perhaps the period, and whether the brightest sites are clear"
        unknown = f"the colours (?), and {doubts}: take a picture with more colour or light"
        return [*rows, ("not known", unknown)]
    if facts["pattern"] is None:
        reason = "none of its pixels is panchromatic, or a colour site is too far from those"
        return [*rows, ("go on", f"Panchroma cannot use this tile: {reason}")]
    counts = Counter("".join(facts["letters"]).replace(PANCHROMATIC, "")).values()
    if len({*counts}) < len(counts):
        unknown = "which of the colours with equally many sites is which"
        rows.append(("not known", f"{unknown}: a picture of something red shows it"))
    for number, (name, origin) in enumerate([facts["pattern"], *facts["alternatives"]]):
        options = f"--pattern {name} --origin {origin[0]},{origin[1]}"
        rows.append(("or" if number else "go on", options))
    return rows
