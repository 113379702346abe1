"""Verify that shots, rendered DNGs and camera files are undamaged, several files at a time."""

import os
import stat
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from shared import read_camera
from shared.dng import verify_dng

from .console import Console
from .jobs import fail, file_status, reason

_EARLIER = "were saved by an earlier version: their digests do not cover the size, nor that samples and calibration belong together"


def verify(sources: Sequence[str], console: Console, *, jobs: int, max_pixels: int) -> int:
    """Check each file against its own digest and report those that are damaged or cannot be read. Returns their number.

    sources: files; one that is named twice is checked once.
    console: for lines, records and progress.
    jobs: number of files checked at the same time.
    max_pixels: larger files count as damaged.
    """
    files = list(dict.fromkeys(sources))
    damaged: list[str] = []
    earlier = 0
    unread: list[str] = []
    with ThreadPoolExecutor(jobs) as pool, console.progress("verifying") as progress:
        try:
            progress.begin(len(files))
            for file, (facts, wrong) in zip(files, pool.map(partial(_checked, max_pixels=max_pixels), files), strict=True):
                progress.advance()
                progress.remark(f"{len(damaged)} damaged")
                if wrong:
                    (damaged if _readable(file) else unread).append(file)
                    fail(file, (), wrong, console)
                else:
                    earlier += facts.get("digest") == "samples"
                    console.record(source=file, ok=True, **facts)
        finally:
            pool.shutdown(cancel_futures=True)  # whoever interrupts does not wait for a whole archive
    count = f"{len(files) - len(damaged) - len(unread)} whole, {len(damaged)} damaged"
    console.say(count + (f", {len(unread)} that cannot be read" if unread else ""), *(f"  {file}" for file in (*damaged, *unread)))
    if earlier:
        console.say(f"{earlier} of the whole files {_EARLIER}")
    return len(damaged) + len(unread)


def _readable(file: str) -> bool:
    """Whether there is such a file, and it can be opened: otherwise nothing is known about damage."""
    status = file_status(file)
    return status is not None and stat.S_ISREG(status.st_mode) and os.access(file, os.R_OK)


def _checked(file: str, max_pixels: int) -> tuple[dict[str, Any], str]:
    """Facts about an undamaged file, and what is wrong with a damaged one ("" = nothing)."""
    try:
        if file.lower().endswith(".json"):
            return {"calibration_id": read_camera(file).calibration.id}, ""
        found = verify_dng(file, max_pixels=max_pixels)
        return {"width": found.shape[1], "height": found.shape[0], "digest": found.digest}, ""
    except Exception as error:  # one odd file must not end the check of the others
        return {}, reason(error)
