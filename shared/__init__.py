"""The camera itself: filter pattern, calibration, mosaic and file format. README.md in this folder
explains them. With them come the types of arrays and the errors that all floors share.
"""

from .arrays import BoolArray, ByteArray, CodeArray, DoubleArray, FloatArray, IndexArray
from .block_grid import BlockGrid
from .calibration import NoiseModel, SensorCalibration
from .camera import Camera, read_camera
from .dng import read_dng, write_dng
from .errors import InputError, OutputError, PanchromaError
from .metadata import CaptureMetadata
from .mosaic import Mosaic
from .pattern import CfaPattern
from .shading import Shading

__all__ = ["BlockGrid", "Camera", "CaptureMetadata", "CfaPattern", "Mosaic", "NoiseModel"]
__all__ += ["SensorCalibration", "Shading", "read_camera", "read_dng", "write_dng"]
__all__ += ["BoolArray", "ByteArray", "CodeArray", "DoubleArray", "FloatArray", "IndexArray"]
__all__ += ["InputError", "OutputError", "PanchromaError"]
