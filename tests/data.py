"""Where the project is, and where the test photographs are."""

import os
import shutil
from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("PANCHROMA_TEST_DATA", ROOT / "../shared/data"))


def copy_clone(folder: Path) -> None:
    """Copy what the packages and their pages are built from: the tools leave their work beside
    it.
    """
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in (".github", "device", "offline", "shared", "tools", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=ignored, symlinks=True)
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, folder)


def photograph(name: str) -> Path:
    """The path of a test photograph. A test that asks for one is skipped where it is missing."""
    path = DATA / name
    if not path.exists():
        import pytest  # benchmarks, which look for photographs too, do without it

        pytest.skip(
            f"photographs: {name} is missing: put it into {DATA}, or name another folder in "
            "PANCHROMA_TEST_DATA (tests/README.md)"
        )
    return path
