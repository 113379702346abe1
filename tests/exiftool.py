"""The program exiftool, for the tests of what other programs see in our files."""

import shutil
import subprocess
from pathlib import Path

import pytest


def exiftool(*arguments: str | Path) -> bytes:
    """What exiftool prints. A test that asks for it is skipped where it is not installed."""
    if shutil.which("exiftool") is None:
        pytest.skip("exiftool is not installed")
    done = subprocess.run(["exiftool", *arguments], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
