"""Tell the user when the renderer is being compiled: on the first run on a machine it takes most of the time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .console import StageProgress


@contextmanager
def telling_compilation(note: Callable[[str], None], progress: StageProgress) -> Iterator[None]:
    """Say once that the renderer is being compiled, and show which part of it, where it is: on the first run on a machine."""
    from offline import compilation

    told_once: list[str] = []

    def begins(kernel: str) -> None:
        if not told_once:
            note("compiling the renderer for this processor; it takes some seconds, once")
        told_once.append(kernel)
        progress.remark(f"compiling {kernel}")

    with compilation(begins):
        yield
