"""The types hold, as mypy is told to check them in pyproject.toml."""

import sys

import pytest

from tests.python import finished


def test_types_hold() -> None:
    pytest.importorskip("mypy", reason="types: mypy is not installed: pip install -e '.[all,dev]'")
    checked = finished(sys.executable, "-m", "mypy")
    assert checked.returncode == 0, checked.stdout + checked.stderr
