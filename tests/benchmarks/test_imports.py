"""Benchmarks run in the environment that the README makes: without what only the tests need."""

import tomllib
from itertools import chain
from pathlib import Path

from tests.data import ROOT
from tests.python import run_python

OTHER_NAMES = {"pytest-xdist": "xdist", "PyWavelets": "pywt"}


def test_no_benchmark_needs_what_only_tests_need() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = ("dev", "rivals", "training")
    packages = chain(*map(project["optional-dependencies"].__getitem__, extras))
    missing = {package.split(">")[0].split("[")[0] for package in packages}
    blocked = {OTHER_NAMES.get(name, name) for name in missing}
    blocked -= {"setuptools", "panchroma", "offline", "tools"}
    modules = [
        f"tests.benchmarks.{path.stem}"
        for path in Path(__file__).parent.glob("*.py")
        if not path.name.startswith("test_")
    ]
    assert {"pytest", "onnx", "pywt", "torch"} <= blocked
    assert "tests.benchmarks.speed" in modules
    code = f"import importlib, sys; sys.modules.update(dict.fromkeys({sorted(blocked)}))"
    run_python(f"{code}; list(map(importlib.import_module, {modules}))")
