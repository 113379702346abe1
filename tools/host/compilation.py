"""Tell the user that the renderer is being compiled, which takes most of the time of the first run on a machine."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from .progress import StageProgress


@contextmanager
def announced_compilation(note: Callable[[str], None], progress: StageProgress) -> Iterator[None]:
    """In the `with` block, say once that the renderer is being compiled, and show which kernel, if it has to be."""
    from offline import compilation

    note_once = cache(note)

    def begins(kernel: str) -> None:
        note_once("compiling the renderer for this processor; it takes about a minute, once")
        progress.remark(f"compiling {kernel}")

    with compilation(begins):
        yield
