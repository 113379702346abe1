"""Tell the user that the renderer is being compiled, which takes most of the time of the first run on a machine."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from .progress import StageProgress

CACHE_REMEDY = "set NUMBA_CACHE_DIR to a folder that you may write to"


@contextmanager
def announced_compilation(note: Callable[[str], None], progress: StageProgress) -> Iterator[None]:
    """In the `with` block, say once that the renderer is being compiled, and show which kernel, if it has to be."""
    from offline import compilation, kernel_cache

    note_once = cache(note)

    def begins(kernel: str) -> None:
        try:
            kernel_cache()
        except RuntimeError:
            often = f"every time: there is no folder to keep the result in; {CACHE_REMEDY}"
        else:
            often = "once"
        note_once(f"compiling the renderer for this processor; it takes about a minute, {often}")
        progress.remark(f"compiling {kernel}")

    with compilation(begins):
        yield
