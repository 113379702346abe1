"""The commands of a camera, run where every package is hidden that the base dependencies do not
bring.
"""

import subprocess
from pathlib import Path

import pytest

from tests.device.packer import pack, random_codes
from tests.python import base_modules, on_camera
from tests.tools.command import SCRIPT


def camera(
    line: str, stdin: bytes = b"", *, terminal: bool = False
) -> subprocess.CompletedProcess[bytes]:
    return on_camera(SCRIPT, *line.split(), stdin=stdin, terminal=terminal)


def test_the_walk_finds_the_base_and_nothing_else() -> None:
    modules = base_modules()
    assert {"numpy", "onnxruntime", "tifffile", "imagecodecs"} <= modules
    assert not modules & {"onnx", "scipy", "rich", "PIL", "rawpy", "pytest", "numba", "offline"}


FRAME = pack(random_codes((26, 32), 10), "raw10")
LAYOUT = "--size 32x26 --pixel-format raw10"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("--version", 0),
        ("simulate flat:96x72 builtin:90x60 -o OUT", 0),
        ("inspect --verify SHOT SHOT2", 0),
        ("inspect --json --verify SHOT", 0),
        ("preview SHOT SHOT2 -o OUT", 0),
        ("preview SHOT --export OUT/graph.onnx", 0),
        (f"identify - {LAYOUT}", 1),  # noise has no pattern
        (f"capture - -o OUT --frames 1 {LAYOUT}", 0),
        (f"view - --bind 127.0.0.1:0 {LAYOUT}", 1),  # the stream ends
        ("render SHOT -o OUT", 1),
        ("burst SHOT SHOT2 -o OUT", 1),
        ("calibrate SHOT -o OUT/camera.json", 1),
        ("evaluate SHOT -o OUT", 1),
        ("demo -o OUT", 1),
    ],
)
def test_a_terminal_gets_what_a_pipe_gets(line: str, code: int, tmp_path: Path) -> None:
    made = camera(f"simulate flat:48x36 flat:36x48 -o {tmp_path}")
    assert made.returncode == 0, made.stderr
    found = []
    for terminal in (False, True):
        out = tmp_path / str(terminal)
        out.mkdir()
        words = line.replace("OUT", str(out)).replace("SHOT2", f"{tmp_path}/flat-36x48.dng")
        words = words.replace("SHOT", f"{tmp_path}/flat-48x36.dng")
        done = camera(words, FRAME, terminal=terminal)
        assert b"package rich" not in done.stdout + done.stderr, done
        found.append((done.returncode, sorted(path.suffix for path in out.iterdir())))
    assert found[0] == found[1]
    assert found[0][0] == code, (done.stdout + done.stderr).decode()
    runs = {"view", "identify"}
    assert (b"is not installed" in done.stdout) == (code == 1 and not runs & {*line.split()})


def test_a_notebook_needs_the_base_alone_but_to_render() -> None:
    script = """
import panchroma
shot = panchroma.simulate("flat:96x72", sigma=0.01)
print(panchroma.preview(shot), panchroma.to_srgb(shot.truth), len(shot._repr_png_()) > 0)
try:
    panchroma.render(shot)
except ModuleNotFoundError as error:
    print(error)
"""
    notebook = ("offline", "pictures", "quality", "shots", "simulation")
    done = on_camera(script, ours=("shared", "device", "tools", *notebook))
    assert done.returncode == 0, done.stderr
    assert b"<Image 96 x 72, 8-bit sRGB> <Image 96 x 72, 8-bit sRGB> True" in done.stdout
    assert b"is not installed; install Panchroma with all that belongs to it" in done.stdout
