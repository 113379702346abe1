"""The capture loop: turns raw frames into DNG files with previews, one by one or as a burst.

Colours that nobody has measured are balanced by an estimate that is steady from frame to frame.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from time import perf_counter

import numpy as np

from ...shared import ByteArray, DoubleArray, InputError, Mosaic
from ...shared.white_balance import balanced, estimate_neutral
from .frames import RawFrame, Sensor
from .shots import ShotFolder

PreviewMaker = Callable[[Mosaic], ByteArray]
"""A function that returns the preview of a mosaic: uint8 sRGB (h, w, 3)."""


@dataclass(frozen=True)
class Saved:
    """A saved frame.

    Attributes
    ----------
    path : Path
        The DNG file.
    preview : float
        Seconds that the preview took.
    write : float
        Seconds that encoding and writing the file took beyond that.
    is_checked : bool
        See `RawFrame`.

    Examples
    --------
    >>> from pathlib import Path
    >>> from panchroma.device.capture import Saved
    >>> Saved(Path("shots/20261127T101500.000Z-000001.dng"), preview=0.02, write=0.1).path.stem
    '20261127T101500.000Z-000001'
    """

    path: Path
    preview: float
    write: float
    is_checked: bool = False


@dataclass(frozen=True)
class Refused:
    """A frame that could not be used, with the reason.

    Examples
    --------
    >>> from panchroma.device.capture import Refused
    >>> Refused("frame 3 has 100 bytes").reason
    'frame 3 has 100 bytes'
    """

    reason: str


def capture(
    frames: Iterable[RawFrame], sensor: Sensor, preview: PreviewMaker, shots: ShotFolder
) -> Iterator[Saved | Refused]:
    """Save each frame with its preview, and yield the outcome of each.

    A frame that does not fit the sensor is refused, and the loop continues. If it is unknown what
    white reads, that is estimated from the frames, see `SteadyWhite`.

    Parameters
    ----------
    frames : Iterable[RawFrame]
        Raw frames, for example a `FrameQueue`.
    sensor : Sensor
        The sensor they come from.
    preview : PreviewMaker
        Makes the preview, for example `Preview.run`.
    shots : ShotFolder
        The folder to save in.

    Raises
    ------
    OutputError
        When a file cannot be written, because the next one could not be written either.

    Examples
    --------
    >>> import io
    >>> from pathlib import Path
    >>> from panchroma.device import Preview
    >>> from panchroma.device.capture import FrameLayout, Sensor, ShotFolder, capture, read_frames
    >>> from panchroma.shared import CfaPattern, SensorCalibration
    >>> layout = FrameLayout(48, 36, "raw12")
    >>> sensor = Sensor(layout, CfaPattern.bayer(6), SensorCalibration.of_bits(12))
    >>> preview = Preview.for_mosaic(sensor.dark(), scale=3)  # before the first frame comes
    >>> stream = io.BytesIO(bytes(2 * 36 * 72))  # two dark frames; a camera's is standard input
    >>> frames = read_frames(stream, layout)
    >>> for outcome in capture(frames, sensor, preview.run, ShotFolder(Path())):
    ...     print(type(outcome).__name__, outcome.path.suffix)
    Saved .dng
    Saved .dng
    """
    balance = SteadyWhite()
    for frame in frames:
        try:
            mosaic = balance(sensor.mosaic(frame))
        except InputError as error:
            yield Refused(frame.named(error))
            continue
        started = perf_counter()
        picture = preview(mosaic)
        made = perf_counter()
        path = shots.save(mosaic, picture, frame.taken)
        yield Saved(path, made - started, perf_counter() - made, frame.is_checked)


def capture_burst(
    frames: Iterable[RawFrame], count: int, sensor: Sensor, preview: PreviewMaker, shots: ShotFolder
) -> Iterator[Saved | Refused]:
    """Take `count` frames as fast as they come, then save them under one name, and yield the
    outcome of each.

    All of them are in memory before the first is saved. If fewer come, one does not fit the sensor,
    or one cannot be written, none is saved; in the first two cases the one outcome is a `Refused`.
    White, where it is unknown, is estimated from the first frame for all.

    For the arguments and errors see `capture`.

    Examples
    --------
    >>> import io
    >>> from pathlib import Path
    >>> from panchroma.device import Preview
    >>> from panchroma.device.capture import FrameLayout, Sensor, ShotFolder, read_frames
    >>> from panchroma.device.capture import capture_burst
    >>> from panchroma.shared import CfaPattern, SensorCalibration
    >>> layout = FrameLayout(48, 36, "raw12")
    >>> sensor = Sensor(layout, CfaPattern.bayer(6), SensorCalibration.of_bits(12))
    >>> preview = Preview.for_mosaic(sensor.dark(), scale=3)
    >>> frames = read_frames(io.BytesIO(bytes(4 * 36 * 72)), layout)
    >>> saved = list(capture_burst(frames, 3, sensor, preview.run, ShotFolder(Path())))
    >>> [outcome.path.stem[-2:] for outcome in saved]
    ['-1', '-2', '-3']
    """
    taken = list(islice(frames, count))
    if len(taken) < count:
        ended = f"the frames ended after {len(taken)} of {count} of the burst"
        yield Refused(f"{ended}; none of them is saved")
        return
    first, mosaics = taken[0].taken, []
    while taken:  # raw bytes are let go as samples take their place
        frame = taken.pop(0)
        try:
            mosaics.append(sensor.mosaic(frame))
        except InputError as error:
            yield Refused(f"{frame.named(error)}; none of the burst's {count} frames is saved")
            return
    white = SteadyWhite()(mosaics[0]).calibration
    seconds: list[float] = []  # that each preview took

    def with_previews() -> Iterator[tuple[Mosaic, ByteArray]]:
        seconds.clear()
        for mosaic in mosaics:
            balanced, started = mosaic.calibrated(white), perf_counter()
            picture = preview(balanced)
            seconds.append(perf_counter() - started)
            yield balanced, picture

    started = perf_counter()
    paths = shots.burst(with_previews, count, first)
    writing = (perf_counter() - started - sum(seconds)) / count
    for path, previewing in zip(paths, seconds, strict=True):
        yield Saved(path, previewing, writing)


# fraction of the way to a new frame's own estimate: half of a change of light is followed in eleven
# frames
_FOLLOWS = 1 / 16


class SteadyWhite:
    """Balances the frames of one stream, in their order. The estimate is a running mean, so it
    cannot flicker.

    Frames whose calibration knows what white reads pass unchanged, and so do those before the first
    one that is bright enough.
    """

    def __init__(self) -> None:
        self._logarithm: DoubleArray | None = None  # of the neutral

    def __call__(self, mosaic: Mosaic) -> Mosaic:
        """The frame with an estimated neutral in its calibration, and marked so."""
        calibration = mosaic.calibration
        if calibration.knows_white:
            return mosaic
        found = estimate_neutral(mosaic)
        if found is not None:
            observed = np.log(found)
            before = observed if self._logarithm is None else self._logarithm
            self._logarithm = before + _FOLLOWS * (observed - before)
        if self._logarithm is None:
            return mosaic
        return mosaic.calibrated(balanced(calibration, np.exp(self._logarithm), estimated=True))
