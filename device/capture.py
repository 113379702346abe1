"""Capture: raw frames in, DNG files with their preview out."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from shared.arrays import ByteArray
from shared.errors import InputError

from .frames import FrameLayout, RawFrame
from .shots import ShotFolder

PreviewMaker = Callable[[Mosaic], ByteArray]
"""A mosaic's picture for looking at: uint8 sRGB (h, w, 3)."""


@dataclass(frozen=True)
class Sensor:
    """What is known of the sensor before the first frame comes, checked once, here.

    Raises InputError when pattern and calibration name different channels, when the frame holds no whole colour block, and when a
    packed format and the calibration have different bits: then the calibration was made for another mode of the sensor.
    """

    layout: FrameLayout
    pattern: CfaPattern
    calibration: SensorCalibration

    def __post_init__(self) -> None:
        bits = self.calibration.bits
        if bits > self.layout.bits or (self.layout.format != "u16" and bits != self.layout.bits):
            raise InputError(
                f"the calibration is for samples of {bits} bits, {self.layout.format} has {self.layout.bits}: "
                "they belong to different modes of the sensor"
            )
        self.dark()

    def dark(self) -> Mosaic:
        """A frame without light, for what has to be prepared before the first frame is there."""
        black = round(min(self.calibration.black_level))
        return Mosaic(np.full((self.layout.height, self.layout.width), black, np.uint16), self.pattern, self.calibration)

    def mosaic(self, frame: RawFrame) -> Mosaic:
        """The frame's samples, with what is known of them. Raises InputError when they do not fit the sensor."""
        metadata = CaptureMetadata(taken=frame.taken.astimezone().replace(tzinfo=None))  # Exif has local time, without zone
        return Mosaic(self.layout.unpack(frame.data), self.pattern, self.calibration, metadata)


@dataclass(frozen=True)
class Saved:
    """A frame on the disk: its file, and the seconds that the preview and the file took."""

    path: Path
    preview: float
    write: float


@dataclass(frozen=True)
class Refused:
    """A frame that could not be used."""

    reason: str


def capture(frames: Iterable[RawFrame], sensor: Sensor, preview: PreviewMaker, shots: ShotFolder) -> Iterator[Saved | Refused]:
    """Save each frame with its preview and say so; one that does not fit the sensor is refused, and the next may fit again.

    Raises OutputError when a file cannot be written: the next one could not either.
    """
    for frame in frames:
        started = perf_counter()
        try:
            mosaic = sensor.mosaic(frame)
            picture = preview(mosaic)
        except InputError as error:
            yield Refused(f"{frame.source}: {error}" if frame.source else str(error))
            continue
        made = perf_counter()
        path = shots.save(mosaic, picture, frame.taken)
        yield Saved(path, made - started, perf_counter() - made)
