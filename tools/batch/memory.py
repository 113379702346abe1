"""Free memory, the part of it that a command may use, and what a render needs."""

import os
import re
import resource
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ...shared import InputError, Mosaic
from ...shared.processors import control_groups, number_in
from ..io.kind import PictureKind

if TYPE_CHECKING:
    from ...offline import RenderSettings

_POWERS = " KMGT"
_SHARE = 0.8  # of the free memory, without --max-memory
# Limit of a process -> what /proc/self/status calls the memory that counts.
_LIMITS = {resource.RLIMIT_AS: "VmSize", resource.RLIMIT_DATA: "VmData"}

# Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/batch/test_memory.py` measures
# again). The program has its libraries and kernels, the oldest that are allowed: the newest take
# 80 MB less.
_PROGRAM = 290 * 2**20
_THREAD = 20 * 2**20  # of each thread: its own heap
_MOSAIC = 2.0  # per pixel: sensor codes


Limit = int | str | None
"""Bytes, or a size such as "4G"; None = most of the free memory."""


def allowed_memory(limit: Limit) -> int:
    """Bytes that may be used: the limit, bytes or a size such as "4G", or for None most of the free
    memory.

    Raises InputError for another text.
    """
    try:
        size = parse_bytes(limit) if isinstance(limit, str) else limit
    except ValueError:
        expected = 'expected bytes, or a size such as "4G"'
        raise InputError(f"`max_memory` is {limit!r}, {expected}") from None
    return round(_SHARE * available_memory()) if size is None else size


def parse_bytes(text: str) -> int:
    """Bytes of a size such as "800M" or "4G".

    Raises ValueError for other texts.

    Examples
    --------
    >>> parse_bytes("1.5k")
    1536
    """
    size = re.fullmatch(r"(\d+(?:\.\d+)?)([KMGT]?)(?:i?B)?", text, re.IGNORECASE)
    if not size or not float(size[1]):
        raise ValueError(text)
    return round(float(size[1]) * 1024.0 ** _POWERS.index(str(size[2]).upper() or " "))


def available_memory() -> int:
    """Bytes of memory that are free, or can be freed at once: of the machine, and within every
    limit of this process.
    """
    half = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    machine = system_figure("/proc/meminfo", "MemAvailable") or half
    return max(0, min((machine, *_left_in_groups(), *_left_to_process())))


def _left_in_groups() -> Iterator[int]:
    """Yield the bytes that each limit of each control group leaves."""
    for group in control_groups():
        dropped_first = system_figure(group / "memory.stat", "inactive_file")  # of the file cache
        used = max(0, (number_in(group / "memory.current") or 0) - dropped_first)
        for limit in (number_in(group / "memory.max"), number_in(group / "memory.high")):
            if limit is not None:
                yield limit - used


def _left_to_process() -> Iterator[int]:
    """Yield the bytes that each limit of the process (`ulimit`) leaves."""
    for limit, counted in _LIMITS.items():
        if (most := resource.getrlimit(limit)[0]) != resource.RLIM_INFINITY:
            yield most - system_figure("/proc/self/status", counted)


def system_figure(file: str | Path, name: str) -> int:
    """Return the bytes that a file of the system states under a name, in lines such as
    "MemAvailable: 12 kB" or "inactive_file 4096"; 0 = unknown.
    """
    with suppress(OSError, ValueError):
        text = Path(file).read_text(encoding="ascii")
        if line := re.search(rf"^{name}:?\s+(\d+)( kB)?$", text, re.MULTILINE):
            return int(line[1]) * (1024 if line[2] else 1)
    return 0


def format_bytes(size: int) -> str:
    """A number of bytes for people, rounded up: "350 MB", "1.6 GB"; powers of 1024."""
    megabytes = -(-size // 2**20)
    return f"{megabytes} MB" if megabytes < 1000 else f"{-(-size * 10 // 2**30) / 10:.1f} GB"


def needed_memory(
    mosaic: Mosaic, kind: PictureKind, settings: "RenderSettings", frames: int = 1
) -> int:
    """Bytes that the whole program needs to render a mosaic to such a file; rather more than it
    will use.

    frames: of a burst, all like this mosaic.
    """
    from ...offline import rendering_memory, threads

    rendering = rendering_memory(mosaic, settings)
    if frames > 1:
        from ...offline.burst import burst_memory

        rendering = burst_memory(frames, mosaic, settings)
    channels, pixels = len(mosaic.pattern.channels), mosaic.shape[0] * mosaic.shape[1]
    picture = kind.kept_as.memory(mosaic.shape, channels, rendering, threads())
    return round(_PROGRAM + _THREAD * threads() + _MOSAIC * frames * pixels + picture)


def check_memory(
    mosaic: Mosaic, kind: PictureKind, settings: "RenderSettings", limit: int, frames: int = 1
) -> None:
    """Raise InputError when rendering a mosaic, or a burst of such `frames`, to such a file needs
    more than `limit` bytes.
    """
    need = needed_memory(mosaic, kind, settings, frames)
    if need <= limit:
        return
    (rows, columns), burst = mosaic.shape, f"{frames} frames of " if frames > 1 else ""
    enough = format_bytes(need).replace(" ", "").removesuffix("B")
    memory = f"{format_bytes(need)} of memory, {format_bytes(limit)} are allowed"
    needs = f"{burst}{columns} x {rows} pixels as {kind.format} need {memory}"
    raise InputError(f'{needs}; set `max_memory="{enough}"` if the machine has as much')
