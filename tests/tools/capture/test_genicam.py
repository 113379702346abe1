"""`capture` and `view` from a GigE Vision camera: Aravis' fake one, through the real protocol."""

import re
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from panchroma.shared import CfaPattern, InputError, read_dng
from panchroma.tools.capture.genicam import load_aravis
from tests.device.capture.test_frame_check import PATTERN, SIZE, codes
from tests.device.packer import pack
from tests.tools.capture.fake_camera import ALONE, FakeCamera
from tests.tools.command import Outcome, ended, run, shots, spawn, start

# PFNC's name and code, ours, bits.
MONO8 = ("Mono8", 0x01080001, "u8", 8)
MONO12 = ("Mono12", 0x01100005, "u16", 12)
MONO12P = ("Mono12p", 0x010C0047, "mono12p", 12)
SCF1WGWR12P = ("SCF1WGWR12p", 0x010C0079, "mono12p", 12)
SOURCE = "genicam:127.0.0.1"
TILE = ["--pattern", "K=6", "--origin", "2,1"]
Plug = Callable[..., FakeCamera]


def missing() -> str:
    """Why there can be no camera here; "" if there can."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # PyGObject's own
            load_aravis()
        subprocess.run([*ALONE, "nsenter", "--version"], capture_output=True, check=True)
    except (OSError, InputError, subprocess.CalledProcessError) as error:
        return str(error)
    return ""


MISSING = missing()
needs_camera = pytest.mark.skipif(bool(MISSING), reason=f"GenICam: {MISSING}")


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    """Connects a camera of this pattern."""
    cameras = []

    def plugged(
        kind: tuple[str, int, str, int] = MONO12, pattern: CfaPattern = PATTERN, lost: int = 0
    ) -> FakeCamera:
        name, code, ours, bits = kind
        frame = pack(codes(pattern, bits), ours)
        cameras.append(FakeCamera(tmp_path, SIZE, name, code, frame, lost))
        return cameras[-1]

    yield plugged
    for camera in cameras:
        camera.kill()


def capture(
    camera: FakeCamera, *arguments: str | Path, source: str = SOURCE, code: int | None = None
) -> Outcome:
    return spawn("capture", source, *arguments, before=camera.beside, code=code)


def capturing(camera: FakeCamera, out: Path) -> subprocess.Popen[str]:
    """A `capture` that has saved its first shot, and goes on."""
    process = start("capture", SOURCE, "-o", out, *TILE, before=camera.beside)
    assert ".dng" in process.stdout.readline()
    return process


@needs_camera
@pytest.mark.parametrize("kind", [MONO8, MONO12P])  # the other tests take Mono12
def test_shots_have_the_cameras_samples_and_settings(
    plug: Plug, out: Path, kind: tuple[str, int, str, int]
) -> None:
    camera, (name, _, _, bits) = plug(kind), kind
    settings = ["--exposure-time", "1/50", "--gain", "6", "--fps", "25"]
    settings += ["--frames", "2"]
    outcome = capture(camera, "-o", out, *TILE, *settings, code=0)
    about = f"Aravis Fake: 256 x 192 {name}, exposure 0.02 s, gain 6 dB, 25 frames a second"
    assert about in outcome.err
    for path in shots(out):
        mosaic = read_dng(path)
        assert np.array_equal(mosaic.codes, codes(bits=bits))
        assert mosaic.pattern == PATTERN
        assert mosaic.calibration.bits == bits
        metadata = mosaic.metadata
        facts = (metadata.make, metadata.model, metadata.exposure_time, metadata.iso)
        assert facts == ("Aravis", "Fake", 0.02, 200)
        assert metadata.description == "gain 6 dB, 25 frames a second"
    assert len(shots(out)) == 2


@needs_camera
def test_a_sparse_filter_is_known_with_its_phase_and_a_burst_taken(plug: Plug, out: Path) -> None:
    pattern = CfaPattern.of_letters("WGWR/GWRW/WBWG/BWGW")
    camera = plug(SCF1WGWR12P, pattern)
    capture(camera, "-o", out, "--burst", "3", source="genicam:Aravis-Fake-GV01", code=0)
    assert len(shots(out)) == 3
    for path in shots(out):
        assert read_dng(path).pattern.letters_from((0, 0)) == pattern.letters_from((0, 0))
    refused = capture(camera, "-o", out, "--pattern", "paper", code=2)
    assert "the camera says where its filters are" in refused.err


@needs_camera
def test_frames_that_miss_packets_are_counted_and_dropped(plug: Plug, out: Path) -> None:
    # one frame of four arrives whole
    outcome = capture(plug(lost=20), "-o", out, *TILE, "--frames", "3", "--fps", "50", code=0)
    assert all(np.array_equal(read_dng(path).codes, codes()) for path in shots(out))
    assert re.search(r"3 saved, [1-9]\d* dropped\n$", outcome.err), outcome.err


@needs_camera
def test_two_programs_and_then_an_unplugged_camera(plug: Plug, out: Path) -> None:
    camera = plug()
    first = capturing(camera, out)
    assert "another program has the camera" in capture(camera, "-o", out, *TILE, code=2).err
    ended(first, signal.SIGINT, code=130)
    third = capturing(camera, out)  # at once: the first has let it go
    camera.process.kill()
    message = r"genicam:127\.0\.0\.1: the camera is gone after \d+ whole frames: it was unplugged"
    assert re.search(f"panchroma: {message}", ended(third, code=1).err)
    assert all(np.array_equal(read_dng(path).codes, codes()) for path in shots(out))
    assert {path.suffix for path in out.iterdir()} == {".dng"}


@needs_camera
def test_after_a_crash_the_camera_sends_to_the_next_program(plug: Plug, out: Path) -> None:
    """It would go on sending to the one that was killed, had the next one not told it to stop."""
    camera = plug()
    ended(capturing(camera, out), signal.SIGKILL)
    once = ("--frames", "1")
    while "another program" in (outcome := capture(camera, "-o", out, *TILE, *once)).err:
        time.sleep(0.2)
    assert outcome.code == 0, outcome.err


@needs_camera
def test_a_camera_that_sends_nothing_whole_is_told(plug: Plug, out: Path) -> None:
    process = start("capture", SOURCE, "-o", out, *TILE, before=plug(lost=1000).beside)
    lines = "".join(process.stderr.readline() for _ in range(3))
    assert "no whole frame for 10 seconds: does it wait for a trigger" in lines
    assert ended(process, signal.SIGTERM, code=0).err == "0 saved, 0 dropped\n"


@needs_camera
def test_cameras_are_listed_and_what_they_cannot_do_is_said(plug: Plug, out: Path) -> None:
    camera = plug()
    line = "genicam:Aravis-Fake-GV01  Aravis, Fake, GigEVision, 127.0.0.1\n"
    assert capture(camera, source="genicam:", code=0).out == line
    for wrong, words in (
        (["--pixel-format", "RGB8"], "'RGB8' cannot be used; choose one with --pixel-format: Mono"),
        (["--gain", "-3"], "--gain is -3; the camera takes 0 to 48"),
        (["--exposure-time", "1000"], "--exposure-time is 1000; the camera takes 1e-05 to 10"),
        (["--size", "64x48"], "--size does not go with genicam:127.0.0.1: the camera says it"),
    ):
        assert words in capture(camera, "-o", out, *wrong, code=2).err
    refused = capture(camera, "-o", out, source="genicam:another", code=2)
    assert "'another' not found; genicam: alone lists the cameras" in refused.err


def test_without_aravis_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gi", None)
    assert "apt-get install gir1.2-aravis-0.8 python3-gi" in run("capture", "genicam:", code=2).err
