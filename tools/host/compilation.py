"""Tell the user that the renderer is being compiled, which takes most of the time of a first run, and how far it is."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from .progress import StageProgress

_BETWEEN_NOTES = 10.0  # seconds
CACHE_REMEDY = "set NUMBA_CACHE_DIR to a folder that you may write to"


@contextmanager
def announced_compilation(note: Callable[[str], None], progress: StageProgress) -> Iterator[None]:
    """In the `with` block, say once that the renderer is being compiled, if it has to be, and then how far that is.

    note: called with remarks.
    progress: knows which stage of the render is waiting, and shows how far it is; if it shows nothing, `note` is called for that.
    """
    from offline import compilation, kernel_cache

    note_once, said = cache(note), time.monotonic()

    def begins(number: int, most: int) -> None:
        nonlocal said
        try:
            kernel_cache()
        except RuntimeError:
            often = f"every time: there is no folder to keep the result in; {CACHE_REMEDY}"
        else:
            often = "once"
        note_once(f"compiling the renderer for this processor; it takes a minute or two, {often}")
        how_far = f"compiling kernel {number} of at most {most}"
        if progress.shows:
            progress.remark(how_far)
        elif time.monotonic() - said >= _BETWEEN_NOTES:
            said = time.monotonic()
            note(f"{how_far}: {progress.current}")

    with compilation(begins):
        yield
