"""The page on bringing up a camera is true: its commands, run one after the other in an empty
folder, print what it says.
"""

import re
import shlex
import shutil
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from panchroma.shared import read_dng
from tests.data import ROOT
from tests.tools.command import PROGRAM, ended, start

PAGE = (ROOT / "device" / "bring_up.md").read_text()
# on smaller frames, for the sake of time
SMALL = PAGE.replace("600x400", "300x200").replace("600 x 400", "300 x 200")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", SMALL, re.DOTALL)
UNIT = next(block for kind, block in BLOCKS if kind == "ini")


def test_the_commands_print_what_the_page_says(tmp_path: Path) -> None:
    (tmp_path / "panchroma").write_text(
        f'#!/bin/sh\nPYTHONPATH={ROOT}/tools/notebook exec {shlex.join(PROGRAM)} "$@"\n'
    )
    (tmp_path / "panchroma").chmod(0o755)
    steps = "\n".join(f"{block}\necho ---\n" for kind, block in BLOCKS if kind == "sh")
    script = f"set -euo pipefail\nPATH={tmp_path}:$PATH\nmkdir empty; cd empty\n{steps}"
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    printed = iter(done.stdout.split("---\n"))
    for (kind, _), (after, expected) in pairwise(BLOCKS):
        said = next(printed) if kind == "sh" else ""
        if kind == "sh" and not after:
            for line in expected.splitlines():
                assert line in said, said
    shot = read_dng(next((tmp_path / "empty" / "shots").glob("*.dng")))
    assert shot.pattern.letters_from() == ("WRWG", "BWGW", "WGWB", "GWRW")


@pytest.mark.skipif(
    not shutil.which("systemd-analyze"),
    reason="the unit file: systemd is not installed: apt-get install systemd",
)
def test_the_unit_is_one_that_systemd_takes(tmp_path: Path) -> None:
    unit = tmp_path / "panchroma.service"
    unit.write_text(UNIT.replace("/opt/panchroma/.venv/bin/panchroma", sys.executable))
    done = subprocess.run(
        ["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_the_service_ends_with_0_and_its_link_leads_to_a_whole_shot(tmp_path: Path) -> None:
    (command,) = re.findall(r"^ExecStart=(.*)$", UNIT, re.MULTILINE)
    (tmp_path / "camera.json").write_text('{"schema": 1, "gamma": [1, 1, 1]}')
    for here, there in (
        ("genicam:ID", "builtin:64x48@50"),
        ("/srv/shots", f"{tmp_path}/shots"),
        ("/etc/panchroma", str(tmp_path)),
    ):
        command = command.replace(here, there)
    with start(*command.split()[1:]) as process:
        assert ".dng" in process.stdout.readline()
        ended(process, signal.SIGTERM, code=0)
    assert read_dng((tmp_path / "shots" / "latest.dng").resolve()).shape == (48, 64)
