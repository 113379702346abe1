"""Where the project is, and where the test photographs are."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("PANCHROMA_TEST_DATA", ROOT / "../shared/data"))


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
