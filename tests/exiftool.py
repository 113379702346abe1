"""The program exiftool, for the tests of what other programs see in our files."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest


def fields(path: Path, *arguments: str) -> dict[str, Any]:
    """Return the fields of a file, name -> value, that exiftool shows with these arguments."""
    (found,) = json.loads(exiftool("-j", *arguments, path))
    return found


def exiftool(*arguments: str | Path) -> bytes:
    """What exiftool prints. A test that asks for it is skipped where it is not installed."""
    if shutil.which("exiftool") is None:
        pytest.skip("exiftool is not installed: apt-get install libimage-exiftool-perl")
    done = subprocess.run(["exiftool", *arguments], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
