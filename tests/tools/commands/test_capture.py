"""`panchroma capture`: streams, folders and the built-in sensor become shots, and none of their
frames is lost unsaid.

What is in a shot, how it is named and what a first frame proves: tests/device/capture.
"""

import json
import os
import re
import resource
import signal
import subprocess
import time
from functools import cache
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from panchroma.device.capture import frame_folder
from panchroma.device.capture.frames import FrameLayout
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, read_camera, read_dng
from panchroma.shared.arrays import ByteArray, FloatArray
from panchroma.tools.batch.signals import Stopping
from panchroma.tools.commands import capture as capture_command
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive
from tests.device.packer import pack, random_codes
from tests.tools.command import Outcome, ended, names, shots, start
from tests.tools.command import run as command

SIZE = (20, 30)
LAYOUT = "--size 30x20 --pixel-format SRGGB12_CSI2P --stride 64"
SHOWN, DESCRIBED = (96, 128), "--size 128x96 --pixel-format raw12"
CALIBRATION = SensorCalibration.of_bits(12, headroom=False)


def frame(seed: int) -> bytes:
    return pack(random_codes(SIZE, 12, seed), "raw12", 64)


def photographed(scene: FloatArray, stride: int = 0, seed: int = 0) -> bytes:
    """A frame of a scene, in raw12, which shows the pattern."""
    rng = np.random.default_rng(seed)
    shot = simulate_additive(scene, CfaPattern.bayer(6), CALIBRATION, 0.01, rng)
    return pack(shot.codes, "raw12", stride)


def dark(black: float, shape: tuple[int, int]) -> bytes:
    """A frame without light, in raw12."""
    noise = np.random.default_rng(0).normal(black, 3, shape)
    return pack(noise.round().clip(0).astype(np.uint16), "raw12", 0)


def run(*arguments: str | Path, code: int | None = None) -> Outcome:
    """The command, run in this process."""
    return command("capture", *arguments, code=code)


def from_recording(data: bytes, *arguments: str | Path, code: int | None = None) -> Outcome:
    """The command with a recording as standard input."""
    with NamedTemporaryFile() as recording:
        recording.write(data)
        recording.flush()
        with open(recording.name, "rb") as file, patch("sys.stdin", file):  # noqa: PTH123
            return run("-", *arguments, code=code)


def codes(folder: Path) -> list[bytes]:
    """The samples of its shots."""
    return [read_dng(path).codes.tobytes() for path in shots(folder)]


@pytest.fixture
def frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for frames, which is looked at often."""
    monkeypatch.setattr(frame_folder, "_POLL_FOLDER", 0.01)
    monkeypatch.setattr(frame_folder, "_PATIENCE", 0.05)
    monkeypatch.setattr(frame_folder, "_UNFINISHED_PATIENCE", 0.1)
    (tmp_path / "frames").mkdir()
    return tmp_path / "frames"


def test_a_stream_becomes_shots(out: Path) -> None:
    data = b"".join(map(frame, range(3)))
    done = from_recording(data, "-o", out, LAYOUT, "--json", code=0)
    assert [record["output"] for record in done.records] == [str(path) for path in shots(out)]
    for record in done.records:
        assert (record["ok"], record["dropped"]) == (True, 0)
        assert min(record["preview_ms"], record["write_ms"]) > 0
    assert codes(out) == [random_codes(SIZE, 12, seed).tobytes() for seed in range(3)]
    assert {read_dng(path).calibration for path in shots(out)} == {CALIBRATION}
    levels = "black level 256 and white level 4095 are taken"
    assert f"no --camera: {levels}, and the white balance is estimated\n" in done.err
    assert done.err.endswith("\n3 saved, 0 dropped\n")


def test_frames_that_do_not_come_are_missed(out: Path) -> None:
    done = from_recording(frame(0), "-o", out, LAYOUT, "--frames 2", code=1)
    assert "-: ended after 1 of 2 shots" in done.err
    assert len(shots(out)) == 1


def test_a_wrong_description_saves_nothing_unless_unchecked(out: Path) -> None:
    data = 6 * photographed(builtin_scene(*SHOWN[::-1]).rgb, stride=224)
    done = from_recording(data, "-o", out, DESCRIBED, code=1)
    assert f"; run `panchroma identify FRAME {DESCRIBED} --stride 192`" in done.err
    assert "If the description is right, add --unchecked" in done.err
    done = from_recording(bytes(256 * 96), "-o", out, DESCRIBED, code=2)
    assert "likely --stride 256" in done.err
    assert shots(out) == []
    from_recording(data, "-o", out, DESCRIBED, "--unchecked", code=0)
    assert len(shots(out)) == len(data) // (96 * 192)


def test_the_black_level_of_a_sensor_can_be_stated(out: Path) -> None:
    """Frames darker than the usual one are refused without it."""
    data = dark(16, SHOWN)
    from_recording(data, "-o", out, DESCRIBED, code=1)
    done = from_recording(data, "-o", out, DESCRIBED, "--black 16", code=0)
    assert read_dng(shots(out)[0]).calibration.black_level == (16.0,) * 4
    assert "no --camera: black level 16 and white level 4095 are taken" in done.err


ENDED = "the frames ended after [01] of 3 of the burst; none of them is saved\n"


@pytest.mark.parametrize(
    ("number", "code", "burst", "said"),
    [
        (signal.SIGTERM, 0, "", "1 saved, 0 dropped\n"),
        (signal.SIGINT, 130, " --burst 3", f"{ENDED}0 saved, [01] dropped\n"),
    ],
)
def test_a_signal_ends_a_silent_camera(
    out: Path, number: signal.Signals, code: int, burst: str, said: str
) -> None:
    process = start("capture - -o", out, LAYOUT + burst, stdin=subprocess.PIPE)
    process.stdin.buffer.write(frame(0))  # type: ignore[attr-defined]
    process.stdin.flush()
    assert "no --camera" in process.stderr.readline()
    assert "the frame " in process.stderr.readline()  # the first has come
    assert burst or "dropped 0" in process.stdout.readline()
    assert re.fullmatch(said, ended(process, number, code=code).err)
    assert len(names(out)) == (0 if burst else 1)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_signal_waits_for_the_frame_in_hand(
    out: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: int
) -> None:
    def interrupted(mosaic: Mosaic) -> ByteArray:
        os.kill(os.getpid(), number)
        for _ in range(100):  # the handler runs between two of these
            time.sleep(0)
        return np.zeros((*mosaic.shape, 3), np.uint8)

    monkeypatch.setattr(capture_command, "preview_maker", lambda *_, **__: interrupted)
    before = signal.getsignal(number)
    run("builtin:64x48@50", "-o", out, code=code)
    assert [path.suffix for path in out.iterdir()] == [".dng"]
    assert len(codes(out)) == 1
    assert signal.getsignal(number) == before


def test_the_built_in_sensor_moves_and_has_noise_and_colour(out: Path) -> None:
    run("builtin:96x64@50", "-o", out, "--frames 3 --pattern K=4 --origin 1,2", code=0)
    one, two, three = (read_dng(path) for path in shots(out))
    assert (one.shape, one.pattern) == ((64, 96), CfaPattern.bayer(4, origin=(1, 2)))
    assert None not in (one.calibration.camera_to_xyz, one.calibration.noise)
    assert len({shot.codes.tobytes() for shot in (one, two, three)}) == 3


SHADING = {"gain": [[[1.0] * 4] * 4] * 4, "size": [20, 30]}


@pytest.mark.parametrize(
    "maps", [{"shading": SHADING}, {"size": [20, 30]}, {"defects": [[3, 29], [19, 3]]}]
)
def test_the_camera_file_is_the_calibration_of_shots_of_its_size_alone(
    out: Path, tmp_path: Path, maps: dict[str, Any]
) -> None:
    camera, file = SensorCalibration.of_bits(12, gamma=(0.8, 1.0, 0.9)), tmp_path / "camera.json"
    file.write_text(json.dumps(camera.to_json() | maps))
    options = ("-o", out, "--camera", file)
    done = run("builtin:26x18@9", *options, code=2)
    sizes = "the frames have 26 x 18 pixels, those of the camera file 30 x 20"
    assert f"builtin:26x18@9: {sizes}" in done.err
    assert 'take a copy of this one without "size", "shading"' in done.err
    done = from_recording(frame(0), *options, LAYOUT, code=0)
    assert read_dng(shots(out)[0]).calibration == read_camera(file).calibration
    assert "no --camera" not in done.err


def test_a_burst_is_saved_under_one_name_however_fast_it_comes(out: Path) -> None:
    data = b"".join(map(frame, range(40)))
    done = from_recording(data, "-o", out, LAYOUT, "--burst 12", code=0)
    assert done.err.endswith("12 saved, 0 dropped\n")
    (stem,) = {path.stem.rpartition("-")[0] for path in shots(out)}
    assert names(out) == {f"{stem}-{number:02}.dng" for number in range(1, 13)}
    assert codes(out) == [random_codes(SIZE, 12, seed).tobytes() for seed in range(12)]


def test_all_frames_of_a_burst_are_reported_whatever_ends_the_program(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Stopping, "__call__", lambda self: bool(shots(out)))
    done = from_recording(b"".join(map(frame, range(5))), "-o", out, LAYOUT, "--burst 5 --json")
    assert [record["output"] for record in done.records] == [str(path) for path in shots(out)]


def test_a_burst_of_too_many_files_is_refused(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = resource.getrlimit
    limits = {resource.RLIMIT_NOFILE: (256, 4096)}
    monkeypatch.setattr(resource, "getrlimit", lambda which: limits.get(which) or before(which))
    done = run("builtin:64x48@9", "-o", out, "--burst 250", code=2)
    refusal = "--burst is 250, and a program may open 256 files here; take fewer, or allow more"
    assert f"{refusal}: ulimit -n 314" in done.err
    assert names(out) == set()


# --- a stream that slips -------------------------------------------------------------------------

MOVING = "--size 310x220 --pixel-format raw12"
LINE = 465  # bytes
SLIPPED = "the stream has lost or gained bytes; start the camera again"


@cache
def moving(count: int) -> list[bytes]:
    """Frames of a scene that moves."""
    scene, shape = builtin_scene(400, 280).rgb, (220, 310)
    places = [np.s_[5 * n : 5 * n + shape[0], 9 * n : 9 * n + shape[1]] for n in range(count)]
    return [photographed(scene[place], seed=n) for n, place in enumerate(places)]


def unpacked(frame: bytes) -> bytes:
    return FrameLayout(310, 220, "raw12").unpack(frame).tobytes()


@pytest.mark.parametrize(
    ("place", "lost"), [(100 * LINE, LINE), (30001, 1), (44444, 4096), (20000, -LINE), (777, -3)]
)
def test_a_slip_ends_the_stream_and_its_shots_are_right(out: Path, place: int, lost: int) -> None:
    frames = moving(8)
    slipped = frames[5][:place] + b"\xa5" * -lost + frames[5][place + max(lost, 0) :]
    data = b"".join([*frames[:5], slipped, *frames[6:], *frames])
    done = from_recording(data, "-o", out, MOVING, code=1)
    assert codes(out) == [unpacked(frame) for frame in frames[:5]]
    assert SLIPPED in done.err
    assert f"\n{shots(out)[-1]} and later shots may be wrong; all shots before it" in done.err


@pytest.mark.parametrize("lost", [LINE, 1])
def test_shots_in_the_dark_before_a_slip_is_seen_are_named(out: Path, lost: int) -> None:
    frames, black = moving(3), dark(256, (220, 310))
    data = b"".join([*frames, black * 2, black[lost:], black, *frames])
    done = from_recording(data, "-o", out, MOVING, code=1)
    saved = shots(out)
    assert len(saved) == (5 if lost == 1 else 7)  # single bytes are seen in the dark
    assert f"\n{saved[2]} and later shots may be wrong; all shots before it" in done.err


def test_a_file_that_is_not_like_those_before_it_is_refused_alone(out: Path, frames: Path) -> None:
    scene = moving(4)
    for number, frame in enumerate([*scene[:3], scene[3][LINE:] + scene[0][:LINE], scene[3]]):
        (frames / f"{number}.raw").write_bytes(frame)
        os.utime(frames / f"{number}.raw", (number, number))
    done = run(frames, "-o", out, MOVING, "--frames 4", code=1)
    assert codes(out) == [unpacked(frame) for frame in scene]
    assert done.errors[0].startswith(f"panchroma: {frames}/3.raw: the frame does not show")
    assert "it is of another camera, or its file is damaged; leave it out" in done.errors[0]


def test_a_stream_that_is_cut_off_names_the_shots_that_may_be_wrong(out: Path) -> None:
    done = from_recording(b"".join(moving(5))[:-LINE], "-o", out, MOVING, code=1)
    assert f"\n{shots(out)[-1]} and later shots may be wrong; all shots before it" in done.err
