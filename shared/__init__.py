"""The camera itself: filter pattern, calibration, mosaic and file format. README.md in this folder
explains them.
"""

from .block_grid import BlockGrid
from .calibration import NoiseModel, SensorCalibration
from .camera import Camera, read_camera
from .dng import read_dng, write_dng
from .metadata import CaptureMetadata
from .mosaic import Mosaic
from .pattern import CfaPattern
from .shading import Shading

__all__ = [
    "BlockGrid",
    "Camera",
    "CaptureMetadata",
    "CfaPattern",
    "Mosaic",
    "NoiseModel",
    "SensorCalibration",
    "Shading",
    "read_camera",
    "read_dng",
    "write_dng",
]
