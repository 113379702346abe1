"""The sensor whose frames are captured."""

from dataclasses import dataclass, field, replace

import numpy as np

from shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from shared.errors import InputError

from .frames import FrameLayout, RawFrame


@dataclass(frozen=True)
class Sensor:
    """The sensor whose frames are captured.

    layout: size and format of its frames.
    pattern: its filter pattern.
    calibration: its calibration, for the mode in which it runs.
    metadata: what every shot records besides its time.
    Raises InputError when pattern and calibration have different channels, when a frame holds no whole colour block, and when the
    bits of the calibration do not fit the format: then the calibration belongs to another mode of the sensor.
    """

    layout: FrameLayout
    pattern: CfaPattern
    calibration: SensorCalibration
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)

    def __post_init__(self) -> None:
        bits = self.calibration.bits
        if bits > self.layout.bits or (not self.layout.has_words and bits != self.layout.bits):
            raise InputError(
                f"the calibration is for samples of {bits} bits, {self.layout.format} has {self.layout.bits}: "
                "they belong to different modes of the sensor"
            )
        self.dark()

    def dark(self) -> Mosaic:
        """A frame without light, for preparations before the first frame arrives."""
        black = round(min(self.calibration.black_level))
        return Mosaic(np.full((self.layout.height, self.layout.width), black, np.uint16), self.pattern, self.calibration)

    def mosaic(self, frame: RawFrame) -> Mosaic:
        """The mosaic of a frame. Raises InputError when the frame does not fit the sensor."""
        metadata = replace(self.metadata, taken=frame.taken.astimezone().replace(tzinfo=None))  # Exif has local time without zone
        return Mosaic(self.layout.unpack(frame.data), self.pattern, self.calibration, metadata)
