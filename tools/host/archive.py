"""Verify that shots, rendered DNGs and camera files are undamaged: single files and whole folders, several files at a time."""

import os
import stat
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from shared import read_camera
from shared.dng import verify_dng
from shared.errors import InputError

from .console import Console
from .jobs import fail, file_status, reason

_SUFFIX = ".dng"


def verify(sources: Sequence[str], console: Console, *, jobs: int, max_pixels: int) -> int:
    """Check each file against its own digest and report those that are damaged or cannot be read. Returns their number.

    sources: files, and folders with all DNGs in them and below.
    console: for lines, records and progress.
    jobs: number of files checked at the same time.
    max_pixels: larger files count as damaged.
    """
    files = list(dict.fromkeys(file for source in sources for file in _files(source)))
    damaged: list[str] = []
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
                    console.record(source=file, ok=True, **facts)
        finally:
            pool.shutdown(cancel_futures=True)  # whoever interrupts does not wait for a whole archive
    count = f"{len(files) - len(damaged) - len(unread)} whole, {len(damaged)} damaged"
    console.say(count + (f", {len(unread)} that cannot be read" if unread else ""), *(f"  {file}" for file in (*damaged, *unread)))
    return len(damaged) + len(unread)


def _readable(file: str) -> bool:
    """Whether there is such a file, and it can be opened: otherwise nothing is known about damage."""
    status = file_status(file)
    return status is not None and stat.S_ISREG(status.st_mode) and os.access(file, os.R_OK)


def _files(source: str) -> Iterator[str]:
    """The file itself, or the DNGs in a folder and below, in order. A folder that cannot be read is an error, not left out."""
    if not Path(source).is_dir():
        yield source
        return

    def stop(error: OSError) -> None:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})")

    found = False
    for folder, below, names in os.walk(source, onerror=stop):
        below.sort()
        for name in sorted(names):
            if name.lower().endswith(_SUFFIX) and not name.startswith("."):
                found = True
                yield os.path.join(folder, name)  # noqa: PTH118  keeps the folder as the user wrote it: pathlib drops "./"
    if not found:
        raise InputError(f"{source}: no DNG in this folder or below")


def _checked(file: str, max_pixels: int) -> tuple[dict[str, Any], str]:
    """Facts about an undamaged file, and what is wrong with a damaged one ("" = nothing)."""
    try:
        if file.lower().endswith(".json"):
            return {"calibration_id": read_camera(file).calibration.id}, ""
        rows, columns = verify_dng(file, max_pixels=max_pixels)
        return {"width": columns, "height": rows}, ""
    except Exception as error:  # one odd file must not end the check of the others
        return {}, reason(error)
