"""No file of the user is executed because of its name, wherever it lies: neither by a command and
the processes that it starts, nor by a decoder that a notebook starts.

A library changes nothing of the program that uses it: neither an import nor a call does, not
even meanwhile.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from panchroma.tools.batch.progress import StageProgress
from tests.data import ROOT
from tests.python import finished, run_python
from tests.test_library import STATE
from tests.tools.batch.examples import save_shot
from tests.tools.io.files import save

# --- safe path ------------------------------------------------------------------------------------

SOURCE = ROOT / "tools" / "notebook"  # where the package `panchroma` is

# What Python and the packages import, and some that nothing does.
NAMES = {*sys.stdlib_module_names, "numpy", "PIL", "cv2", "rawpy", "OpenEXR", "pebble", "panchroma"}
PROGRAM = "from panchroma.tools.cli import main\nif __name__ == '__main__':\n    main()\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with shots and a scene, and in it, in that of the shots and in that of the results,
    files that leave a mark when they are executed.
    """
    for place in (tmp_path, tmp_path / "in", tmp_path / "out"):
        place.mkdir(exist_ok=True)
        for name in NAMES:
            mark = f"open({str(tmp_path / 'executed')!r}, 'a').write('{place.name}/{name} ')"
            (place / f"{name}.py").write_text(f"{mark}\nraise SystemExit(3)\n")
    for seed in range(3):
        save_shot(tmp_path / "in" / f"{seed}.dng", seed)
    pixels = np.linspace(0, 1, 60 * 60 * 3, dtype=np.float32).reshape(60, 60, 3)
    save(tmp_path / "in" / "scene.exr", pixels)
    program = tmp_path / "bin" / "panchroma"
    program.parent.mkdir()
    program.write_text(PROGRAM)
    return tmp_path


RENDER = "render in/0.dng in/1.dng in/2.dng -o out -j 2 --preset paper"
SCENES = "builtin:80x70 builtin:70x80 in/scene.exr"


@pytest.mark.parametrize(
    ("line", "variables"),
    [
        (RENDER, {}),
        (RENDER, {"PYTHONPATH": str(SOURCE)}),  # by which the user may have installed Panchroma
        (f"evaluate {SCENES} -o out -j 2 --methods bilinear --sigma 0", {}),
        ("simulate in/scene.exr -o out", {}),
        ("doctor", {}),
    ],
)
def test_a_command_executes_no_file_of_the_user(
    line: str, variables: dict[str, str], folder: Path
) -> None:
    words = [sys.executable, str(folder / "bin/panchroma"), *line.split()]
    environment = {**os.environ, **variables}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, check=False)
    assert not (folder / "executed").exists(), (folder / "executed").read_text()
    assert done.returncode == 0, done.stderr


def test_a_decoder_of_a_notebook_executes_no_file_of_the_user(folder: Path) -> None:
    """A notebook has the current folder in its path; the kernel has loaded much before."""
    script = """
import sys, panchroma
from panchroma.tools.simulation.load import load_scene
load_scene("in/scene.exr")
sys.path.insert(0, "")
assert load_scene("in/scene.exr").rgb.shape == (60, 60, 3)
"""
    done = finished(sys.executable, "-P", "-c", script, folder=folder)
    assert done.returncode == 0, done.stderr
    assert not (folder / "executed").exists()


def test_a_decoder_imports_what_its_caller_imports(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the folder of a script, from PYTHONPATH and from a path that the script has added; and
    the Panchroma of the script, not that of the environment.
    """
    for name in ("script", "users", "added"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"of_{name}.py").write_text(f"NAME = {name!r}\n")
    (tmp_path / "script" / "panchroma").symlink_to(SOURCE / "panchroma")
    (tmp_path / "script" / "decoder.py").write_text("""
import numpy as np, of_script, of_users, of_added, panchroma
def decode(path):
    names = [of_script.NAME, of_users.NAME, of_added.NAME]
    return np.zeros((1, 1), np.uint8), {"names": names, "panchroma": panchroma.__file__}
""")
    (tmp_path / "script" / "run.py").write_text(f"""
import sys
from pathlib import Path
sys.path.append({str(tmp_path / "added")!r})
import decoder
from panchroma.tools.io.limited import run_limited
print(run_limited(Path(__file__), (), decoder.decode, "x")[1])
""")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "users"))
    done = finished(sys.executable, tmp_path / "script" / "run.py")
    assert done.returncode == 0, done.stderr
    ours = tmp_path / "script" / "panchroma" / "__init__.py"
    names = ["script", "users", "added"]
    assert done.stdout == f"{ {'names': names, 'panchroma': str(ours)} }\n"


# --- host untouched -------------------------------------------------------------------------------

SCRIPT = """
from functools import partial
from pathlib import Path
import panchroma
from tests.tools.batch.test_safe_path import threads_of
from panchroma.tools.io.ahead import ahead
from panchroma.tools.batch.parallel import in_processes

def look(*ignored):
    changed = {name for name, value in state().items() if value != before[name]}
    seen.append(sorted(changed.difference(ignored)))

seen, folder = [], Path(sys.argv[1])
shots = panchroma.simulate("builtin:200x120", sigma=0.01, burst=2)
look()
panchroma.preview(shots[0])
look()
shots[0].save(folder / "a.dng")
shot = panchroma.open(folder / "a.dng")
look()
panchroma.render(shot).save(folder / "a.jpg")
panchroma.render(shot, preset="paper")
look()
panchroma.burst(shots)
look()
beside_threads = partial(look, "threads")
list(ahead(beside_threads, range(4), 2))
with in_processes(threads_of, [1, 2, 3], 2, print, "", threads=3) as results:
    for _, result in results:
        beside_threads()
        assert result == ["3", "3"], result
beside_threads()
print(seen)
"""


def threads_of(piece: int, listener: StageProgress) -> list[str]:
    """What two libraries are told in a worker."""
    return [os.environ["OPENBLAS_NUM_THREADS"], os.environ["PANCHROMA_THREADS"]]


def test_a_program_that_renders_and_starts_processes_is_what_it_was(tmp_path: Path) -> None:
    """After simulation, preview, files, render and burst, and at each moment of the others' work."""
    assert run_python(STATE + SCRIPT, tmp_path) == f"{[[]] * 13}\n"
