"""A library changes nothing of the program that uses it: neither an import nor a call does, not
even meanwhile.
"""

import os
from pathlib import Path

from panchroma.tools.batch.progress import StageProgress
from tests.python import run_python

SCRIPT = """
import gc, os, signal, sys, threading
from pathlib import Path

os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # before onnxruntime is imported, whoever does it

def niceness(task):
    return int(Path(f"/proc/self/task/{task}/stat").read_text().rpartition(")")[2].split()[16])

def surroundings():
    return {
        "variables": dict(os.environ),
        "hooks": (sys.unraisablehook, sys.excepthook, threading.excepthook),
        "signals": [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)],
        "switch interval": sys.getswitchinterval(),
        "frozen": gc.get_freeze_count(),
        "nice": {niceness(task) for task in os.listdir("/proc/self/task")},
    }

if __name__ == "__main__":
    before, seen = surroundings(), []
    import panchroma
    from tests.tools.batch.test_host_untouched import threads_of
    from panchroma.tools.io.ahead import ahead
    from panchroma.tools.batch.parallel import processes

    shot = panchroma.simulate("builtin:200x120", sigma=0.01)
    panchroma.preview(shot)
    panchroma.render(shot).save(Path(sys.argv[1], "a.jpg"))
    seen.append(surroundings())
    list(ahead(lambda _: seen.append(surroundings()), range(4), 2))
    with processes(2, "", threads=3) as executor:
        for _, result in executor.run(threads_of, [1, 2, 3], print):
            seen.append(surroundings())
            assert result == ["3", "3"], result
    seen.append(surroundings())
    for each in seen:
        assert each == before, {name: (value, before[name]) for name, value in each.items() if value != before[name]}
    print(len(seen))
"""


def threads_of(piece: int, listener: StageProgress) -> list[str]:
    """What two libraries are told in a worker."""
    return [os.environ["OPENBLAS_NUM_THREADS"], os.environ["PANCHROMA_THREADS"]]


def test_a_program_that_renders_and_starts_processes_is_what_it_was(tmp_path: Path) -> None:
    assert int(run_python(SCRIPT, tmp_path)) == 9
