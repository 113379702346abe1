"""Capture: raw frames -> DNG files with previews. README.md in the folder above explains it."""

from .frame_queue import FrameQueue
from .frames import FrameLayout, RawFrame, Sensor, read_frames
from .loop import PreviewMaker, Refused, Saved, capture, capture_burst
from .shots import ShotFolder

__all__ = ["FrameLayout", "FrameQueue", "PreviewMaker", "RawFrame", "Refused", "Saved", "Sensor"]
__all__ += ["ShotFolder", "capture", "capture_burst", "read_frames"]
