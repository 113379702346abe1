"""The site builds without a warning, and its examples are short."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.data import ROOT

EXAMPLES = sorted((ROOT / "tools/pages/gallery").glob("*.py"))


def code_lines(path: Path) -> int:
    """Lines of code without blank ones, comments and the text at the top."""
    text = path.read_text("utf-8")
    head = ast.parse(text).body[0].end_lineno
    return sum(bool(line.strip()) and line[0] != "#" for line in text.splitlines()[head:])


def test_there_are_ten_short_examples() -> None:
    assert len(EXAMPLES) == 10
    assert {path.stem: lines for path in EXAMPLES if (lines := code_lines(path)) >= 30} == {}


def test_the_site_builds_with_warnings_as_errors(tmp_path: Path) -> None:
    remedy = "the site: docs are not installed; pip install -e '.[docs]'"
    for package in ("sphinx", "myst_parser", "numpydoc", "sphinx_gallery", "furo"):
        pytest.importorskip(package, reason=remedy)
    ignored = shutil.ignore_patterns("__pycache__")
    for name in (".github", "device", "offline", "shared", "tools", "tests"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored, symlinks=True)
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, tmp_path)
    line = [sys.executable, "-m", "sphinx", "-W", "-q", "-c", "tools/pages", ".", "build/pages"]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "build/pages/index.html").is_file()
    assert len(list((tmp_path / "build/gallery/images").glob("*_001.png"))) == len(EXAMPLES)
