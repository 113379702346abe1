"""A library changes nothing of the program that uses it: neither its import nor its compiler does.
What renders, previews, bursts and files leave: see tests/tools/batch/test_safe_path.py.
"""

from pathlib import Path

from tests.python import run_python

STATE = """
import ctypes, faulthandler, gc, locale, os, random, signal, sys, threading, warnings
import cv2, imagecodecs, numba, numpy as np, scipy.ndimage, scipy.sparse.linalg, tifffile
called = []
class Recorded(ctypes.CDLL):
    def __getattr__(self, name):
        called.append(name)
        return super().__getattr__(name)
ctypes.CDLL = Recorded

def state():
    hooks = sys.unraisablehook, sys.excepthook, threading.excepthook, warnings.showwarning, sys.displayhook
    streams = sys.stdin, sys.stdout, sys.stderr, *(os.readlink(f"/proc/self/fd/{number}") for number in range(3))
    os.umask(mask := os.umask(0o022))
    return {
        "environment": dict(os.environ),
        "signals": {number: signal.getsignal(number) for number in signal.valid_signals()},
        "blocked signals": signal.pthread_sigmask(signal.SIG_BLOCK, ()),
        "timer": signal.getitimer(signal.ITIMER_PROF),
        "hooks": hooks,
        "streams": streams,
        "niceness": {os.getpriority(os.PRIO_PROCESS, int(task)) for task in os.listdir("/proc/self/task")},
        "processors": os.sched_getaffinity(0),
        "switch interval": sys.getswitchinterval(),
        "recursion limit": sys.getrecursionlimit(),
        "collector": (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()),
        "missing modules": {name for name, module in sys.modules.items() if module is None},
        "path": list(sys.path),
        "folder": os.getcwd(),
        "umask": mask,
        "locale": locale.setlocale(locale.LC_ALL),
        "warnings": list(warnings.filters),
        "floating point": np.geterr(),
        "printing": np.get_printoptions(),
        "random numbers": (random.getstate(), str(np.random.get_state())),
        "fault handler": faulthandler.is_enabled(),
        "threads": {thread.name for thread in threading.enumerate()},
        "memory": "mallopt" in called,
    }

before = state()
"""
SAID = """
def said(when):
    global before
    print(when, [name for name, value in state().items() if value != before[name]])
    before = state()

from panchroma import device, offline, shared
said("import")
"""
COMPILING = """
offline.compile_kernel("mix")
said("compile")
print(offline.kernel_cache(), numba.np.arraymath._HAVE_BLAS)
"""


def test_compiling_leaves_the_process_as_it_was_and_numba_with_its_linear_algebra(
    tmp_path: Path,
) -> None:
    elsewhere = f"import os\nos.environ['NUMBA_CACHE_DIR'] = {str(tmp_path)!r}\n"
    imported, compiled, last = run_python(elsewhere + STATE + SAID + COMPILING).splitlines()
    assert (imported, compiled) == ("import []", "compile []")
    assert last.startswith(str(tmp_path))
    assert last.endswith("True")
