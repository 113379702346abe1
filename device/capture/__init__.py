"""Capture: raw frames -> DNG files with previews. README.md in the folder above explains it."""

from .frames import Sensor
from .loop import PreviewMaker, Refused, Saved, capture, capture_burst

__all__ = ["PreviewMaker", "Refused", "Saved", "Sensor", "capture", "capture_burst"]
