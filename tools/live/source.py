"""Sources of frames."""

import argparse
import fcntl
import os
import re
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from device.capture import Sensor
from device.capture.checks.frame_check import checked
from device.capture.frame_folder import watch_folder
from device.capture.frames import FrameLayout, RawFrame, format_named, read_frames
from shared import Camera, CfaPattern, SensorCalibration
from shared.errors import InputError
from shared.sensor import typical_noise
from tools.camera.filters import filters_for
from tools.camera.simulated_camera import SimulatedCamera
from tools.scenes.drawn.builtin import builtin_scene

_STREAM, _BUILTIN = "-", "builtin:"
_PIPE = 1 << 20  # bytes: the most that Linux gives any user

Frames = Callable[[Callable[[], bool], Callable[[InputError], None], Callable[[str], None]], Iterator[RawFrame]]
"""Opens a source. Arguments: `stopped()`, polled between frames; `refused(error)`, called for each file that is not a frame;
`note(remark)`, called when the first frame does not show whether its description is right."""


@dataclass(frozen=True)
class FrameSource:
    """A source of frames from a known sensor.

    sensor: layout of the frames, pattern and calibration.
    frames: opens the source.
    waits: whether the source waits for a slow consumer (a recording does, a sensor does not).
    notes: remarks for the user on how the options were interpreted.
    """

    sensor: Sensor
    frames: Frames
    waits: bool
    notes: tuple[str, ...] = ()


def open_source(arguments: argparse.Namespace, camera: Camera | None, pattern: CfaPattern) -> FrameSource:
    """Open the requested source of frames of this camera.

    Raises InputError if there is no such source, or if an option does not go with it.
    """
    source: str = arguments.source
    is_builtin, is_stream = source.startswith(_BUILTIN), source == _STREAM
    _refuse(arguments, is_builtin or is_stream, "new", "only a folder can already contain frames")
    if is_builtin:
        for option in ("width", "height", "pixel_format", "stride", "sensor_bits", "black", "covered", "unchecked"):
            _refuse(arguments, True, option, "the built-in sensor has its own")
        return _builtin(source, camera, pattern)
    _refuse(arguments, arguments.unchecked, "covered", "with `unchecked` no frame is looked at; leave one of the two out")
    if not is_stream and not Path(source).is_dir():
        raise InputError(f"{source}: is not a folder; SOURCE is a folder of raw frames, - or builtin:WIDTHxHEIGHT@FPS")
    sensor, notes = _described(arguments, camera, pattern)
    layout = sensor.layout
    if is_stream:
        if sys.stdin is None or sys.stdin.isatty():
            raise InputError("-: no frames can come on standard input; pipe a camera into it: rpicam-raw -t 0 -o - | panchroma ...")
        status = os.fstat(sys.stdin.fileno())
        # A pipe may come from a sensor, which does not wait.
        waits = stat.S_ISREG(status.st_mode)
        if waits and not arguments.unchecked:
            layout.check_recording(status.st_size)

        def opened(stopped: Callable[[], bool], refused: Callable[[InputError], None]) -> Iterator[RawFrame]:
            _enlarge_pipe(sys.stdin.fileno())
            # Unbuffered: a buffered reader that is interrupted in a read would keep the interpreter from ending.
            return read_frames(open(sys.stdin.fileno(), "rb", buffering=0, closefd=False), layout)
    else:
        folder, waits = Path(source), True

        def opened(stopped: Callable[[], bool], refused: Callable[[InputError], None]) -> Iterator[RawFrame]:
            return watch_folder(folder, layout, refused, only_new=arguments.new, stopped=stopped)

    def frames(
        stopped: Callable[[], bool], refused: Callable[[InputError], None], note: Callable[[str], None]
    ) -> Iterator[RawFrame]:
        raw = opened(stopped, refused)
        return raw if arguments.unchecked else checked(raw, sensor, note, dark=arguments.covered)

    return FrameSource(sensor, frames, waits, notes)


def _enlarge_pipe(descriptor: int) -> None:
    """Let a pipe hold a part of a frame that takes the writer a while: each time it is full costs two changes of process."""
    with suppress(OSError, AttributeError):  # no pipe; the user has too many; not Linux
        fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, _PIPE)


def _refuse(arguments: argparse.Namespace, unfit: bool, option: str, reason: str) -> None:
    given = getattr(arguments, option)
    if unfit and (given or (given is not None and option == "black")):  # --black 0 is a black level
        raise InputError(f"`{option}` does not go with {arguments.source}: {reason}")


def _described(arguments: argparse.Namespace, camera: Camera | None, pattern: CfaPattern) -> tuple[Sensor, tuple[str, ...]]:
    """Return the sensor that the options describe, and notes."""
    missing = [f"`{option}`" for option in ("width", "height", "pixel_format") if getattr(arguments, option) is None]
    if missing:
        raise InputError(
            f"{arguments.source}: frames have no header; describe them with {', '.join(missing)} (and `stride`). "
            "rpicam-raw prints these values when it starts"
        )
    name, bits = format_named(arguments.pixel_format)
    layout = FrameLayout(arguments.width, arguments.height, name, arguments.stride)
    if arguments.camera and arguments.sensor_bits:
        raise InputError("`sensor_bits` does not go with `camera`: the camera file says it")
    if arguments.camera and arguments.black is not None:
        raise InputError("`black` does not go with `camera`: the camera file says it")
    if camera:
        return Sensor(layout, pattern, camera.calibration), ()
    # A sensor clips at its highest code, and most put black a sixteenth above zero.
    calibration = SensorCalibration.of_bits(
        arguments.sensor_bits or bits, headroom=False, channels=pattern.channels, gamma=_ideal_gamma(pattern)
    )
    if arguments.black is not None:
        calibration = _with_black(calibration, arguments.black)
    black, white = calibration.black_level[0], calibration.white_level
    assumed = f"black level {black:.0f} and white level {white} are" if arguments.black is None else f"white level {white} is"
    note = f"no `camera`: {assumed} assumed, and the white balance is estimated"
    return Sensor(layout, pattern, calibration), (note,)


def _with_black(calibration: SensorCalibration, black: int) -> SensorCalibration:
    """Return the calibration with this black level on all planes. Raises InputError that names the option."""
    if not 0 <= black <= calibration.white_level // 2:
        raise InputError(f"`black` is {black}, expected a code from 0 to {calibration.white_level // 2}, half of the range")
    return replace(calibration, black_level=(float(black),) * len(calibration.black_level))


def _ideal_gamma(pattern: CfaPattern) -> tuple[float, ...]:
    """Gamma of filters that are mixtures of red, green and blue; otherwise 1 for each channel."""
    try:
        return filters_for(pattern, builtin_scene(1, 1)).gamma
    except InputError:
        return (1.0,) * len(pattern.channels)


def _builtin(source: str, camera: Camera | None, pattern: CfaPattern) -> FrameSource:
    found = re.fullmatch(r"builtin:(\d{1,5})x(\d{1,5})@(\d{1,4}(?:\.\d{1,3})?)", source)
    rate = float(found[3]) if found else 0.0
    if not found or not rate:
        raise InputError(f"{source!r} is not a built-in sensor; write builtin:WIDTHxHEIGHT@FPS, for example builtin:1200x800@10")
    scene = builtin_scene(1, 1)
    try:
        filters = filters_for(pattern, scene)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    calibration = SimulatedCamera.of(pattern, camera).before(scene, filters)
    if calibration.noise is None:
        calibration = replace(calibration, noise=typical_noise(calibration))
    sensor = Sensor(FrameLayout(int(found[1]), int(found[2]), "u16"), pattern, calibration)

    def frames(*_: object) -> Iterator[RawFrame]:
        from .simulated_sensor import moving_scene

        return moving_scene(sensor, rate)

    return FrameSource(sensor, frames, waits=False)
