"""Signals that end a program, in order. What a command in the middle of its work does: see tests/faults."""

import os
import signal
import threading
from typing import Any

import pytest

from tools.host.console import Console
from tools.host.jobs import Job, run_jobs
from tools.host.signals import Terminated, orderly_end


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_becomes_an_interruption_with_its_code(number: signal.Signals, code: int) -> None:
    before = signal.getsignal(number)
    with pytest.raises(Terminated) as caught, orderly_end():
        os.kill(os.getpid(), number)
    assert caught.value.code == code
    assert isinstance(caught.value, KeyboardInterrupt)
    assert signal.getsignal(number) == before


def test_a_signal_that_an_import_turns_into_an_error_still_ends_the_run() -> None:
    begun = []

    def work(job: Job) -> dict[str, Any]:
        begun.append(job.source)
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        except Terminated:
            raise ImportError("initialization failed") from None
        return {}

    with pytest.raises(Terminated), orderly_end():
        run_jobs([Job("one", ()), Job("two", ())], work, Console())
    assert begun == ["one"]
    with pytest.raises(ImportError), orderly_end():  # the next run starts without it
        raise ImportError


def test_who_has_decided_otherwise_is_obeyed() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with orderly_end():
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_another_thread_changes_nothing() -> None:
    seen = []

    def run() -> None:
        with orderly_end():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGTERM)]
