"""Work in a process of its own."""

import os
import signal
import sys

import pytest

from shared.errors import InputError
from tools.host.isolated import memory_now, peak_memory, run_isolated


def about(word: str, times: int = 1) -> tuple[int, str]:
    return os.getpid(), word * times


def refuses() -> None:
    raise InputError("no such thing")


def dies() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def loaded() -> bool:
    return "numpy" in sys.modules


def takes(size: int) -> tuple[int, int, int]:
    before = peak_memory()
    block = bytearray(os.urandom(1000)) * (size // 1000)
    full = memory_now()
    del block
    return before, full, peak_memory()


def test_it_is_done_elsewhere() -> None:
    number, text = run_isolated(about, "a", times=3)
    assert text == "aaa"
    assert number != os.getpid()


def test_an_error_comes_back() -> None:
    with pytest.raises(InputError, match="no such thing"):
        run_isolated(refuses)


def test_a_killed_process_is_an_error_that_says_so() -> None:
    with pytest.raises(InputError, match=r"was killed, most likely for want of memory; use fewer --megapixels"):
        run_isolated(dies)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere a process tells its peak alone")
def test_memory_is_the_processs_own() -> None:
    """This one is larger than the new one ever gets."""
    large = bytearray(os.urandom(1000)) * 300_000
    before, full, peak = run_isolated(takes, 100_000_000)
    assert before < len(large)
    assert 90e6 < full - before < 130e6
    assert abs(peak - full) < 10e6  # the system counts in lots of pages, not page by page
