"""The types hold, as mypy is told to check them in pyproject.toml."""

import subprocess
import sys

import pytest

from tests.data import ROOT


def test_types_hold() -> None:
    pytest.importorskip("mypy", reason="types: mypy is not installed: pip install -e '.[all,dev]'")
    checked = subprocess.run(
        [sys.executable, "-m", "mypy"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
