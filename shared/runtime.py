"""onnxruntime without telemetry. Every module of ours imports it from here.

Since 1.29 the official packages for Linux and macOS send facts about machine and model to Microsoft, and keep a database of them
and an identity in the user's cache folder. The import begins with it, so that `disable_telemetry_events` comes too late; on Windows
it is what counts.
"""

import os

os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime

onnxruntime.disable_telemetry_events()

__all__ = ["onnxruntime"]
