"""`panchroma doctor`: a good installation is well, and each thing that can be wrong is seen, with a
remedy.
"""

import errno
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import pytest

from panchroma.tools.batch.console import Console
from panchroma.tools.commands import doctor
from panchroma.tools.commands.doctor import BAD, GOOD, MISSING, Finding
from panchroma.tools.io.versions import package_version
from tests.tools.command import run
from tests.tools.test_base_install import camera


def only(name: str) -> Finding:
    (finding,) = (finding for check in doctor.CHECKS for finding in check() if finding.name == name)
    return finding


def test_this_installation_is_well() -> None:
    outcome = run("doctor", "--json", code=0)
    states = {record["check"]: record["state"] for record in outcome.records}
    assert {name for name, state in states.items() if state == BAD} == set()
    checked = {"Python", "onnxruntime", "OpenCV", "preview", "kernel cache", "memory", "writing"}
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
    for name in ("numpy", "tifffile", "imagecodecs", "onnxruntime", "preview", "writing"):
        assert f"\nok      {name} " in report, report


def test_what_is_missing_is_told_with_what_misses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    versions = {"rawpy": None, "numpy": None, "onnxruntime": "1.21.0"}
    monkeypatch.setattr(
        doctor, "package_version", lambda name: versions.get(name, package_version(name))
    )
    missing = f"not installed: {doctor._EXTRAS['tools'][1]}"
    assert only("rawpy") == Finding("rawpy", MISSING, missing, doctor.ALL)
    assert only("numpy").state == BAD
    remedy = "pip install 'onnxruntime>=1.22.1'"
    assert only("onnxruntime") == Finding("onnxruntime", BAD, "1.21.0, older than 1.22.1", remedy)
    run("doctor", code=1)


@pytest.mark.parametrize(
    ("installed", "state", "words"),
    [
        ((), MISSING, "not installed"),
        (("opencv-contrib-python-headless",), GOOD, "5.0"),
        (("opencv-contrib-python",), GOOD, "5.0"),
        (("opencv-python", "opencv-contrib-python-headless"), BAD, "overwrite each other"),
    ],
)
def test_there_is_one_opencv(
    installed: tuple[str, ...], state: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "package_version", dict.fromkeys(installed, "5.0").get)
    finding = only("OpenCV")
    assert (finding.state, words in finding.found) == (state, True)
    assert (f"-y {' '.join(installed)} &&" in finding.remedy) == (state == BAD)


def test_what_fails_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    illegal = Mock(side_effect=RuntimeError("illegal instruction"))
    monkeypatch.setattr("panchroma.device.Preview.run", illegal)
    preview = only("preview")
    assert (preview.state, preview.found) == (BAD, "does not run: illegal instruction")
    (tmp_path / "file").touch()
    monkeypatch.setattr("panchroma.offline.kernel_cache", lambda: tmp_path / "file" / "below")
    kernels = only("kernel cache")
    assert (kernels.state, "NUMBA_CACHE_DIR" in kernels.remedy) == (BAD, True)
    monkeypatch.setattr(doctor, "available_memory", lambda: 100 * 2**20)
    assert (only("memory").state, only("memory").found) == (BAD, "0.1 GB free")
    monkeypatch.setattr(
        doctor, "write_durably", Mock(side_effect=OSError(28, "No space left on device"))
    )
    assert only("writing").state == BAD


@pytest.mark.parametrize("number", [errno.EINVAL, errno.EIO])
def test_a_folder_that_cannot_be_synced_is_said_and_not_wrong(
    unsynced_folders: Callable[[int], None], number: int
) -> None:
    unsynced_folders(number)
    finding = only("writing")
    assert (finding.state, "cannot be synced" in finding.found, finding.remedy) == (GOOD, True, "")


def test_what_is_not_compiled_is_compiled_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = iter([["mix"], [], [], [], ["mix"], ["mix"]])  # before and after each of three runs
    monkeypatch.setattr("panchroma.offline.kernels_to_compile", lambda: next(missing))
    compiled, again, kept_nowhere = (doctor._compiled(Console(quiet=True)) for _ in range(3))
    assert (compiled.state, compiled.found[:13]) == (GOOD, "1 kernels in ")
    assert (again.state, again.found) == (GOOD, "all kernels were compiled already")
    assert (kept_nowhere.state, kept_nowhere.found) == (BAD, "could not keep mix")
    nowhere = Mock(side_effect=RuntimeError("no locator available"))
    monkeypatch.setattr("panchroma.offline.kernels_to_compile", nowhere)
    finding = doctor._compiled(Console(quiet=True))
    assert (finding.state, "NUMBA_CACHE_DIR" in finding.remedy) == (BAD, True)
