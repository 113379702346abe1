"""The camera's side: a cheap picture of a mosaic at once, on a camera's budget."""

import os

# Before the first import of onnxruntime: from 1.29 on it reports home by default, which is no business of a camera's.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

from .preview import Preview

__all__ = ["Preview"]
