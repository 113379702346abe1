"""How many processors there are for this process."""

import os

THREADS = "PANCHROMA_THREADS"
"""Environment variable: the number of threads of a renderer for which the program sets none."""


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
