"""Render shots at full quality: one, or all in and below folders, by as many processes as processors and memory allow.

With --bits 32 --space camera the result is float32 in scene units, unclipped: it can be subtracted from a truth of `simulate`. All
other results are for looking at: white-balanced, with an ICC profile and the capture data. DIR/.panchroma-journal.jsonl records
what each picture was made from; with --resume an interrupted run continues, and pictures of changed shots are brought up to date.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from shared.errors import InputError
from shared.writing import sweep
from tools.batch.compilation import limit_threads
from tools.batch.console import Console
from tools.batch.folders import DNGS, plan, search
from tools.batch.jobs import FAILED, Job, counted, do_jobs, possible_jobs
from tools.batch.memory import share_one_heap
from tools.batch.order import Order
from tools.batch.progress import StageProgress
from tools.batch.run import Pass, passes, scheduled_passes, shard_of

from .options import add, add_shots, option, uses_scheduler, value
from .picture_options import add_picture, add_run, order_fields


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma render`."""
    add_shots(parser)
    add(parser, "output", files="STEM.EXT (subfolders are kept)")
    add_picture(parser, "best", "unlearned", "paper")
    group = add_run(parser)
    expected = "a part and their number, such as 3/8; parts are counted from 1"
    shard = value(_shard, expected, lambda found: 1 <= found[0] <= found[1])
    option(group, "--shard I/N", "render only part I of N, counted from 1 (default: all)", type=shard, default=(1, 1))
    add(group, "workers", things="processes", usual="1, or for many shots what cores and memory allow")
    add(group, "scheduler", "scheduler-file")
    add(parser, "json", each="shot")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Render the shots; returns the exit code."""
    share_one_heap()
    limit_threads(arguments.threads)
    elsewhere = uses_scheduler(arguments)
    if arguments.workers is not None and elsewhere:
        raise InputError("--workers cannot be used with a scheduler, which has its own workers")
    part, parts = arguments.shard
    order = Order(**order_fields(arguments))
    found = search(arguments.shots, DNGS, output=order.folder)
    searched = found.report(console)
    jobs, all_possible = possible_jobs(
        plan(
            found.sources,
            lambda source: [f"{Path(source).stem}{order.kind.suffix}"],
            order.folder,
            dry_run=order.dry_run,
        ),
        console,
        overwrite=order.overwrite or order.resume,
        wanted=lambda job: shard_of(order.name(job.output), parts) == part,
    )
    if elsewhere and not order.dry_run:
        all_made = _made_elsewhere(order, jobs, arguments, console)
    else:
        workers = 1 if order.dry_run else arguments.workers
        through = passes(order, jobs, console, workers=workers, threads=arguments.threads, memory=arguments.max_memory)
        all_made = _made(jobs, through, console)
    return 0 if all_made and all_possible and searched else FAILED


def _shard(text: str) -> tuple[int, int]:
    part, parts = map(int, text.split("/"))
    return part, parts


def _made(jobs: Sequence[Job], through: Sequence[Pass], console: Console) -> bool:
    """Make the pictures, and count them if there are several. Returns whether none has failed."""
    several = len(jobs) > 1
    with console.progress("render") if several else StageProgress() as progress:
        states = do_jobs(jobs, through, console, progress)
    if several:
        console.note(counted(states))
    return not states["failed"]


def _made_elsewhere(order: Order, jobs: Sequence[Job], arguments: argparse.Namespace, console: Console) -> bool:
    """Whether the workers of a scheduler have made all pictures."""
    from tools.batch.cluster import SchedulerGoneError, connected

    try:
        with connected(arguments.scheduler, arguments.scheduler_file) as client:
            through = scheduled_passes(order, client, arguments.threads, arguments.max_memory, console.note)
            return _made(jobs, through, console)
    except SchedulerGoneError as error:
        console.error(f"{error}, with --resume")
        return False
    finally:
        for below in {job.output.parent for job in jobs}:  # of workers that were killed
            sweep(below)
