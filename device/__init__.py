"""The software of the camera: a fast preview of a mosaic, and capture. README.md in this folder
explains both.
"""

from .preview.preview import Preview

__all__ = ["Preview"]
