"""`panchroma doctor`: a good installation is well, and each thing that can be wrong is seen, with a
remedy.
"""

import subprocess
import sys
from unittest.mock import Mock

import pytest

from panchroma.tools.batch.console import Console
from panchroma.tools.commands import doctor
from panchroma.tools.commands.doctor import BAD, GOOD, MISSING, Finding
from panchroma.tools.io.versions import install_command
from tests.tools.batch.examples import without_semaphores
from tests.tools.command import run, spawn
from tests.tools.test_base_install import camera


def only(name: str) -> Finding:
    (finding,) = (finding for check in doctor.CHECKS for finding in check() if finding.name == name)
    return finding


def test_this_installation_is_well() -> None:
    outcome = run("doctor", "--json", code=0)
    states = {record["check"]: record["state"] for record in outcome.records}
    assert {name for name, state in states.items() if state == BAD} == set()
    checked = {"Python", "onnxruntime", "rawpy", "preview", "kernel cache", "memory"}
    assert checked <= set(states)
    assert all(record["remedy"] for record in outcome.records if record["state"] != GOOD)
    lines = outcome.err.splitlines()
    assert len([line for line in lines if line.startswith("ok      preview ")]) == 1
    assert lines[-1] == "all is well" or lines[-1].endswith("optional things missing")


def test_a_camera_is_well_with_the_base_alone() -> None:
    """Packages that the installation has but that are hidden count as broken here; what a camera
    needs does not.
    """
    report = camera("doctor").stdout.decode()
    for name in ("numpy", "tifffile", "imagecodecs", "onnxruntime", "preview"):
        assert f"\nok      {name} " in report, report


def test_what_is_missing_is_told_with_what_misses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "package_version", {"scipy": "1.15"}.get)
    for name in ("rawpy", "numpy", "scipy"):
        monkeypatch.setitem(doctor._MODULES, name, "no_such_module")
    missing = f"not installed: {doctor._EXTRAS['tools']}"
    assert only("rawpy") == Finding("rawpy", MISSING, missing, install_command("tools"))
    assert (only("numpy").state, only("numpy").remedy) == (BAD, install_command(""))
    assert only("scipy").found == "1.15 cannot be imported: No module named 'no_such_module'"
    run("doctor", code=1)


def test_the_backend_of_a_notebook_breaks_no_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "module://no_such_package.backend")
    outcome = spawn("doctor --json")
    (found,) = (record for record in outcome.records if record["check"] == "matplotlib")
    assert found["state"] == GOOD, found


def test_one_process_at_a_time_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert only("processes").state == GOOD
    without_semaphores(monkeypatch)
    finding = only("processes")
    assert (finding.state, "No such device" in finding.found) == (MISSING, True)
    assert "/dev/shm" in finding.remedy


def test_several_opencv_packages_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    several = dict.fromkeys(("opencv-python", "opencv-contrib-python-headless"), "5.0")
    monkeypatch.setattr(doctor, "package_version", several.get)
    finding = only("OpenCV")
    assert (finding.state, "overwrite each other" in finding.found) == (BAD, True)
    assert "-y opencv-contrib-python-headless opencv-python &&" in finding.remedy


def test_what_fails_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    illegal = Mock(side_effect=RuntimeError("illegal instruction"))
    monkeypatch.setattr("panchroma.device.Preview.run", illegal)
    preview = only("preview")
    assert (preview.state, preview.found) == (BAD, "does not run: illegal instruction")
    nowhere = Mock(side_effect=RuntimeError("no locator available"))
    monkeypatch.setattr("panchroma.offline.kernel_cache", nowhere)
    kernels = only("kernel cache")
    assert (kernels.state, "NUMBA_CACHE_DIR" in kernels.remedy) == (BAD, True)
    monkeypatch.setattr(doctor, "available_memory", lambda: 100 * 2**20)
    assert (only("memory").state, only("memory").found) == (BAD, "0.1 GB free")


def test_a_compiler_that_makes_no_machine_code_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    script = "from panchroma.tools.cli import main\nmain()"
    for more in ([], ["--compile"]):
        line = [sys.executable, "-c", script, "doctor", *more]
        done = subprocess.run(line, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        report = done.stderr + done.stdout
        assert "WRONG   kernel cache " in report
        assert ("WRONG   compilation " in report) == bool(more)
        assert report.count("-> unset NUMBA_DISABLE_JIT") == 1 + len(more)


def test_what_is_not_compiled_is_compiled_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = iter([["mix"], [], [], [], ["mix"], ["mix"]])  # before and after each of three runs
    monkeypatch.setattr("panchroma.offline.kernels_to_compile", lambda: next(missing))
    compiled, again, kept_nowhere = (doctor._compiled(Console(quiet=True)) for _ in range(3))
    assert (compiled.state, compiled.found[:13]) == (GOOD, "1 kernels in ")
    assert (again.state, again.found) == (GOOD, "all kernels were compiled already")
    assert (kept_nowhere.state, kept_nowhere.found) == (BAD, "not compiled: mix")
    nowhere = Mock(side_effect=RuntimeError("no locator available"))
    monkeypatch.setattr("panchroma.offline.kernels_to_compile", nowhere)
    finding = doctor._compiled(Console(quiet=True))
    assert (finding.state, "NUMBA_CACHE_DIR" in finding.remedy) == (BAD, True)
