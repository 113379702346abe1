"""`capture --pattern auto`: the first frames tell the tile, and none of them is lost."""

import fcntl
import signal
import subprocess
import termios
import time
from pathlib import Path

import numpy as np
import pytest

from device.capture import frame_folder, identify
from shared import read_dng
from shared.arrays import CodeArray
from tests.device.capture.test_identification import SCENE, taken, tile_of
from tests.tools.command import run, start
from tests.tools.commands.test_capture import piped, shots

KODAK = taken(SCENE, tile_of("Kodak", (1, 2)))
DARK = np.full_like(KODAK, 256)
BAYER = taken(SCENE, tile_of("RG/GB"))
LAYOUT = ("--width", str(KODAK.shape[1]), "--height", str(KODAK.shape[0]), "--pixel-format", "Y12", "--pattern", "auto")


@pytest.fixture
def frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(frame_folder, "_POLL", 0.01)
    monkeypatch.setattr(frame_folder, "_PATIENCE", 0.02)
    folder = tmp_path / "frames"
    folder.mkdir()
    return folder


def test_the_pattern_of_the_first_frame_that_shows_one_is_recorded_in_all(out: Path) -> None:
    data = b"".join(frame.astype("<u2").tobytes() for frame in (DARK, KODAK, KODAK))
    done = piped(data, "-o", str(out), *LAYOUT, "--wait", code=0)
    recorded = [read_dng(path) for path in shots(out)]
    assert [shot.codes.max() > 256 for shot in recorded] == [False, True, True]
    assert {shot.pattern.letters_from() for shot in recorded} == {identify(KODAK).tile}
    assert "the first frames show the tile Kodak" in done.err
    assert "as red and blue, may be exchanged" in done.err


def test_a_folder_gives_every_frame_and_refuses_what_is_none(frames: Path, out: Path) -> None:
    (frames / "0.bin").write_bytes(b"no frame")
    (frames / "1.raw").write_bytes(KODAK.astype("<u2").tobytes())
    outcome = run("capture", frames, "-o", out, *LAYOUT, "--frames", "1")
    assert read_dng(*shots(out)).pattern.name == "Kodak"
    assert all("0.bin: 8 bytes are not a frame" in error for error in outcome.errors)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (DARK, "the first 4 frames show no pattern of filters; --pattern auto takes a tile with a name, light and colours"),
        (BAYER, "the first 4 frames show Bayer, "),
    ],
)
def test_what_does_not_tell_a_tile_is_refused(frames: Path, out: Path, frame: CodeArray, words: str) -> None:
    for number in range(4):
        (frames / f"{number}.raw").write_bytes(frame.astype("<u2").tobytes())
    outcome = run("capture", frames, "-o", out, *LAYOUT, code=2)
    assert words in outcome.errors[0]
    assert not list(out.glob("*"))


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_signal_ends_it_while_it_waits_for_the_first_frame(out: Path, number: signal.Signals, code: int) -> None:
    with start("capture", "-", "-o", out / "shots", *LAYOUT, stdin=subprocess.PIPE) as process:
        process.stdin.write("a part of a frame")
        process.stdin.flush()
        while fcntl.ioctl(process.stdin, termios.FIONREAD, b"    ") != bytes(4):  # until the pipe has been read from
            time.sleep(0.02)
        process.send_signal(number)
        assert process.wait(60) == code
    assert not list(out.iterdir())
