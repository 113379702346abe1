"""Number of processors that this process may use, and of threads that renders and previews are
to use.

A container, a batch system or systemd states its limits in control groups (Linux, version 2).
"""

import os
import threading
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path, PurePosixPath

from .errors import InputError

THREADS = "PANCHROMA_THREADS"
"""Environment variable: the number of threads of renders and previews for which the program sets
none.
"""


def processors() -> int:
    """Number of processors that this process may use: by its affinity, and by the time that its
    control groups get.
    """
    affinity = getattr(os, "sched_getaffinity", None)  # macOS has none
    usable = len(affinity(0)) if affinity else os.cpu_count() or 1
    return min(usable, _quota() or usable)


@cache
def _quota() -> int | None:
    """Processors that the least quota of the control groups is enough for, rounded up; None without
    a quota.
    """
    quotas = []
    for group in control_groups():
        with suppress(OSError, ValueError):  # no such file, or "max"
            quota, period = map(int, (group / "cpu.max").read_text(encoding="ascii").split())
            quotas.append(-(-quota // period))
    return min(quotas, default=None)


class _Chosen(threading.local):
    count = 0  # none chosen


chosen = _Chosen()
"""The number that `use_threads` has set in this thread."""


def available_threads() -> int:
    """The number of threads that are used where `use_threads` was not called: PANCHROMA_THREADS, or
    one per processor.

    Raises
    ------
    InputError
        When the variable is no such number.

    Examples
    --------
    >>> from panchroma.shared.processors import available_threads
    >>> available_threads() >= 1
    True
    """
    asked = os.environ.get(THREADS)
    if not asked:
        return processors()
    if not (asked.isdecimal() and int(asked) > 0):
        raise InputError(f"{THREADS} is {asked!r}, expected a number from 1 on; change or unset it")
    return int(asked)


def threads() -> int:
    """The number of threads that stages and previews called from this thread use.

    Examples
    --------
    >>> from panchroma.shared.processors import threads
    >>> threads() >= 1
    True
    """
    return chosen.count or available_threads()


def use_threads(count: int) -> None:
    """Set the number of threads for stages and previews called from this thread, 1 or more. The
    result is the same for any.

    For programs: libraries should leave this choice to them.

    Raises
    ------
    ValueError
        For less than 1.

    Examples
    --------
    >>> from panchroma.shared.processors import threads, use_threads
    >>> before = threads()
    >>> use_threads(1)
    >>> threads()
    1
    >>> use_threads(before)
    """
    if count < 1:
        raise ValueError(f"the number of threads is {count}; it has to be 1 or more")
    chosen.count = count


_MEMBERSHIP = Path("/proc/self/cgroup")
_MOUNT = Path("/sys/fs/cgroup")


def control_groups() -> Iterator[Path]:
    """Yield the folders of the groups whose limits may hold for this process: its own and all above
    it.

    In a container the mount point may be the process's own group. Source: Linux,
    admin-guide/cgroup-v2.rst.
    """
    yield _MOUNT
    with suppress(OSError, ValueError):
        lines = _MEMBERSHIP.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
        for path in (PurePosixPath(line[3:]) for line in lines if line.startswith("0::/")):
            below = path.relative_to("/")
            if ".." not in below.parts:  # in a namespace the group may lie outside of the mount
                yield from (_MOUNT / group for group in (below, *below.parents))


def number_in(file: Path) -> int | None:
    """The number in a file of a control group; None for "max", and where there is no such file."""
    with suppress(OSError, ValueError):
        return int(file.read_text(encoding="ascii"))
    return None
