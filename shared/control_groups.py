"""The control groups of this process (Linux): where a container, a batch system or systemd states
the limits that it sets.
"""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

_PROCESS = Path("/proc/self")
_USUAL = Path("/sys/fs/cgroup")


def control_groups(controller: str) -> Iterator[Path]:
    """Yield the folders of the groups whose limits may hold for this process: its own and all above
    it, of versions 1 and 2.

    Source: Linux, admin-guide/cgroup-v1/cgroups.rst, admin-guide/cgroup-v2.rst; proc(5),
    /proc/PID/mountinfo.

    Parameters
    ----------
    controller : str
        Its name in version 1: memory, cpu.
    """
    yield _USUAL  # of containers, which may hide the rest
    yield _USUAL / controller
    try:
        memberships = [line.split(":", 2) for line in _lines("cgroup")]
        # version 2 has the name ""
        own = {name: path for _, names, path in memberships for name in names.split(",")}
        mounts = [line.partition(" - ") for line in _lines("mountinfo")]
        for mount, _, file_system in mounts:
            (root, point), (kind, *_, options) = mount.split(" ")[3:5], file_system.split(" ")
            name = {"cgroup": controller, "cgroup2": ""}.get(kind)
            if name is not None and name in own and (not name or name in options.split(",")):
                yield from _line_of_groups(Path(_unescaped(point)), _unescaped(root), own[name])
    except (OSError, ValueError):
        return


def number_in(file: Path) -> int | None:
    """The number in a file of a control group; None for "max", and where there is no such file."""
    with suppress(OSError, ValueError):
        return int(file.read_text(encoding="ascii"))
    return None


def _lines(name: str) -> list[str]:
    return (_PROCESS / name).read_text(encoding="utf-8", errors="surrogateescape").splitlines()


def _unescaped(path: str) -> str:
    return path.replace(r"\040", " ").replace(r"\011", "\t").replace(r"\134", "\\")


def _line_of_groups(point: Path, root: str, path: str) -> Iterator[Path]:
    """Yield the mount point, and all groups from there to the one at `path`. root: the group that
    is mounted there.
    """
    yield point
    with suppress(ValueError):  # in a namespace the mount may show another part of the tree
        below = PurePosixPath(path).relative_to(root)
        if ".." not in below.parts:
            yield from (point / part for part in reversed([below, *below.parents]))
