"""The summary of a test run says in one line each what was not tested, and how to get it."""

import os
import sys
from pathlib import Path

from tests.python import finished

OPTIONS = "-m pytest -q -p no:cacheprovider -n 2 --dist loadfile"
FILES = "tests/arm tests/tools/io/test_capture_data.py tests/tools/commands/test_identify.py"
REMEDIES = {
    "ARM boards: qemu-aarch64": "apt-get install qemu-user",
    "exiftool": "apt-get install libimage-exiftool-perl",
    "photographs: raw/": "PANCHROMA_TEST_DATA",
}


def test_what_was_not_tested_is_said_with_the_remedy(tmp_path: Path) -> None:
    """Where no other program and no photograph is; the tests are of three files and folders."""
    chosen = "same_bytes or capture_data_arrive or every_kind"
    line = [*OPTIONS.split(), *FILES.split(), "-k", chosen]
    environment = {**os.environ, "PATH": str(tmp_path), "PANCHROMA_TEST_DATA": str(tmp_path)}
    for name in [name for name in environment if name.startswith("PYTEST_")]:
        del environment[name]  # of the run that this test is part of
    done = finished(sys.executable, *line, env=environment)
    _, _, summary = done.stdout.partition("not tested here")
    lines = summary.splitlines()
    for what, remedy in REMEDIES.items():
        found = [line for line in lines if what in line]
        assert len(found) == 1, done.stdout
        assert remedy in found[0]
