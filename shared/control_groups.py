"""The control groups of this process (Linux, version 2): where a container, a batch system or
systemd states the limits that it sets.
"""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

_MEMBERSHIP = Path("/proc/self/cgroup")
_MOUNT = Path("/sys/fs/cgroup")


def control_groups() -> Iterator[Path]:
    """Yield the folders of the groups whose limits may hold for this process: its own and all above
    it.

    In a container the mount point may be the process's own group. Source: Linux,
    admin-guide/cgroup-v2.rst.
    """
    yield _MOUNT
    with suppress(OSError, ValueError):
        lines = _MEMBERSHIP.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
        for path in (PurePosixPath(line[3:]) for line in lines if line.startswith("0::/")):
            below = path.relative_to("/")
            if ".." not in below.parts:  # in a namespace the group may lie outside of the mount
                yield from (_MOUNT / group for group in (below, *below.parents))


def number_in(file: Path) -> int | None:
    """The number in a file of a control group; None for "max", and where there is no such file."""
    with suppress(OSError, ValueError):
        return int(file.read_text(encoding="ascii"))
    return None
