"""Benchmarks run in the environment that the README makes: without what only the tests need."""

import subprocess
import sys
import tomllib
from pathlib import Path

from tests.data import ROOT

OTHER_NAMES = {"pytest-xdist": "xdist", "PyWavelets": "pywt"}


def test_no_benchmark_needs_what_only_tests_need() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    missing = [
        name.split(">")[0].split("[")[0]
        for extra in ("dev", "cluster", "rivals", "training")
        for name in extras[extra]
    ]
    blocked = {OTHER_NAMES.get(name, name) for name in missing} - {
        "setuptools",
        "panchroma",
        "offline",
        "tools",
    }
    modules = [
        f"tests.benchmarks.{path.stem}"
        for path in Path(__file__).parent.glob("*.py")
        if not path.name.startswith("test_")
    ]
    assert {"pytest", "onnx", "pywt", "torch"} <= blocked
    assert "tests.benchmarks.speed" in modules
    code = (
        "import importlib, sys; sys.modules.update(dict.fromkeys({})); "
        "list(map(importlib.import_module, {}))"
    )
    subprocess.run(
        [sys.executable, "-c", code.format(sorted(blocked), modules)], cwd=ROOT, check=True
    )
