"""Call one function in a process with limits of time and memory, for libraries that believe
whatever a file declares.

A call that exceeds its limits, and a library that crashes, end that process and not this one. This
limits resources and is no sandbox: a file that takes a library over can do whatever the user may
do. Only numbers and texts come back, and are checked here.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...shared.errors import InputError
from .damage import data_bytes
from .versions import install_command

Facts = dict[str, Any]
"""Whatever JSON holds, by name."""
Answer = tuple[NDArray[Any], Facts]
"""Samples (H, W) or (H, W, C), and what is known of them."""

_SECONDS, _SECONDS_PER_BYTE = 0.25, 0.5e-6  # a camera's RAW takes 0.05 seconds per megabyte
_BYTES, _BYTES_PER_BYTE = 192 << 20, 40  # a RAW of 24 megapixels takes 300 MB, and has at least 10
_BYTES_PER_THREAD = 10 << 20  # stacks of the threads that a library starts, one per processor
_LONGEST_FACTS, _LONGEST_TRACE = 1 << 20, 1 << 14  # bytes, characters
_SAMPLES = ("uint8", "uint16", "uint32", "float16", "float32")
# Panchroma comes from where the caller has it, everything else from Python and what is installed
# first, then from the caller's path, without the current folder, which is in that of a notebook.
_START = (
    "import sys; from importlib import machinery, util; "
    "found = machinery.PathFinder.find_spec('panchroma', [{root!r}]); "
    "sys.modules['panchroma'] = module = util.module_from_spec(found); "
    "found.loader.exec_module(module); sys.path += {path!r}; "
    "from panchroma.tools.io.limited import serve; serve()"
)


def run_limited(
    file: Path, modules: tuple[str, ...], function: Callable[..., Answer], *arguments: str | int
) -> Answer:
    """Call `function`, which reads `file`, in a new process, and return its result: samples (H, W)
    or (H, W, C), and facts.

    What the facts say is for the caller to check.

    Raises InputError with the message of the InputError that `function` raises, and when the
    process exceeds its limits, ends in another way, or answers anything else. Raises
    ModuleNotFoundError when a package is not installed, and RuntimeError when `function` raises
    another exception; its cause is the traceback there.

    Parameters
    ----------
    file : Path
        Its length decides what the call may use: a quarter of a second of a processor and 200 MB,
        and more for each byte.
    modules : tuple[str, ...]
        Imported before the limits apply.
    function : Callable[..., Answer]
        Defined at the top level of a module.
    """
    size = data_bytes(file)
    seconds, most = _SECONDS + size * _SECONDS_PER_BYTE, _BYTES + size * _BYTES_PER_BYTE
    call = function.__module__, function.__name__, arguments
    request = json.dumps((modules, seconds, most, *call))
    start = _START.format(root=str(Path(__file__).parents[3]), path=list(filter(None, sys.path)))
    line = [sys.executable, "-P", "-W", "ignore", "-c", start]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    # MALLOC_ARENA_MAX: glibc reserves 64 MB for each thread otherwise.
    variables = {**os.environ, "MALLOC_ARENA_MAX": "1"}
    with subprocess.Popen(line, env=variables, **pipes) as process:  # type: ignore[call-overload]
        try:
            with suppress(BrokenPipeError), process.stdin as sending:
                sending.write(request.encode())
            refused, trace, samples, facts = _received(process.stdout, most)
        except (ValueError, TypeError, LookupError, RecursionError):
            cost = f"{seconds:.2g} s or {most >> 20} MB, or ends the process that reads it"
            usual = f"which no picture of {size} bytes does"
            why = "the file is damaged, or made to fill the memory; copy it again"
            raise InputError(f"reading it takes more than {cost}, {usual}: {why}") from None
        finally:
            process.kill()
    if refused:
        raise InputError(refused) from ProcessError(trace)
    if trace and (missing := facts.get("missing")):
        named = f"the package {missing} is not installed: {install_command()}"
        raise ModuleNotFoundError(named, name=missing) from ProcessError(trace)
    if trace:
        raise RuntimeError(trace.splitlines()[-1]) from ProcessError(trace)
    return samples, facts


class ProcessError(Exception):
    """An exception in another process; its text is the traceback there."""


def _received(stream: IO[bytes], most: int) -> tuple[str, str, NDArray[Any], Facts]:
    """Return the message of an InputError and the traceback of any error, "" without one, the
    samples and the facts in an answer of `serve`.

    most: bytes of samples.
    Raises ValueError, TypeError, LookupError or RecursionError for any other answer.
    """
    answer = json.loads(stream.readline(_LONGEST_FACTS))
    refused, trace = str(answer["refused"]), str(answer["trace"])
    kind, shape, facts = answer["dtype"], tuple(answer["shape"]), dict(answer["facts"])
    whole = all(type(side) is int for side in shape)
    if kind not in _SAMPLES or len(shape) not in (2, 3) or not whole:
        raise ValueError("no samples of a picture")
    if prod(shape) * np.dtype(kind).itemsize > most:
        raise ValueError("more samples than the process may hold")
    samples = np.empty(shape, kind)  # raises for negative sides
    if stream.readinto(samples.reshape(-1).view(np.uint8)) != samples.nbytes:  # type: ignore[attr-defined]
        raise ValueError("cut short")
    return refused, trace, samples, facts


def serve() -> None:
    """Answer the request on standard input; what libraries print is dropped."""
    answer = os.fdopen(os.dup(1), "wb")
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
    modules, seconds, most, module, name, arguments = json.load(sys.stdin)
    refused, trace, samples, facts = "", "", np.empty((0, 0), np.uint8), Facts()
    try:
        for needed in (*modules, module):
            import_module(needed)
        _limit(seconds, most)
        samples, facts = getattr(sys.modules[module], name)(*arguments)
    except MemoryError:
        raise  # the limit, which the caller reports
    except Exception as error:
        refused = str(error) if isinstance(error, InputError | OSError) else ""
        trace = "".join(traceback.format_exception(error))[-_LONGEST_TRACE:]
        if isinstance(error, ModuleNotFoundError):
            facts = {"missing": error.name}
    signal.setitimer(signal.ITIMER_PROF, 0)
    head: Facts = {"refused": refused, "trace": trace, "facts": facts}
    head |= {"dtype": samples.dtype.name, "shape": samples.shape}
    answer.write(json.dumps(head).encode() + b"\n")
    answer.write(np.ascontiguousarray(samples).reshape(-1).view(np.uint8).data)
    answer.close()


def _limit(seconds: float, most: int) -> None:
    """End this process after `seconds` of its processors' time; let its memory grow by `most`
    bytes.
    """
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    # a system that does not know its data, or a lower limit that is set already
    with suppress(OSError, ValueError):
        now = int(Path("/proc/self/statm").read_text("ascii").split()[5]) * resource.getpagesize()
        ceiling = now + most + (os.cpu_count() or 1) * _BYTES_PER_THREAD
        resource.setrlimit(resource.RLIMIT_DATA, (ceiling, ceiling))
