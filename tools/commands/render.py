"""Render shots at full quality: one, or all in and below folders, by as many processes as
processors and memory allow.

With --bits 32 --space camera the result is float32 in scene units, unclipped: it can be subtracted
from a truth of `simulate`. All other results are for looking at: white-balanced, with an ICC
profile and the capture data. DIR/.panchroma-journal.jsonl records what each picture was made from;
with --resume an interrupted run continues, and pictures of changed shots are brought up to date.
"""

import argparse
from pathlib import Path

from ..batch.console import Console
from ..batch.folders import DNGS, plan, search
from ..batch.order import Order
from ..batch.run import render_all
from .options import add, add_pictures, add_shots, order_fields

USAGE = "SHOT ... -o DIR"
EXAMPLE = "panchroma render shots -o pictures -f jpg --exposure 0.5"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma render`."""
    add_shots(parser)
    add(parser, "output", help="folder for STEM.EXT (subfolders are kept), created if missing")
    group = add_pictures(parser, "best", "unlearned", "paper")
    jobs = "processes at a time (default: 1, or for many shots what cores and memory allow)"
    add(group, "jobs", help=jobs)
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Render the shots; returns the exit code."""
    order = Order(**order_fields(arguments))
    files = search(arguments.shots, DNGS, output=order.folder)
    failed = files.report(console)

    def names(source: str) -> list[str]:
        return [f"{Path(source).stem}{order.kind.suffix}"]

    shots = plan(files.sources, names, order.folder, dry_run=order.dry_run)
    code = render_all(order, shots, console, jobs=arguments.jobs, memory=arguments.max_memory)
    return code or failed
