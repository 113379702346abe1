"""A dask scheduler and its workers, all on this machine."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests.data import ROOT


@contextmanager
def cluster(folder: Path, count: int) -> "Iterator[tuple[Path, list[subprocess.Popen[bytes]]]]":
    """The scheduler's file and `count` workers, which end with the block.

    A worker has one process and one thread, and is not started again when it dies: it has none of dask's nanny processes
    (`--no-nanny`).
    """
    file = folder / "scheduler.json"
    options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", folder / "dask")
    with ExitStack() as stack:
        stack.enter_context(_process("dask_scheduler", "--port", "0", "--no-dashboard", "--no-show", "--scheduler-file", file))
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        workers = [_process("dask_worker", "--scheduler-file", file, "--name", str(number), *options) for number in range(count)]
        yield file, [stack.enter_context(worker) for worker in workers]


@contextmanager
def _process(program: str, *arguments: str | Path) -> "Iterator[subprocess.Popen[bytes]]":
    """A program of dask that sees this source and only this machine."""
    line = [sys.executable, "-m", f"distributed.cli.{program}", *arguments, "--host", "127.0.0.1"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH": "0"}
    running = subprocess.Popen(line, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield running
    finally:
        running.kill()
        running.wait()
