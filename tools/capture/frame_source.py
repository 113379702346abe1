"""Sources of frames."""

import fcntl
import os
import re
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from io import FileIO
from itertools import cycle, islice
from pathlib import Path
from typing import Any, cast

from ...device import Preview
from ...device.capture import FrameLayout, PreviewMaker, RawFrame, Sensor, read_frames
from ...device.capture.frame_check import checked
from ...device.capture.frame_folder import watch_folder
from ...device.capture.frames import FORMATS, Bytes, FrameError, format_named
from ...shared import ByteArray, Camera, CfaPattern, InputError, SensorCalibration
from ...shared.reading import naming, opened_file
from ..simulation.simulated_camera import built_in_sensor, moving_scene, usual_gamma
from .genicam import GENICAM, SETTINGS, GenicamCamera, Note, Stopped
from .layouts import likely_reading

PIXEL_FORMATS = tuple(FORMATS)
STREAM = "-"
"""Source of frames on standard input."""
_BUILTIN = "builtin:"
_LEAST_FRAMES, _MOST_FRAMES = 4, 48  # of one turn of the built-in sensor
_MEMORY = 64 * 2**20  # bytes: limits the number of frames of a turn

Refused = Callable[[InputError], None]
"""Called for each file that is not a frame."""
Opened = Callable[[Stopped, Refused, Note], Iterator[RawFrame]]
"""Opens a source."""
Described = Callable[[CfaPattern | None], tuple[Camera | None, CfaPattern]]
"""Camera and pattern as the user describes them; the argument is the pattern that the camera itself
states.
"""


@dataclass(frozen=True)
class SourceOptions:
    """The description of a source of frames, as a user gives it.

    Attributes
    ----------
    source : str
        "-" (standard input), a folder that is watched, genicam:ID, or builtin:WIDTHxHEIGHT@FPS, a
        simulated sensor.
    width, height, pixel_format, stride : int | None, str | None, int
        See `FrameLayout` and `format_named`; None = not given.
    sensor_bits : int | None
        Bits of a sample; None = those of the pixel format, or of the camera file.
    black : int | None
        Black level, code; None = that of the camera file, or a sixteenth of the range.
    unchecked : bool
        Frames are not compared with this description.
    new : bool
        Files that are in the folder already are skipped.
    exposure_time, gain, fps : float | None
        See `GenicamCamera`.
    """

    source: str
    width: int | None = None
    height: int | None = None
    pixel_format: str | None = None
    stride: int = 0
    sensor_bits: int | None = None
    black: int | None = None
    unchecked: bool = False
    new: bool = False
    exposure_time: float | None = None
    gain: float | None = None
    fps: float | None = None

    def refuse(self, names: Iterable[str], reason: str) -> None:
        """Raise InputError if one of these is given.

        reason: what it does not go with, and why.
        """
        for field in fields(self):
            if field.name in names and getattr(self, field.name) != field.default:
                raise InputError(f"`{field.name}` does not go with {reason}")


@dataclass(frozen=True)
class FrameSource:
    """A source of frames from a known sensor.

    Attributes
    ----------
    sensor : Sensor
        Layout of the frames, pattern and calibration.
    opened : Opened
        Opens the source.
    waits : bool
        Whether the source waits for a slow consumer (a recording does, a sensor does not).
    notes : tuple[str, ...]
        Remarks for the user on how the description was interpreted.
    checks : bool
        Whether the first frames are compared with the description.
    lost : Callable[[], int]
        Number of frames so far that arrived incomplete, or came too fast to be read.
    close : Callable[[], object]
        Lets the camera go.
    """

    sensor: Sensor
    opened: Opened
    waits: bool
    notes: tuple[str, ...] = ()
    checks: bool = False
    lost: Callable[[], int] = int
    close: Callable[[], object] = bool

    def frames(self, stopped: Stopped, refused: Refused, note: Note) -> Iterator[RawFrame]:
        """The frames.

        note: called when the first of them do not show whether the description is right, or none
        comes.
        """
        raw = self.opened(stopped, refused, note)
        return checked(raw, self.sensor, note, refused) if self.checks else raw


def preview_maker(sensor: Sensor, scale: int = 1) -> PreviewMaker:
    """A camera's preview as a function, ready before the first frame arrives; for the arguments and
    errors see `Preview`.
    """
    preview = Preview(sensor.pattern, scale)
    return lambda mosaic: cast(ByteArray, preview.run(mosaic))


def doubts(first: Path | None, error: Exception) -> list[str]:
    """Advice to the user on the shots before this error ended the stream: those of a stream that
    lost bytes, or of frames that are not as described; empty if there is none.

    first: the first shot since the last frame that showed its filters where they belong; whatever
    came before that one is right.
    """
    doubt = f"{first} and later shots may be wrong; all shots before it are right"
    return [doubt] if first is not None and isinstance(error, FrameError) else []


def open_source(options: SourceOptions, described: Described) -> FrameSource:
    """Open the requested source of frames.

    Raises InputError if there is no such source, or if a part of its description does not go with
    it.
    """
    source = options.source
    if source == STREAM or source.startswith((_BUILTIN, GENICAM)):
        options.refuse(["new"], f"{source}: only a folder can already contain frames")
    if source.startswith(_BUILTIN):
        names = [field.name for field in fields(options)[1:]]
        options.refuse(names, f"{source}: the built-in sensor has its own")
        return _builtin(source, *described(None))
    if source.startswith(GENICAM):
        options.refuse(["width", "height", "stride"], f"{source}: the camera says it")
        settings = {name: getattr(options, name) for name in SETTINGS}
        plugged = GenicamCamera(source, options.pixel_format, settings)
        known = described(plugged.pattern)
        if plugged.pattern not in (None, known[1]):
            remedy = "leave `pattern` and `origin` out"
            raise InputError(f"{source}: the camera says where its filters are; {remedy}")
        sensor, notes = _described(options, plugged.layout, plugged.bits, known)
        return FrameSource(
            replace(sensor, metadata=plugged.metadata),
            lambda stopped, _, note: plugged.frames(stopped, note),
            waits=False,
            notes=(plugged.about, *notes),
            checks=not options.unchecked,
            lost=lambda: plugged.lost,
            close=plugged.close,
        )
    options.refuse(SETTINGS, f"{source}: only a connected camera, genicam:ID, can be set")
    if source != STREAM and not Path(source).is_dir():
        expected = "SOURCE is such a folder, -, genicam:ID or builtin:WIDTHxHEIGHT@FPS"
        raise InputError(f"{source}: is not a folder; {expected}")
    known = described(None)
    sensor, notes = _described(options, *layout_of(options), known)
    opened, waits = _open_unplugged(options, sensor)
    return FrameSource(sensor, opened, waits, notes, checks=not options.unchecked)


def _open_unplugged(options: SourceOptions, sensor: Sensor) -> tuple[Opened, bool]:
    """Return the way to open standard input or a folder; and whether it waits."""
    layout = sensor.layout
    if options.source != STREAM:
        has_black = min(sensor.calibration.black_level) > 0 and not options.unchecked
        how = {"only_new": options.new, "has_black_level": has_black}
        return lambda stopped, refused, _: watch_folder(
            Path(options.source), layout, refused, **how, stopped=stopped
        ), True
    length = recording()
    if length is not None and not options.unchecked:
        layout.check_recording(length, ". If they are right, add `unchecked`")
    return lambda *_: read_frames(standard_input(), layout), length is not None


def recording() -> int | None:
    """Bytes of the recording on standard input; None for a pipe, which may come from a sensor that
    does not wait.
    """
    if sys.stdin is None or sys.stdin.isatty():
        example = "pipe a camera into it: rpicam-raw -t 0 -o - | panchroma ..."
        raise InputError(f"-: no frames can come on standard input; {example}")
    status = os.fstat(sys.stdin.fileno())
    return status.st_size if stat.S_ISREG(status.st_mode) else None


def standard_input() -> FileIO:
    """Standard input without a buffer: a buffered reader that is interrupted in a read would keep
    the interpreter from ending.
    """
    descriptor = sys.stdin.fileno()
    with suppress(OSError, AttributeError):  # no pipe; the user has too many; not Linux
        # Room for a part of a frame that takes the writer a while, as much as Linux gives any user:
        # each time it is full costs two changes of process.
        fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, 1 << 20)
    return open(descriptor, "rb", buffering=0, closefd=False)


def layout_of(options: SourceOptions) -> tuple[FrameLayout, int]:
    """The layout of the frames that is described, and the bits of a sample.

    Raises InputError that names what is missing.
    """
    width, height, pixel_format = options.width, options.height, options.pixel_format
    if width is None or height is None or pixel_format is None:
        names = ("width", "height", "pixel_format")
        missing = ", ".join(f"`{name}`" for name in names if getattr(options, name) is None)
        remedy = f"describe them with {missing} (and `stride`)"
        hint = "rpicam-raw prints these values when it starts"
        raise InputError(f"{options.source}: frames have no header; {remedy}. {hint}")
    name, bits = format_named(pixel_format)
    return FrameLayout(width, height, name, options.stride), bits


def first_frame(options: SourceOptions) -> tuple[Bytes, FrameLayout]:
    """Read the first frame of a file or stream as it is described; returns its bytes and their
    layout.

    Raises InputError for what cannot be read, and for a description that does not fit, as a size
    that the length of a file contradicts.
    """
    layout, _ = layout_of(options)
    if options.source == STREAM:
        recording()
        with standard_input() as stream:
            return next(read_frames(stream, layout)).data, layout
    with opened_file(options.source, sys.maxsize, "a raw frame") as file:
        length = file.seek(0, os.SEEK_END)
        layout.check_recording(length)
        file.seek(0)
        data = file.read(layout.frame_bytes)
    layout.unpack(data)  # raises InputError
    if length % layout.frame_bytes:
        remedy = "a recording whose last frame is cut off can be given on standard input"
        raise InputError(f"{layout.misfit(length)}; {likely_reading(data, layout) or remedy}")
    return data, layout


def _check_size(source: str, camera: Camera, layout: FrameLayout) -> None:
    """Raise InputError unless frames have the size of those that the camera file was made with: its
    maps are for these alone.
    """
    shape, known = (layout.height, layout.width), camera.calibration
    needed = zip(shape, *((row + 1, column + 1) for row, column in known.defects), strict=True)
    size = known.shading.size if known.shading else tuple(map(max, needed))
    try:
        replace(camera, size=camera.size or size).check_size(shape)
    except InputError as error:
        other = "a window of the sensor or another mode of it, measure a camera file for it"
        copy = 'take a copy of this one without "size", "shading" and "defects"'
        remedy = f"give the right `width`, `height` and `stride`, or, if this is {other}, or {copy}"
        raise InputError(f"{source}: {error}; {remedy}") from None


def _described(
    options: SourceOptions, layout: FrameLayout, bits: int, known: tuple[Camera | None, CfaPattern]
) -> tuple[Sensor, tuple[str, ...]]:
    """Return the sensor that is described, and notes; known: see `Described`."""
    camera, pattern = known
    if camera:
        options.refuse(["sensor_bits", "black"], "`camera`: the camera file says it")
        _check_size(options.source, camera, layout)
        return Sensor(layout, pattern, camera.calibration), ()
    # A sensor clips at its highest code, and most put black a sixteenth above zero.
    facts: dict[str, Any] = {"channels": pattern.channels, "gamma": usual_gamma(pattern)}
    calibration = SensorCalibration.of_bits(options.sensor_bits or bits, headroom=False, **facts)
    if options.black is not None:
        highest = calibration.white_level // 2
        if not 0 <= options.black <= highest:
            expected = f"a code from 0 to {highest}, half of the range"
            raise InputError(f"`black` is {options.black}, expected {expected}")
        codes = (float(options.black),) * len(calibration.black_level)
        calibration = replace(calibration, black_level=codes)
    black, white = calibration.black_level[0], calibration.white_level
    levels = f"black level {black:.0f} and white level {white} are taken"
    note = f"no `camera`: {levels}, and the white balance is estimated"
    return Sensor(layout, pattern, calibration), (note,)


def _builtin(source: str, camera: Camera | None, pattern: CfaPattern) -> FrameSource:
    match = re.fullmatch(r"builtin:(\d{1,5})x(\d{1,5})@(\d{1,4}(?:\.\d{1,3})?)", source)
    rate = float(match[3]) if match else 0.0
    if not match or not rate:
        example = "write builtin:WIDTHxHEIGHT@FPS, for example builtin:1200x800@10"
        raise InputError(f"{source!r} is not a built-in sensor; {example}")
    with naming(source):
        calibration = built_in_sensor(pattern, camera)
    layout = FrameLayout(int(match[1]), int(match[2]), "u16")
    if camera is not None:
        _check_size(source, camera, layout)
    sensor = Sensor(layout, pattern, calibration)
    return FrameSource(sensor, lambda *_: _moving_frames(sensor, rate), waits=False)


def _moving_frames(sensor: Sensor, rate: float) -> Iterator[RawFrame]:
    """Yield endless frames of 16-bit words, `rate` per second: see `moving_scene`.

    The first turn is simulated as fast as the machine can; later turns repeat its frames at the
    full rate.
    """
    layout, shape = sensor.layout, (sensor.layout.height, sensor.layout.width)
    frames = min(max(_MEMORY // layout.frame_bytes, _LEAST_FRAMES), _MOST_FRAMES)
    simulated = islice(moving_scene(sensor.pattern, sensor.calibration, shape, frames), frames)
    due = time.monotonic()
    for data in cycle(mosaic.codes.astype("<u2").tobytes() for mosaic in simulated):
        # A sensor does not catch up: a late frame delays all later ones by as much.
        due = max(due + 1 / rate, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0))
        yield RawFrame.now(data)
