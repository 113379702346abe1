"""Compile the renderer's kernels, ahead or when they are needed, and tell the user, who waits for
it in a first run.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache

from ...shared.errors import OutputError
from .memory import available_memory
from .parallel import in_processes, one_by_one, possible_processes
from .progress import Note, StageProgress

_PROCESS_BYTES = 400 * 2**20  # of a process that compiles, with the libraries
_REMEDY = "close other programs, or let the first render compile"
_TIME = "it takes about half a minute, once (if it comes again: panchroma doctor)"
_COMPILING = f"compiling the renderer for this processor; {_TIME}"


@contextmanager
def announced_compilation(progress: StageProgress) -> Iterator[None]:
    """In the `with` block, say once that the renderer is being compiled, if it has to be, and then
    how far that is.

    progress: gets the note, and shows how far it is.
    """
    from ...offline import compilation

    note_once = cache(progress.note)

    def tell(number: int, most: int) -> None:
        note_once(_COMPILING)
        progress.remark(f"compiling kernel {number} of at most {most}")

    with compilation(tell):
        yield


def compile_ahead(processes: int, progress: StageProgress) -> None:
    """Compile the renderer, unless it has been compiled before, in several processes at a time.

    With one process, for one kernel, or without a folder to keep the result in, it is left to the
    renders.

    Parameters
    ----------
    processes : int
        How many may be started. Call this in the command's own process, not in one that it has
        started.
    progress : StageProgress
        See `announced_compilation`.
    """
    from ...offline import kernels_to_compile

    try:
        names = kernels_to_compile()
    except OutputError:  # there is no folder to keep any in
        return
    if min(processes, len(names)) > 1:
        progress.stage("compiling", len(names))
        progress.note(_COMPILING)
        progress.remark("compiling")
        for number, _ in enumerate(compile_all(names, processes, progress.note), 1):
            progress.advance()
            progress.remark(f"compiled kernel {number} of {len(names)}")


def compile_all(names: Sequence[str], processes: int, note: Note) -> Iterator[tuple[str, object]]:
    """Compile kernels in several processes, as many as memory allows; yields (name, None, or the
    error) as each is done.

    names: those that take longest first.
    """
    if possible_processes(2, note) == 1:
        yield from one_by_one(_compile, names, lambda _: StageProgress(note=note))
        return
    possible = min(processes, available_memory() // _PROCESS_BYTES)
    with in_processes(_compile, names, max(1, possible), note, _REMEDY) as results:
        yield from results


def _compile(name: str, listener: StageProgress) -> None:
    from ...offline import compile_kernel

    compile_kernel(name)
