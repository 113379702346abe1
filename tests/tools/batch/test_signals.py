"""Signals that end a program, in order. What a command in the middle of its work does: see
tests/faults.
"""

import ctypes
import os
import signal
import time
from contextlib import suppress

import pytest

from panchroma.tools.batch.console import Console
from panchroma.tools.batch.jobs import Job, Outcome, run_jobs
from panchroma.tools.batch.progress import StageProgress
from panchroma.tools.batch.signals import Terminated, orderly_end
from tests.tools.command import spawn


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_becomes_an_interruption_with_its_code(number: signal.Signals, code: int) -> None:
    before = signal.getsignal(number)
    with pytest.raises(Terminated) as caught, orderly_end():
        os.kill(os.getpid(), number)
    assert caught.value.code == code
    assert isinstance(caught.value, KeyboardInterrupt)
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("imported", [False, True])
def test_a_signal_that_is_swallowed_ends_the_run_before_the_next_file(imported: bool) -> None:
    """An import of a C extension turns it into an error."""
    begun = []

    def work(job: Job, listener: StageProgress) -> Outcome:
        begun.append(job.source)
        with suppress(Terminated):
            os.kill(os.getpid(), signal.SIGTERM)
        if imported:
            raise ImportError("initialization failed")
        return Outcome()

    with pytest.raises(Terminated), orderly_end():
        run_jobs([Job("one", ()), Job("two", ())], work, Console())
    assert begun == ["one"]
    with pytest.raises(ImportError), orderly_end():  # the next run starts without it
        raise ImportError


def test_a_signal_inside_a_callback_from_c_is_not_lost() -> None:
    callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(Terminated), orderly_end():  # noqa: PT012
        callback()
        time.sleep(10)


def test_who_has_decided_otherwise_is_obeyed() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with orderly_end():
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_program_leaves_shows_nothing(number: signal.Signals) -> None:
    """After its work: while threads are joined, and modules are taken down."""
    script = f"""
import signal
from panchroma.tools.batch.signals import orderly_end
signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever the program that runs the tests had
with orderly_end(last=True):
    pass
signal.raise_signal({int(number)})  # in this thread: another one may get that of `os.kill` after the end
raise SystemExit(0)
"""
    assert spawn(script=script, code=128 + number).err == ""
