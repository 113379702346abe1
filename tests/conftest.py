"""For all tests: signals do what they do in a terminal, a disk can be full, and libraries compute in one thread.

A shell that runs the tests in the background has them ignore SIGINT, nohup SIGHUP, and their children too.

NumPy's OpenBLAS otherwise has a thread per processor, which take turns in waiting, at full speed, for each other: with a test on
every processor a small fit takes 25 times as long.
"""

import errno
import itertools
import os
import signal
from collections.abc import Callable

import pytest

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """A function after whose call the next `times` calls of os.fsync, by default all, fail with the error `number`."""

    def fill(number: int = errno.ENOSPC, times: float = float("inf")) -> None:
        fsync, calls = os.fsync, itertools.count()

        def full(descriptor: int) -> None:
            if next(calls) < times:
                raise OSError(number, os.strerror(number))
            fsync(descriptor)

        monkeypatch.setattr(os, "fsync", full)

    return fill
