"""The machine and the libraries on which speeds were measured, ours and those of the rivals."""

import os
import platform
from pathlib import Path
from typing import Any

from tools.host.memory import available_memory
from tools.host.processors import processors
from tools.host.versions import package_version, program_version

from .rivals import RIVALS

_LIBRARIES = ("numpy", "numba", "llvmlite", "imagecodecs", "onnxruntime")


def environment(threads: int) -> dict[str, Any]:
    """Names, versions and figures by key; `load` is the average number of running processes in the last minute."""
    packages = dict.fromkeys((*_LIBRARIES, *(rival.distribution for rival in RIVALS)))
    return {
        "panchroma": program_version(),
        "processor": _processor(),
        "cores": processors(),
        "threads": threads,
        "free_memory": available_memory(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "packages": {name: package_version(name) for name in packages},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", errors="replace").splitlines()
    except OSError:  # not Linux
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())
