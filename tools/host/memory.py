"""How much memory is free, and how much of it a command may use."""

import ctypes
import os
import re
from contextlib import suppress
from pathlib import Path

_POWERS = " KMGT"
_SHARE = 0.8  # of the free memory, without --max-memory
_UNKNOWN = 4 * 2**30
# Holds the memory limit of a container and what it uses now (control groups, version 2).
_CGROUP = Path("/sys/fs/cgroup")

# Of glibc (mallopt, malloc.h): the free memory from which on some goes back to the system, and the least size of a block that is
# taken from it directly (planes of a large frame, which go back at once), bytes; the number of heaps that threads share.
_MALLOPT = {-1: 256 << 20, -3: 32 << 20, -8: 1}


def reuse_memory() -> None:
    """Let this process use freed memory again instead of giving it back: fresh memory has to be cleared, each time.

    For programs that soon end, before they start threads. Does nothing where the C library is not glibc.
    """
    with suppress(AttributeError, OSError, TypeError):
        library = ctypes.CDLL(None)
        for parameter, value in _MALLOPT.items():
            library.mallopt(parameter, value)


def allowed_memory(limit: int | None) -> int:
    """Bytes that may be used: the limit, or for None most of the free memory."""
    return round(_SHARE * available_memory()) if limit is None else limit


def parse_bytes(text: str) -> int:
    """Bytes of a size such as "800M" or "4G". Raises ValueError for other texts.

    >>> parse_bytes("1.5k")
    1536
    """
    size = re.fullmatch(r"(\d+(?:\.\d+)?)([KMGT]?)(?:i?B)?", text, re.IGNORECASE)
    if not size or not float(size[1]):
        raise ValueError(text)
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


def system_figure(file: str, name: str) -> int:
    """Return the bytes that a file of the system, with lines such as "MemAvailable: 12 kB", has under a name; 0 = unknown."""
    with suppress(OSError), Path(file).open(encoding="ascii") as lines:
        return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), 0)
    return 0


def format_bytes(size: int) -> str:
    """A number of bytes for people, rounded up: "350 MB", "1.6 GB"; powers of 1024."""
    megabytes = -(-size // 2**20)
    return f"{megabytes} MB" if megabytes < 1000 else f"{-(-size * 10 // 2**30) / 10:.1f} GB"
