"""The software of the camera: a fast preview of a mosaic, and capture. README.md in this folder explains both."""

import os

# Before the first import of onnxruntime, which sends telemetry by default since 1.29: a camera must not.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

from .preview import Preview

__all__ = ["Preview"]
