"""`panchroma doctor`: a good installation is well, and each thing that can be wrong is seen, with a
remedy.
"""

import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from panchroma.offline import PRESETS
from panchroma.shared.errors import InputError, OutputError
from panchroma.tools.batch.console import Console
from panchroma.tools.commands import doctor
from panchroma.tools.commands.doctor import BAD, GOOD, MISSING, Finding
from panchroma.tools.io.versions import install_command
from tests.tools.batch.examples import without_semaphores
from tests.tools.command import run, spawn
from tests.tools.test_base_install import camera


def machine() -> dict[str, Finding]:
    return {finding.name: finding for finding in doctor._machine()}


def test_this_installation_is_well() -> None:
    outcome = run("doctor", "--json", code=0)
    states = {record["check"]: record["state"] for record in outcome.records}
    assert {name for name, state in states.items() if state == BAD} == set()
    checked = {"Python", "onnxruntime", "rawpy", "kernel cache", "networks", "preview", "memory"}
    checked |= {f"render, {preset}" for preset in PRESETS}
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
    for name in ("numpy", "tifffile", "imagecodecs", "onnxruntime", "networks", "preview"):
        assert f"\nok      {name} " in report, report


def test_what_is_missing_is_told_with_what_misses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "package_version", {"scipy": "9.9"}.get)
    for name in ("rawpy", "numpy", "scipy"):
        monkeypatch.setitem(doctor._MODULES, name, "no_such_module")
    packages = {finding.name: finding for finding in doctor._packages()}
    missing = "not installed, belongs to panchroma[tools]"
    assert packages["rawpy"] == Finding("rawpy", MISSING, missing, install_command("tools"))
    missing = "not installed, belongs to panchroma"
    assert packages["numpy"] == Finding("numpy", BAD, missing, install_command(""))
    assert packages["scipy"].found == "9.9 cannot be imported: No module named 'no_such_module'"
    monkeypatch.setattr(doctor, "_pictures", dict)
    run("doctor", code=1)


@pytest.mark.parametrize(
    ("version", "state"),
    [("1.9", BAD), ("2.0rc1", BAD), ("2.0", GOOD), ("2.10", GOOD), ("10.1.dev3+local", GOOD)],
)
def test_a_package_below_its_minimum_is_wrong(
    version: str, state: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Versions are numbers, not texts, and a package without an extra counts as one with."""
    wanted = ["numpy>=2.0", 'rawpy>=2.0; extra == "tools"', 'torch>=99; extra == "training"']
    wanted += ['scipy>=99; python_version < "3"', 'panchroma[offline]; extra == "tools"']
    monkeypatch.setattr(doctor, "requires", lambda _: wanted)
    monkeypatch.setattr(doctor, "package_version", dict.fromkeys(("numpy", "rawpy"), version).get)
    found = list(doctor._packages())
    assert [(one.name, one.state) for one in found] == [("numpy", state), ("rawpy", state)]
    for one in found:
        told = (f"{version} is installed, >=2.0 is needed", f"pip install '{one.name}>=2.0'")
        assert one[2:] == (told if state == BAD else (version, ""))
    monkeypatch.setattr(doctor, "_pictures", dict)
    run("doctor", code=int(state == BAD))


def test_without_packaging_versions_are_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "packaging.requirements", None)
    (found,) = doctor._checked("packages", doctor._packages)
    assert (found.state, found.remedy) == (MISSING, install_command())


def test_the_backend_of_a_notebook_breaks_no_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "module://no_such_package.backend")
    outcome = spawn("doctor --json")
    (found,) = (record for record in outcome.records if record["check"] == "matplotlib")
    assert found["state"] == GOOD, found


def test_the_limits_of_the_machine_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [finding.state for finding in machine().values()] == [GOOD] * 3
    without_semaphores(monkeypatch)
    monkeypatch.setattr(doctor, "available_memory", lambda: 100 * 2**20)
    found = machine()
    assert (found["processes"].state, found["memory"].state) == (MISSING, BAD)
    assert "No such device" in found["processes"].found
    assert "/dev/shm" in found["processes"].remedy
    assert found["memory"].found == "0.1 GB free"


def test_several_opencv_packages_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    several = dict.fromkeys(("opencv-python", "opencv-contrib-python-headless"), "5.0")
    monkeypatch.setattr(doctor, "package_version", several.get)
    *_, finding = doctor._packages()
    assert finding.name == "OpenCV"
    assert (finding.state, "overwrite each other" in finding.found) == (BAD, True)
    assert "-y opencv-contrib-python-headless opencv-python &&" in finding.remedy


def test_what_fails_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    illegal = Mock(side_effect=RuntimeError("illegal instruction"))
    red = Mock(return_value=Mock(rgb=np.ones((24, 24, 3)) * [1, 0.9, 0.9]))
    for path, mock in (("device.Preview.run", illegal), ("offline.render", red)):
        monkeypatch.setattr(f"panchroma.{path}", mock)
    damaged = Mock(side_effect=InputError("luminance.onnx: is not a network"))
    monkeypatch.setattr("panchroma.shared.networks.load_network", damaged)
    checked = (doctor._checked(name, check) for name, check in doctor._pictures().items())
    found = {finding.name: finding for (finding,) in checked}
    assert {finding.state for finding in found.values()} == {BAD}
    assert all("install --force-reinstall" in finding.remedy for finding in found.values())
    assert found["preview"].found == "does not run: illegal instruction"
    assert found["networks"].found == "does not run: luminance.onnx: is not a network"
    for preset in PRESETS:
        assert found[f"render, {preset}"].found == "does not run: it makes a wrong picture"


def test_a_compiler_that_makes_no_machine_code_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    report = spawn("doctor", code=1).out
    assert "WRONG   kernel cache " in report
    assert report.count("-> unset NUMBA_DISABLE_JIT") == 1


def test_what_is_not_compiled_is_compiled_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = iter([["mix"], [], [], [], ["mix"], ["mix"]])  # before and after each of three runs
    monkeypatch.setattr("panchroma.offline.kernels_to_compile", lambda: next(missing))
    monkeypatch.setattr(doctor, "compile_all", lambda names, *_: ((name, None) for name in names))
    compiled, again, kept_nowhere = (next(doctor._kernels(Console(quiet=True))) for _ in range(3))
    assert (compiled.state, compiled.found.split(", ")[1:]) == (GOOD, ["1 compiled"])
    assert (again.state, again.found.split(", ")[1:]) == (GOOD, ["0 compiled"])
    assert (kept_nowhere.state, kept_nowhere.found) == (BAD, "not compiled: mix")
    nowhere = Mock(side_effect=OutputError("no folder; set NUMBA_CACHE_DIR"))
    monkeypatch.setattr("panchroma.offline.kernel_cache", nowhere)
    (finding,) = doctor._checked("kernels", lambda: doctor._kernels(Console(quiet=True)))
    assert (finding.state, "NUMBA_CACHE_DIR" in finding.remedy) == (BAD, True)


@pytest.mark.parametrize(("chosen", "state"), [("kernels", GOOD), ("no/folder", BAD), ("", GOOD)])
def test_kernels_that_are_not_in_the_folder_that_is_asked_for_are_told(
    chosen: str, state: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", chosen)
    monkeypatch.setattr("panchroma.offline.kernel_cache", Path("kernels/0123").absolute)
    monkeypatch.setattr("panchroma.offline.kernels_to_compile", list)
    (found,) = doctor._kernels(Console(quiet=True))
    is_told = found.found.startswith("no/folder cannot be written")
    assert (found.state, is_told) == (state, state == BAD)
