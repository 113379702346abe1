"""`panchroma capture`: streams, folders and the built-in sensor become shots, and none of their frames is lost unsaid."""

import json
import os
import resource
import signal
import subprocess
import threading
import time
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from panchroma.device.capture import frame_folder
from panchroma.device.capture.frames import FrameLayout
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, read_camera, read_dng
from panchroma.shared.arrays import ByteArray
from panchroma.tools.capture import recorder
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive
from tests.device.packer import pack, random_codes
from tests.shared.test_white_balance import LIGHT
from tests.shared.test_white_balance import shot as coloured_light
from tests.tools.command import Outcome, ended, names, shots, spawn, start
from tests.tools.command import run as command

SIZE, SHOWN = (20, 30), (96, 128)
LAYOUT = ["--size", "30x20", "--pixel-format", "SRGGB12_CSI2P", "--stride", "64"]
DESCRIBED = ["--size", "128x96", "--pixel-format", "raw12"]
ENDING = pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])


def frame(seed: int) -> bytes:
    return pack(random_codes(SIZE, 12, seed), "raw12", 64)


def run(*arguments: str | Path, code: int | None = None) -> Outcome:
    """The command, run in this process."""
    return command("capture", *arguments, code=code)


def from_recording(data: bytes, *arguments: str, code: int | None = None) -> Outcome:
    """The command with a recording as standard input."""
    with NamedTemporaryFile() as recording:
        recording.write(data)
        recording.flush()
        with open(recording.name, "rb") as file, patch("sys.stdin", file):  # noqa: PTH123
            return run("-", *arguments, code=code)


def recorded(folder: Path, data: bytes, *arguments: str | Path, code: int) -> str:
    """What the command says with a file as standard input."""
    recording = folder / "recording"
    recording.write_bytes(data)
    with recording.open("rb") as file:
        return spawn("capture", "-", *arguments, stdin=file, code=code).err


def codes(folder: Path) -> list[bytes]:
    """The samples of its shots."""
    return [read_dng(path).codes.tobytes() for path in shots(folder)]


@pytest.fixture
def frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for frames, which is looked at often."""
    monkeypatch.setattr(frame_folder, "_POLL", 0.01)
    monkeypatch.setattr(frame_folder, "_PATIENCE", 0.05)
    (tmp_path / "frames").mkdir()
    return tmp_path / "frames"


def test_a_stream_becomes_shots(out: Path, tmp_path: Path) -> None:
    latest = tmp_path / "latest"
    done = from_recording(b"".join(map(frame, range(3))), "-o", str(out), *LAYOUT, "--json", "--latest", str(latest), code=0)
    assert [record["output"] for record in done.records] == [str(path) for path in shots(out)]
    assert all(record["ok"] and record["preview_ms"] > 0 and record["write_ms"] > 0 for record in done.records)
    assert [record["dropped"] for record in done.records] == [0, 0, 0]
    assert codes(out) == [random_codes(SIZE, 12, seed).tobytes() for seed in range(3)]
    assert {read_dng(path).calibration for path in shots(out)} == {SensorCalibration.of_bits(12, headroom=False)}
    assert latest.resolve() == shots(out)[-1]
    lines = done.err.splitlines()
    assert "no `camera`: black level 256 and white level 4095 are assumed, and the white balance is estimated" in lines
    assert lines[-1] == "3 saved, 0 dropped"


def test_a_stream_that_is_cut_keeps_its_whole_frames_and_fails(out: Path) -> None:
    done = from_recording(frame(0) + frame(1) + frame(2)[:100], "-o", str(out), *LAYOUT, code=1)
    assert len(shots(out)) == 2
    assert "ended in the middle of a frame, 100 bytes after 2 whole ones" in done.err
    assert done.err.endswith("2 saved, 0 dropped, 1 failed\n")


def test_a_recording_in_a_file_waits_by_itself(out: Path, tmp_path: Path) -> None:
    assert "12 saved, 0 dropped" in recorded(tmp_path, b"".join(map(frame, range(12))), "-o", out, *LAYOUT, code=0)
    assert len(shots(out)) == 12


def shown(stride: int = 0) -> bytes:
    """A frame of a scene, which shows the pattern."""
    scene = builtin_scene(SHOWN[1], SHOWN[0]).rgb
    calibration = SensorCalibration.of_bits(12, headroom=False)
    codes = simulate_additive(scene, CfaPattern.bayer(6), calibration, 0.01, np.random.default_rng(0)).codes
    return pack(codes, "raw12", stride)


@pytest.mark.parametrize(
    ("data", "options", "words"),
    [
        (shown(224) * 6, [], "; run `panchroma identify FRAME --size 128x96 --pixel-format raw12 --stride 192`"),
        (shown() * 2, ["--pattern", "GRWWWW/BGWWWW" + 4 * "/WWWWWW"], "the two greens of a block lie on the other diagonal"),
    ],
)
def test_a_wrong_description_saves_nothing_unless_unchecked(out: Path, data: bytes, options: list[str], words: str) -> None:
    done = from_recording(data, "-o", str(out), *DESCRIBED, *options, code=1)
    assert words in done.err
    assert "If the description is right, add `unchecked`" in done.err
    assert shots(out) == []
    from_recording(data, "-o", str(out), *DESCRIBED, *options, "--unchecked", code=0)
    assert len(shots(out)) == len(data) // (96 * 192)


def test_a_recording_whose_size_tells_another_stride_is_refused(out: Path, tmp_path: Path) -> None:
    for options, code, words in (([], 2, "likely `stride=256`"), (["--unchecked"], 1, "whole frames with `stride=256`: discard")):
        assert words in recorded(tmp_path, bytes(256 * 96), "-o", out, *DESCRIBED, *options, code=code)


@pytest.mark.parametrize(
    ("number", "code", "burst", "said"),
    [
        (signal.SIGINT, 130, (), "1 saved, 0 dropped\n"),
        (signal.SIGTERM, 0, (), "1 saved, 0 dropped\n"),
        (signal.SIGINT, 130, ("--burst", "3"), "0 saved, 3 dropped\n"),
    ],
)
def test_a_signal_ends_a_silent_camera(out: Path, number: signal.Signals, code: int, burst: tuple[str, ...], said: str) -> None:
    process = start("capture", "-", "-o", out, *LAYOUT, *burst, stdin=subprocess.PIPE)
    process.stdin.buffer.write(frame(0))  # type: ignore[attr-defined]
    process.stdin.flush()
    assert "no `camera`" in process.stderr.readline()
    assert "the frame " in process.stderr.readline()  # the first has come
    assert burst or "dropped 0" in process.stdout.readline()
    assert ended(process, number, code=code).err == said
    assert len(names(out)) == (0 if burst else 1)


@ENDING
def test_a_signal_waits_for_the_frame_in_hand(
    out: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: int
) -> None:
    def interrupted(mosaic: Mosaic) -> ByteArray:
        os.kill(os.getpid(), number)
        for _ in range(100):  # the handler runs between two of these
            time.sleep(0)
        return np.zeros((*mosaic.shape, 3), np.uint8)

    monkeypatch.setattr(recorder, "preview_maker", lambda *_, **__: interrupted)
    before = signal.getsignal(number)
    run("builtin:64x48@50", "-o", out, code=code)
    assert len(codes(out)) == 1
    assert [path.suffix for path in out.iterdir()] == [".dng"]
    assert signal.getsignal(number) == before


def test_the_built_in_sensor_moves_and_has_noise_and_colour(out: Path) -> None:
    run("builtin:96x64@50", "-o", out, "--frames", "3", "--pattern", "K=4", "--origin", "1,2", code=0)
    one, two, three = (read_dng(path) for path in shots(out))
    assert (one.shape, one.pattern) == ((64, 96), CfaPattern.bayer(4, origin=(1, 2)))
    assert None not in (one.calibration.camera_to_xyz, one.calibration.noise)
    assert len({shot.codes.tobytes() for shot in (one, two, three)}) == 3


def test_the_camera_file_is_the_shot_s_calibration(out: Path, tmp_path: Path) -> None:
    camera = SensorCalibration(gamma=(0.8, 1.0, 0.9), black_level=(60.0, 61.0, 62.0, 63.0), white_level=4000, sensor="mine")
    file = tmp_path / "camera.json"
    file.write_text(json.dumps(camera.to_json()))
    done = from_recording(frame(0), "-o", str(out), *LAYOUT, "--camera", str(file), code=0)
    assert read_dng(shots(out)[0]).calibration == read_camera(file).calibration
    assert "no --camera" not in done.err


SHADED = {"shading": {"gain": [[[1.0] * 4] * 4] * 4, "size": [20, 30]}}


@pytest.mark.parametrize("maps", [SHADED, {"size": [20, 30]}, {"defects": [[3, 29], [19, 3]]}])
@pytest.mark.parametrize(("wide", "high"), [(28, 20), (26, 18), (15, 10), (30, 19)])
def test_frames_of_another_size_than_the_camera_file_s_are_refused(
    out: Path, tmp_path: Path, maps: dict[str, Any], wide: int, high: int
) -> None:
    file, camera = tmp_path / "camera.json", SensorCalibration.of_bits(12).to_json()
    file.write_text(json.dumps(camera | maps))
    options = ("-o", str(out), "--camera", str(file))
    described = (*options, "--pixel-format", "raw12", "--size", f"{wide}x{high}")
    simulated = f"builtin:{wide}x{high}@9"
    for source, done in (
        ("-", from_recording(b"", *described, code=2)),
        (tmp_path, run(tmp_path, *described, code=2)),
        (simulated, run(simulated, *options, code=2)),
    ):
        assert f"{source}: the frames have {wide} x {high} pixels, those of the camera file 30 x 20" in done.err
        assert 'take a copy of this one without "size", "shading"' in done.err
    run("builtin:30x20@9", *options, "--frames", "1", code=0)


def test_frames_that_do_not_come_are_missed(out: Path) -> None:
    assert "-: ended after 1 of 2 shots" in from_recording(frame(0), "-o", str(out), *LAYOUT, "--frames", "2", code=1).err
    assert len(shots(out)) == 1


def test_without_a_camera_file_white_is_estimated_marked_and_steady(out: Path) -> None:
    data = b"".join(coloured_light(light).codes.astype("<u2").tobytes() for light in (LIGHT, (1.0, 0.7, 0.3), LIGHT))
    layout = ("--size", "200x150", "--pixel-format", "u16", "--bits", "12")
    from_recording(data, "-o", str(out), *layout, code=0)
    neutrals = [read_dng(path).calibration.neutral for path in shots(out)]
    assert np.allclose(np.array(neutrals), LIGHT, atol=0.09)
    first = shots(out)[0]
    assert "estimated from the picture" in command("inspect", first).out


def test_a_burst_is_saved_under_one_name_however_fast_it_comes(out: Path) -> None:
    done = from_recording(b"".join(map(frame, range(40))), "-o", str(out), *LAYOUT, "--burst", "12", code=0)
    assert done.err.endswith("12 saved, 0 dropped\n")
    (stem,) = {path.stem.rpartition("-")[0] for path in shots(out)}
    assert [path.stem.removeprefix(stem) for path in shots(out)] == [f"-{number:02}" for number in range(1, 13)]
    assert codes(out) == [random_codes(SIZE, 12, seed).tobytes() for seed in range(12)]


def test_a_burst_of_more_files_than_may_be_open_is_refused_before_it_is_taken(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits = resource.getrlimit
    monkeypatch.setattr(resource, "getrlimit", lambda which: (256, 4096) if which == resource.RLIMIT_NOFILE else limits(which))
    done = run("builtin:64x48@9", "-o", out, "--burst", "250", code=2)
    assert "--burst is 250, and a program may open 256 files here; take fewer, or allow more: ulimit -n 314" in done.err
    assert names(out.parent) == {out.name}
    assert names(out) == set()


def test_a_folder_s_frames_become_shots_and_stay(out: Path, frames: Path) -> None:
    (frames / "0.raw").write_bytes(frame(0)[:-1])
    threading.Timer(0.5, lambda: (frames / "1.raw").write_bytes(frame(1))).start()
    heard = run(frames, "-o", out, *LAYOUT, "--frames", "1", code=1)  # one is no frame
    assert names(frames) == {"0.raw", "1.raw"}
    assert codes(out) == [random_codes(SIZE, 12, 1).tobytes()]
    assert "0.raw: 1279 bytes are not a frame" in heard.err
    assert heard.err.endswith("1 saved, 0 dropped, 1 failed\n")


@pytest.mark.parametrize(("options", "black"), [(["--unchecked"], 256.0), (["--black", "16"], 16.0)])
def test_the_first_darks_of_a_sensor_with_a_low_black_level_can_be_captured(out: Path, options: list[str], black: float) -> None:
    """`calibrate --dark` needs them; without the options frames are refused."""
    levels = np.random.default_rng(0).normal(16, 3, SHOWN).round().clip(0).astype(np.uint16)
    data = pack(levels, "raw12", 0) * 2
    from_recording(data, "-o", str(out), *DESCRIBED, code=1)
    done = from_recording(data, "-o", str(out), *DESCRIBED, *options, code=0)
    assert [read_dng(path).calibration.black_level for path in shots(out)] == [(black,) * 4] * 2
    assert (f"black level {black:.0f}" in done.err) == ("--black" not in options)


# --- a stream that slips -------------------------------------------------------------------------------------------------------


def moving(count: int) -> list[bytes]:
    """Frames of a scene that moves, in raw12."""
    scene = builtin_scene(400, 280).rgb
    calibration, noise = SensorCalibration.of_bits(12, headroom=False), np.random.default_rng(0)
    parts = (scene[5 * n : 5 * n + 220, 9 * n : 9 * n + 310] for n in range(count))
    frames = (simulate_additive(part, CfaPattern.bayer(6), calibration, 0.01, noise).codes for part in parts)
    return [pack(frame, "raw12") for frame in frames]


MOVING = ("--size", "310x220", "--pixel-format", "raw12")
LINE = 465  # bytes


@pytest.mark.parametrize(
    ("place", "lost"), [(100 * LINE, LINE), (30001, 1), (0, 3), (44444, 4096), (99, -1), (20000, -LINE), (777, -3)]
)
def test_a_stream_that_loses_or_gains_bytes_ends_at_once_and_its_shots_are_right(out: Path, place: int, lost: int) -> None:
    frames = moving(8)
    slipped = frames[5][:place] + b"\xa5" * -lost + frames[5][place + max(lost, 0) :]
    done = from_recording(b"".join([*frames[:5], slipped, *frames[6:], *frames]), "-o", str(out), *MOVING, code=1)
    assert [read_dng(path).codes.tobytes() for path in shots(out)] == [unpacked(frame) for frame in frames[:5]]
    assert "the stream has lost or gained bytes; start the camera again" in done.err
    assert f"{shots(out)[-1]}: its last rows may be wrong; all shots before it are right" in done.err


def unpacked(frame: bytes) -> bytes:
    return FrameLayout(310, 220, "raw12").unpack(frame).tobytes()


@pytest.mark.parametrize("lost", [LINE, 1])
def test_shots_in_the_dark_before_a_slip_is_seen_are_named(out: Path, lost: int) -> None:
    frames, dark = moving(3), pack(np.random.default_rng(0).normal(256, 3, (220, 310)).round().astype(np.uint16), "raw12")
    data = b"".join([*frames, dark * 2, dark[lost:], dark, *frames])
    done = from_recording(data, "-o", str(out), *MOVING, code=1)
    saved = shots(out)
    assert len(saved) == (5 if lost == 1 else 7)  # single bytes are seen in the dark
    assert f"{len(saved) - 2} shots may be wrong, {saved[2]} to {saved[-1]}; all before them are right" in done.err


def test_of_a_burst_that_slips_nothing_is_saved(out: Path) -> None:
    frames = moving(8)
    done = from_recording(b"".join(frames)[:-40000] + bytes(30000), "-o", str(out), *MOVING, "--burst", "7", code=0)
    assert len(shots(out)) == 7
    data = b"".join([*frames[:5], frames[5][LINE:], *frames[6:], frames[0]])
    done = from_recording(data, "-o", str(out), *MOVING, "--burst", "7", code=1)
    assert len(shots(out)) == 7
    assert "the stream has lost or gained bytes" in done.err


def test_a_file_that_is_not_like_those_before_it_is_refused_alone(out: Path, frames: Path) -> None:
    scene = moving(4)
    for number, frame in enumerate([*scene[:3], scene[3][LINE:] + scene[0][:LINE], scene[3]]):
        (frames / f"{number}.raw").write_bytes(frame)
        os.utime(frames / f"{number}.raw", (number, number))
    done = run(frames, "-o", out, *MOVING, "--frames", "4", code=1)
    assert codes(out) == [unpacked(frame) for frame in scene]
    assert done.errors[0].partition(": ")[2].startswith(f"{frames / '3.raw'}: the frame does not show")
