"""How many processors there are for this process, and how many threads renders and previews are to use."""

import os
import threading

THREADS = "PANCHROMA_THREADS"
"""Environment variable: the number of threads of renders and previews for which the program sets none."""


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Chosen(threading.local):
    count = 0  # none chosen


chosen = _Chosen()
"""What `use_threads` has set in this thread."""


def available_threads() -> int:
    """The number of threads that are used where `use_threads` was not called: PANCHROMA_THREADS, or one per processor.

    >>> from shared.processors import available_threads
    >>> available_threads() >= 1
    True
    """
    asked = os.environ.get(THREADS, "")
    return int(asked) if asked.isdecimal() and int(asked) > 0 else processors()


def threads() -> int:
    """The number of threads that stages and previews called from this thread use.

    >>> from shared.processors import threads
    >>> threads() >= 1
    True
    """
    return chosen.count or available_threads()


def use_threads(count: int) -> None:
    """Set the number of threads for stages and previews called from this thread, 1 or more. The result is the same for any.

    For programs: libraries should leave this choice to them. Raises ValueError for less than 1.

    >>> from shared.processors import threads, use_threads
    >>> before = threads()
    >>> use_threads(1)
    >>> threads()
    1
    >>> use_threads(before)
    """
    if count < 1:
        raise ValueError(f"the number of threads is {count}; it has to be 1 or more")
    chosen.count = count
