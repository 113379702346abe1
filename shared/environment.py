"""A variable of the environment that is set for a moment: for a library that reads it when it is
imported, or for programs that start meanwhile.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def environment(name: str, value: str | None) -> Iterator[None]:
    """Set a variable of the environment in the `with` block, or remove it (None)."""
    before = os.environ.pop(name, None)
    if value is not None:
        os.environ[name] = value
    try:
        yield
    finally:
        os.environ.pop(name, None)
        if before is not None:
            os.environ[name] = before
