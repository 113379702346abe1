"""Capture: raw frames -> DNG files with previews. README.md in the folder above explains it."""

from .frames import Sensor
from .identification import Identity, identify
from .loop import PreviewMaker, Refused, Saved, capture, capture_burst

__all__ = ["Identity", "PreviewMaker", "Refused", "Saved", "Sensor", "capture", "capture_burst", "identify"]
