import gc
import os
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from panchroma.device.capture import Refused, Saved, Sensor, capture, capture_burst
from panchroma.device.capture.frame_queue import FrameQueue
from panchroma.device.capture.frames import FrameLayout, RawFrame
from panchroma.device.capture.loop import SteadyWhite
from panchroma.device.capture.shots import ShotFolder
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, read_dng
from panchroma.shared.arrays import ByteArray
from panchroma.shared.colorimetry import SRGB_TO_XYZ
from panchroma.shared.dng import read_preview
from panchroma.shared.errors import InputError, OutputError
from tests.device.packer import pack, random_codes
from tests.shared.test_white_balance import LIGHT, shot

SIZE = (26, 32)
CALIBRATION = SensorCalibration.of_bits(10, headroom=False)
SENSOR = Sensor(FrameLayout(SIZE[1], SIZE[0], "raw10", 48), CfaPattern.bayer(), CALIBRATION)
TAKEN = datetime(2026, 3, 9, 7, 5, 1, tzinfo=UTC)


def grey(mosaic: Mosaic) -> ByteArray:
    """Says in its first pixel which frame it is of."""
    return np.repeat((mosaic.codes >> 2).astype(np.uint8)[..., None], 3, axis=-1)


def frame(seed: int, sensor: Sensor = SENSOR, source: str = "") -> RawFrame:
    codes = random_codes((sensor.layout.height, sensor.layout.width), 10, seed)
    return RawFrame(pack(codes, sensor.layout.format, sensor.layout.stride), TAKEN, 0.0, source)


def test_frames_become_shots_with_everything_that_is_known(tmp_path: Path) -> None:
    look = Mock(side_effect=grey)
    outcomes = capture(map(frame, range(3)), SENSOR, look, ShotFolder(tmp_path))
    for seed, (outcome, call) in enumerate(zip(outcomes, look.call_args_list, strict=False)):
        assert isinstance(outcome, Saved)
        assert min(outcome.preview, outcome.write) > 0
        assert read_preview(outcome.path).startswith(b"\xff\xd8")
        saved = read_dng(outcome.path)
        assert np.array_equal(saved.codes, random_codes(SIZE, 10, seed))
        assert np.array_equal(saved.codes, call.args[0].codes)
        assert (saved.pattern, saved.calibration) == (SENSOR.pattern, CALIBRATION)
        taken = f"{saved.metadata.taken.isoformat()}{saved.metadata.zone}"
        assert datetime.fromisoformat(taken) == TAKEN
    assert len(list(tmp_path.iterdir())) == 3


def test_a_frame_that_does_not_fit_is_refused_and_the_rest_go_on(tmp_path: Path) -> None:
    words = Sensor(FrameLayout(SIZE[1], SIZE[0], "u16"), CfaPattern.bayer(), CALIBRATION)
    bright = RawFrame(b"\xff" * words.layout.frame_bytes, TAKEN, 0.0)
    short = RawFrame(b"12", TAKEN, 0.0, "frames/7.raw")
    first, second, third, fourth = capture(
        [frame(0, words), bright, short, frame(1, words)], words, grey, ShotFolder(tmp_path)
    )
    assert isinstance(first, Saved)
    assert second == Refused("a sample is 65535, more than the calibration's 10 bits hold")
    assert isinstance(third, Refused)
    assert third.reason.startswith("frames/7.raw: 2 bytes are not a frame")
    assert isinstance(fourth, Saved)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_burst_is_in_memory_before_the_first_frame_is_saved(tmp_path: Path) -> None:
    given: list[int] = []

    def frames() -> Iterator[RawFrame]:
        for seed in range(9):
            given.append(len(list(tmp_path.iterdir())))
            yield frame(seed)

    saved = [*capture_burst(frames(), 3, SENSOR, grey, ShotFolder(tmp_path))]
    assert given == [0, 0, 0]
    assert len(saved) == len(list(tmp_path.iterdir())) == 3


def test_a_burst_has_the_white_of_its_first_frame(tmp_path: Path) -> None:
    first, second = shot(LIGHT), shot((1.0, 0.7, 0.3))
    layout = FrameLayout(first.shape[1], first.shape[0], "u16")
    frames = [RawFrame(pack(each.codes, "u16"), TAKEN, 0.0) for each in (first, second)]
    sensor = Sensor(layout, first.pattern, first.calibration)
    saved = capture_burst(frames, 2, sensor, grey, ShotFolder(tmp_path))
    white = SteadyWhite()(first).calibration.neutral
    neutrals = [read_dng(each.path).calibration.neutral for each in saved]  # type: ignore[union-attr]
    assert neutrals[0] == neutrals[1] == pytest.approx(white, abs=1e-4)


def test_of_a_burst_with_a_frame_that_does_not_fit_nothing_is_saved(tmp_path: Path) -> None:
    short = RawFrame(b"12", TAKEN, 0.0, "frames/7.raw")
    (outcome,) = capture_burst(map(frame, range(3)), 4, SENSOR, grey, ShotFolder(tmp_path))
    assert outcome == Refused("the frames ended after 3 of 4 of the burst; none of them is saved")
    (outcome,) = capture_burst([frame(0), short, frame(1)], 3, SENSOR, grey, ShotFolder(tmp_path))
    assert isinstance(outcome, Refused)
    assert outcome.reason.startswith("frames/7.raw: 2 bytes are not a frame")
    assert outcome.reason.endswith("; none of the burst's 3 frames is saved")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_ends_it_and_leaves_what_was_saved(
    tmp_path: Path, full_disk: Callable[[], None]
) -> None:
    running = capture(map(frame, range(3)), SENSOR, grey, ShotFolder(tmp_path))
    next(running)
    full_disk()
    with pytest.raises(OutputError, match="the disk is full"):
        next(running)
    assert [path.name for path in tmp_path.iterdir()] == ["20260309T070501.000Z-000001.dng"]


@pytest.mark.parametrize(
    ("layout", "pattern", "calibration", "words"),
    [
        ((32, 26, "raw12"), CfaPattern.bayer(), CALIBRATION, "of 10 bits, raw12 has 12"),
        ((32, 26, "raw10"), CfaPattern.bayer(), SensorCalibration(), "of 16 bits, raw10 has 10"),
        ((3, 3, "raw10"), CfaPattern.bayer(8, origin=(4, 4)), CALIBRATION, "no whole colour block"),
        ((32, 26, "raw10"), CfaPattern.of_letters("CM/YW"), CALIBRATION, "to different sensors"),
    ],
)
def test_a_sensor_that_contradicts_itself(
    layout: tuple[int, int, str], pattern: CfaPattern, calibration: SensorCalibration, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        Sensor(FrameLayout(*layout), pattern, calibration)


def test_memory_does_not_grow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two hundred frames through the whole chain. Seven more would be held at the end if one in
    twenty stayed.
    """
    frames, settled = 200, 60
    monkeypatch.setattr(os, "fsync", lambda _: None)  # most of the time, and none of the memory
    # so that frames are larger than what Python keeps anyway
    wide = replace(SENSOR, layout=replace(SENSOR.layout, stride=1 << 13))
    data = bytes(frame(0, wide).data)

    def source() -> Iterator[RawFrame]:
        for _ in range(frames):
            yield RawFrame.now(bytearray(data))

    held: list[int] = []
    tracemalloc.start()
    try:
        queue = FrameQueue(source(), 2, wait=True)
        for number, each in enumerate(capture(queue, wide, grey, ShotFolder(tmp_path))):
            assert isinstance(each, Saved)
            each.path.unlink()
            if number in (settled, frames - 1):
                gc.collect()
                held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert held[1] - held[0] < 6 * len(data)  # at either time the queue may hold up to three


# --- white balance ---------------------------------------------------------------------------------


def neutral(mosaic: Mosaic) -> np.ndarray:
    return np.log(mosaic.calibration.neutral or ())


def test_frames_are_balanced_from_the_first_bright_one_on_and_marked() -> None:
    balance = SteadyWhite()
    assert balance(shot(level=0)).calibration.neutral is None
    first, dark = balance(shot()), balance(shot(level=0))
    assert np.abs(neutral(first) - np.log(LIGHT)).max() < 0.05
    assert first.calibration.neutral_estimated
    assert dark.calibration == first.calibration


def test_the_balance_does_not_jump_and_follows_a_lasting_change() -> None:
    balance, warm = SteadyWhite(), (1.0, 0.7, 0.3)
    before = neutral(balance(shot()))
    for _ in range(3):
        after = neutral(balance(shot(warm)))
        assert 0 < np.abs(after - before).max() < 0.12
        before = after
    for _ in range(100):
        last = balance(shot(warm))
    assert np.abs(neutral(last) - np.log(warm)).max() < 0.05


def test_colours_that_are_known_stay() -> None:
    balance = SteadyWhite()
    for known in ({"neutral": (0.5, 1.0, 0.5)}, {"camera_to_xyz": SRGB_TO_XYZ}):
        mosaic = replace(shot(), calibration=SensorCalibration.of_bits(12, **known))
        assert balance(mosaic) is mosaic
