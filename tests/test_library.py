"""A library changes nothing of the program that uses it: `shared`, `device` and `offline` leave the
process as they found it.
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
WORK = """
from panchroma.offline.burst import merge_burst, render_burst_bands
from panchroma.tools.simulation.sensor import simulate_additive
scene = np.full((48, 60, 3), 0.3, np.float32)
scene[:, 30:] = 0.5, 0.2, 0.1
calibration = shared.SensorCalibration.of_bits(12)
noise = map(np.random.default_rng, range(2))
shots = [simulate_additive(scene, shared.CfaPattern.bayer(6), calibration, 0.01, rng) for rng in noise]
picture = device.Preview.for_mosaic(shots[0]).run(shots[0])
said("preview")
shared.write_dng(sys.argv[1] + "/a.dng", shots[0], picture)
shot = shared.read_dng(sys.argv[1] + "/a.dng")
said("DNG")
offline.render(shot)
offline.render(shot, offline.PAPER)
said("render")
merged = merge_burst(shots)
list(render_burst_bands(merged))
said("burst")
"""
COMPILING = """
offline.compile_kernel("mix")
said("compile")
print(offline.kernel_cache(), numba.np.arraymath._HAVE_BLAS)
"""


def test_renders_previews_bursts_and_files_leave_the_process_as_it_was(tmp_path: Path) -> None:
    done = ("import", "preview", "DNG", "render", "burst")
    assert run_python(STATE + SAID + WORK, tmp_path) == "".join(f"{what} []\n" for what in done)


def test_compiling_leaves_the_process_as_it_was_and_numba_with_its_linear_algebra(
    tmp_path: Path,
) -> None:
    elsewhere = f"import os\nos.environ['NUMBA_CACHE_DIR'] = {str(tmp_path)!r}\n"
    imported, compiled, last = run_python(elsewhere + STATE + SAID + COMPILING).splitlines()
    assert (imported, compiled) == ("import []", "compile []")
    assert last.startswith(str(tmp_path))
    assert last.endswith("True")
