import shutil
from pathlib import Path

import numpy as np
import pytest

from shared.errors import InputError
from tests.arm import __main__ as arm
from tests.arm.probe import LAYOUTS, PATTERNS, graphs


@pytest.mark.skipif(shutil.which(arm.QEMU) is None, reason="qemu-aarch64 is not installed")
def test_an_arm_board_makes_the_same_bytes() -> None:
    try:
        _, compared, faults = arm.check("cortex-a72")
    except InputError as missing:  # no network
        pytest.skip(str(missing))
    assert faults == []
    assert compared == len(LAYOUTS) * sum(len(graphs(pattern)) + 1 for pattern in PATTERNS.values())


@pytest.fixture
def emulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, np.ndarray]:
    """The results of an imaginary board; this machine's own are a copy."""
    there: dict[str, np.ndarray] = {
        "onnxruntime": np.array("9.9"),
        "one": np.arange(6, dtype=np.uint8).reshape(2, 3),
        "two": np.ones(2, np.float32),
    }
    here = {name: array.copy() for name, array in there.items()}
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda _: "qemu")
    monkeypatch.setattr(arm, "_system", lambda cache: cache.mkdir() or cache)
    monkeypatch.setattr(arm, "_site", lambda *_: tmp_path)
    monkeypatch.setattr(arm, "_probe", lambda python, *_: there if "-cpu" in python else here)
    return there


@pytest.mark.usefixtures("emulated")
def test_identical_results_are_a_success(capsys: pytest.CaptureFixture[str]) -> None:
    assert arm.main(["--cpu", "x"]) == 0
    assert capsys.readouterr().out == "onnxruntime 9.9 on x: 2 of 2 identical\n"


def test_a_difference_is_reported(emulated: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]) -> None:
    emulated["one"][1, 1] += 3
    emulated["two"] = emulated["two"].astype(np.float64)
    assert arm.main(["--cpu", "x"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "onnxruntime 9.9 on x: 0 of 2 identical",
        "  one: 1 of 6 values differ, by up to 3",
        "  two: float64 (2,) instead of float32 (2,)",
    ]


def test_without_qemu_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert arm.main([]) == 2
    assert "qemu-aarch64 is not installed (Debian: apt-get install qemu-user)" in capsys.readouterr().err
