"""`panchroma doctor`: a good installation is well, and each thing that can be wrong is seen, with a remedy."""

import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from offline import compile_kernel, kernel_cache
from offline.ahead import used_kernels
from tests.python import run_python
from tests.tools.command import run, spawn
from tests.tools.test_base_install import camera
from tools.commands import checks
from tools.commands.checks import BAD, GOOD, MISSING, Finding
from tools.host.versions import package_version


def findings(name: str) -> list[Finding]:
    return [finding for check in checks.CHECKS for finding in check() if finding.name == name]


def only(name: str) -> Finding:
    (finding,) = findings(name)
    return finding


def test_this_installation_is_well() -> None:
    outcome = run("doctor", "--json", code=0)
    states = {record["check"]: record["state"] for record in outcome.records}
    assert {name for name, state in states.items() if state == BAD} == set()
    assert {"Python", "onnxruntime", "OpenCV", "preview", "kernel cache", "processors", "memory", "writing"} <= set(states)
    assert [record for record in outcome.records if record["state"] != GOOD and not record["remedy"]] == []
    said = outcome.err.splitlines()
    assert len([line for line in said if line.startswith("ok      preview ")]) == 1
    assert said[-1] == "all is well" or said[-1].endswith("optional things missing")


def test_a_camera_is_well_with_the_base_alone() -> None:
    """Packages that the installation has but that are hidden count as broken here; what a camera needs does not."""
    done = camera("doctor")
    lines = done.stdout.decode().splitlines()
    for name in ("numpy", "tifffile", "imagecodecs", "onnxruntime", "preview", "writing"):
        assert [line for line in lines if line.startswith(f"ok      {name} ")], (name, done.stdout, done.stderr)


def test_what_is_missing_is_told_with_what_misses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str | None:
        return {"rawpy": None, "numpy": None, "onnxruntime": "1.21.0"}.get(name, package_version(name))

    monkeypatch.setattr(checks, "package_version", version)
    assert (only("rawpy").state, only("rawpy").found) == (
        MISSING,
        f"not installed: {checks._EXTRAS['tools'][1]}",
    )
    assert (only("numpy").state, only("onnxruntime").state) == (BAD, BAD)
    assert "older than 1.22.1" in only("onnxruntime").found
    assert only("onnxruntime").remedy == "pip install 'onnxruntime>=1.22.1'"
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
def test_there_is_one_opencv(installed: tuple[str, ...], state: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "package_version", lambda name: "5.0" if name in installed else None)
    finding = only("OpenCV")
    assert finding.state == state
    assert words in finding.found
    assert all(f"-y {' '.join(installed)} &&" in finding.remedy for _ in installed if state == BAD)


def test_a_preview_that_fails_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("illegal instruction")

    monkeypatch.setattr("device.Preview.run", fail)
    assert (only("preview").state, only("preview").found) == (BAD, "does not run: illegal instruction")


def test_a_cache_that_cannot_be_written_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("offline.kernel_cache", lambda: tmp_path / "file" / "below")
    assert only("kernel cache").state == BAD
    assert "NUMBA_CACHE_DIR" in only("kernel cache").remedy


def test_what_is_not_compiled_is_compiled_ahead_and_only_once(tmp_path: Path) -> None:
    elsewhere = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    missing = ("mix", "surroundings")
    for name in set(used_kernels()) - set(missing):
        compile_kernel(name)
    line = "import os, sys; os.environ['NUMBA_CACHE_DIR'] = sys.argv[1]; import offline; print(offline.kernel_cache())"
    shutil.copytree(kernel_cache(), run_python(line, tmp_path).strip(), dirs_exist_ok=True)
    for path in tmp_path.rglob("*.nb?"):
        if path.name.split(".")[1].partition("-")[0] in missing:
            path.unlink()
    first, second = (spawn("doctor", "--compile", "--json", env=elsewhere) for _ in range(2))
    assert (first.code, second.code) == (0, 0), first.err + second.err
    assert first.records[0]["check"] == "compilation"
    assert first.records[0]["found"].startswith("2 kernels in ")
    assert second.records[0]["found"] == "all kernels were compiled already"


def test_what_cannot_be_compiled_ahead_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere() -> list[str]:
        raise RuntimeError("no locator available")

    monkeypatch.setattr("offline.kernels_to_compile", nowhere)
    outcome = run("doctor", "--compile", "--json")
    assert (outcome.code, outcome.records[0]["state"]) == (1, BAD)
    assert "NUMBA_CACHE_DIR" in outcome.records[0]["remedy"]
    monkeypatch.setattr("offline.kernels_to_compile", lambda: ["mix"])
    assert run("doctor", "--compile", "--json").records[0]["found"] == "could not keep mix"


def test_little_memory_and_a_folder_that_takes_nothing_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "available_memory", lambda: 100 * 2**20)
    assert (only("memory").state, only("memory").found) == (BAD, "0.1 GB free")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checks, "write_durably", full)
    assert only("writing").state == BAD
