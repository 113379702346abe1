"""A dask scheduler and its workers, all on this machine."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.data import ROOT

SOURCE = ROOT / "tools" / "notebook"  # where the package `panchroma` is


@contextmanager
def cluster(folder: Path, count: int) -> "Iterator[tuple[str, list[subprocess.Popen[bytes]]]]":
    """The scheduler's address and `count` workers, which end with the block."""
    with ExitStack() as stack:
        address, _ = stack.enter_context(scheduler(folder))
        yield (
            address,
            [stack.enter_context(worker(folder, address, str(number))) for number in range(count)],
        )


@contextmanager
def scheduler(folder: Path) -> "Iterator[tuple[str, subprocess.Popen[bytes]]]":
    """A scheduler's address, and the scheduler, which ends with the block. folder: for its file."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    options = ("--port", "0", "--no-dashboard", "--no-show", "--scheduler-file", file)
    with _process("dask_scheduler", *options, source=SOURCE) as running:
        deadline = time.monotonic() + 60
        while not (file.exists() and file.read_text()) and time.monotonic() < deadline:
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], running


@contextmanager
def worker(
    folder: Path, address: str, name: str, source: Path = SOURCE
) -> "Iterator[subprocess.Popen[bytes]]":
    """A worker of the scheduler at `address`; it ends with the block.

    It has one process and one thread, and is not started again when it dies: it has none of dask's
    nanny processes (`--no-nanny`).

    folder: for its files.
    source: the folder with the packages that it imports.
    """
    options = (
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
        "--local-directory",
        folder / "dask",
        "--name",
        name,
    )
    with _process("dask_worker", address, *options, source=source) as running:
        yield running


@contextmanager
def _process(
    program: str, *arguments: str | Path, source: Path
) -> "Iterator[subprocess.Popen[bytes]]":
    """A program of dask that sees this source and only this machine."""
    line = [sys.executable, "-m", f"distributed.cli.{program}", *arguments, "--host", "127.0.0.1"]
    environment = {
        **os.environ,
        "PYTHONPATH": str(source),
        "DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH": "0",
    }
    running = subprocess.Popen(
        line, cwd=source, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield running
    finally:
        running.kill()
        running.wait()
