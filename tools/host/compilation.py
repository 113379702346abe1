"""Tell the user when the renderer is compiled: on the first run on a machine that takes most of the time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .progress import StageProgress


@contextmanager
def announced_compilation(note: Callable[[str], None], progress: StageProgress) -> Iterator[None]:
    """In the `with` block, say once that the renderer is being compiled, and show which kernel, if it has to be."""
    from offline import compilation

    announced: list[str] = []

    def begins(kernel: str) -> None:
        if not announced:
            note("compiling the renderer for this processor; it takes some seconds, once")
        announced.append(kernel)
        progress.remark(f"compiling {kernel}")

    with compilation(begins):
        yield
