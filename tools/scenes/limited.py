"""One function call in a process with limits of time and memory, for libraries that believe whatever a file declares.

A call that exceeds its limits, and a library that crashes, end that process and not this one.
"""

import os
import pickle
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import ParamSpec, TypeVar

from shared.errors import InputError
from shared.reading import data_bytes

P = ParamSpec("P")
R = TypeVar("R")

_SECONDS, _SECONDS_PER_BYTE = 0.25, 0.5e-6  # a camera's RAW takes 0.05 seconds per megabyte
_BYTES, _BYTES_PER_BYTE = 192 << 20, 40  # a RAW of 24 megapixels takes 300 MB, and has at least 10
_BYTES_PER_THREAD = 10 << 20  # stacks of the threads that a library starts, one per processor
_START = "import sys; sys.path[:] = {path!r}; from tools.scenes.limited import serve; serve()"


def run_limited(file: Path, modules: tuple[str, ...], function: Callable[P, R], *arguments: P.args, **named: P.kwargs) -> R:
    """Call `function`, which reads `file`, in a new process, and return its result.

    file: its length decides what the call may use: a quarter of a second of a processor and 200 MB, and more for each byte.
    modules: imported before the limits apply.
    function: defined at the top level of a module, because it is pickled; so are its arguments and its result.
    Raises the InputError that `function` raises, and InputError when the process exceeds its limits or ends in another way.
    """
    size = data_bytes(file)
    seconds, most = _SECONDS + size * _SECONDS_PER_BYTE, _BYTES + size * _BYTES_PER_BYTE
    request = pickle.dumps((modules, seconds, most, function, arguments, named))
    line = [sys.executable, "-c", _START.format(path=sys.path)]
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    # MALLOC_ARENA_MAX: glibc reserves 64 MB for each thread otherwise.
    with subprocess.Popen(line, stdin=subprocess.PIPE, env={**os.environ, "MALLOC_ARENA_MAX": "1"}, **quiet) as process:  # type: ignore[call-overload]
        try:
            with suppress(BrokenPipeError), process.stdin as sending:
                sending.write(request)
            done, result = pickle.load(process.stdout)
        except (EOFError, pickle.UnpicklingError):
            raise InputError(
                f"reading it takes more than {seconds:.2g} s or {most >> 20} MB, or ends the process that reads it, which no "
                f"picture of {size} bytes does: the file is damaged, or made to fill the memory; copy it again"
            ) from None
        finally:
            process.kill()
    if not done:
        raise result
    return result


def serve() -> None:
    """Answer the request on standard input; what libraries print is dropped."""
    answer = os.fdopen(os.dup(1), "wb")
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    modules, seconds, most, function, arguments, named = pickle.load(sys.stdin.buffer)
    for module in modules:
        import_module(module)
    _limit(seconds, most)
    try:
        result = True, function(*arguments, **named)
    except InputError as error:
        result = False, error
    signal.setitimer(signal.ITIMER_PROF, 0)
    pickle.dump(result, answer, pickle.HIGHEST_PROTOCOL)
    answer.close()


def _limit(seconds: float, most: int) -> None:
    """End this process after `seconds` of its processors' time; let its memory grow by `most` bytes."""
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    with suppress(OSError, ValueError):  # a system that does not know its data, or a lower limit that is set already
        now = int(Path("/proc/self/statm").read_text("ascii").split()[5]) * resource.getpagesize()
        ceiling = now + most + (os.cpu_count() or 1) * _BYTES_PER_THREAD
        resource.setrlimit(resource.RLIMIT_DATA, (ceiling, ceiling))
