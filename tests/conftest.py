"""For all tests: signals do what they do in a terminal, and a disk can be full.

A shell that runs the tests in the background has them ignore SIGINT, nohup SIGHUP, and their children too.
"""

import errno
import itertools
import os
import signal
from collections.abc import Callable

import pytest

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


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
