"""How much memory is free, and how much of it a command may use."""

import os
import re
from pathlib import Path

from shared.errors import InputError

from .isolated import system_figure

_POWERS = " KMGT"
_SHARE = 0.8  # of the free memory, without --max-memory
_UNKNOWN = 4 * 2**30
# Holds the memory limit of a container and what it uses now (control groups, version 2).
_CGROUP = Path("/sys/fs/cgroup")


def allowed_memory(option: str | None) -> int:
    """Bytes that `--max-memory` allows ("800M", "4G"); for None, most of the free memory. Raises InputError for other texts."""
    if option is None:
        return round(_SHARE * available_memory())
    size = re.fullmatch(r"(\d+(?:\.\d+)?)([KMGT]?)(?:i?B)?", option, re.IGNORECASE)
    if not size or not float(size[1]):
        raise InputError(f"--max-memory is {option!r}, expected a size such as 800M or 4G")
    return round(float(size[1]) * 1024.0 ** _POWERS.index(str(size[2]).upper() or " "))


def available_memory() -> int:
    """Bytes of memory that are free, or can be freed at once."""
    free = _machine()
    try:
        most = int((_CGROUP / "memory.max").read_text(encoding="ascii"))  # "max" where there is no limit
        return min(free, max(0, most - int((_CGROUP / "memory.current").read_text(encoding="ascii"))))
    except (OSError, ValueError):
        return free


def _machine() -> int:
    if free := system_figure("/proc/meminfo", "MemAvailable"):
        return free
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    except (AttributeError, ValueError, OSError):
        return _UNKNOWN


def format_bytes(size: int) -> str:
    """A number of bytes for people, rounded up: "350 MB", "1.6 GB"; powers of 1024, as in --max-memory."""
    megabytes = -(-size // 2**20)
    return f"{megabytes} MB" if megabytes < 1000 else f"{-(-size * 10 // 2**30) / 10:.1f} GB"
