"""How many threads libraries may start."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from shared.processors import THREADS

# Numerical libraries read these when they are loaded, and not again.
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", THREADS, "OPENCV_FOR_THREADS_NUM")


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Processes started in the `with` block give each numerical library `count` threads."""
    before = {name: os.environ[name] for name in THREAD_VARIABLES if name in os.environ}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(count)))
    try:
        yield
    finally:
        for name in THREAD_VARIABLES:
            os.environ.pop(name, None)
        os.environ.update(before)
