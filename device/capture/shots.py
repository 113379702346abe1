"""The folder of a camera's shots: unique file names, and a link to the latest shot."""

import errno
import os
import re
import stat
from collections.abc import Callable
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

from shared import Mosaic, write_dng
from shared.arrays import ByteArray
from shared.errors import InputError, OutputError
from shared.series import frame_name
from shared.writing import part_path, sweep

_NAME = re.compile(r"\d{8}T\d{6}\.\d{3}Z-(\d{6,})(-\d+)?\.dng")


class ShotFolder:
    """Saves shots as TIME-COUNTER.dng, bursts as TIME-COUNTER-1.dng, -2.dng ..., durably, and never over another file.

    TIME is UTC to the millisecond. COUNTER continues from the highest one in the folder, so that names are unique and the order of
    the shots is known even if the clock is wrong: many cameras have no clock that runs while they are off.

    folder: an existing folder; also the attribute `path`.
    latest: a symbolic link that always points to a whole file, the one saved last; None = no link.
    Raises InputError when `latest` exists and is not a link, or can be none, OutputError when the folder cannot be listed.
    """

    def __init__(self, folder: Path, latest: Path | None = None) -> None:
        self.path = folder
        self._latest = latest
        if latest is not None:
            _check_link(latest)
            sweep(latest.parent)
        try:
            names = [_NAME.fullmatch(path.name) for path in folder.iterdir()]
        except OSError as error:
            raise OutputError(f"{folder}: cannot be listed ({error.strerror or error})") from None
        self._counter = count(1 + max((int(name[1]) for name in names if name), default=0))

    def save(self, mosaic: Mosaic, picture: ByteArray, taken: datetime) -> Path:
        """Write a mosaic as a DNG and return its path. Raises OutputError when that fails; no partial file is left.

        mosaic: the shot.
        picture: its preview, uint8 sRGB (h, w, 3).
        taken: time of the shot, with time zone.
        """
        return self._series([""], taken)(mosaic, picture)

    def burst(self, count: int, taken: datetime) -> Callable[[Mosaic, ByteArray], Path]:
        """A function that saves the next frame of a burst: see `save`, which it takes the shot and its preview for.

        count: number of frames.
        taken: time of the first one, which all their names have.
        """
        return self._series([frame_name("", number, count) for number in range(1, count + 1)], taken)

    def _series(self, endings: list[str], taken: datetime) -> Callable[[Mosaic, ByteArray], Path]:
        """A function that saves the next of some shots with one TIME-COUNTER; their names end with `endings`."""
        stem, left = self._stem(taken), list(endings)

        def save(mosaic: Mosaic, picture: ByteArray) -> Path:
            nonlocal stem
            while True:
                path = self.path / f"{stem}{left[0]}.dng"
                try:
                    write_dng(path, mosaic, picture)
                    break
                except OutputError as error:
                    # The name is taken: another camera saves in the same folder. The first shot takes it for all.
                    if len(left) < len(endings) or not isinstance(error.__cause__, FileExistsError):
                        raise
                    stem = self._stem(taken)
            left.pop(0)
            if self._latest is not None:
                _point(self._latest, path)
            return path

        return save

    def _stem(self, taken: datetime) -> str:
        """TIME-COUNTER with the next number of the counter."""
        time = taken.astimezone(UTC)
        return f"{time:%Y%m%dT%H%M%S}.{time.microsecond // 1000:03}Z-{next(self._counter):06}"


def _check_link(link: Path) -> None:
    try:
        if not link.parent.is_dir():
            raise InputError(f"{link}: there is no such folder for the link to the latest shot")
        if not stat.S_ISLNK(link.lstat().st_mode):
            raise InputError(f"{link}: exists and is no link; choose another name for the link to the latest shot")
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:  # ValueError: a null character
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{link}: cannot be the name of the link to the latest shot ({reason})") from None


def _point(link: Path, path: Path) -> None:
    """Point `link` to `path` atomically: at no moment is the link missing or broken."""
    part = part_path(link)
    try:
        try:
            # Relative, so that link and shots can be moved together, and mounted elsewhere.
            part.symlink_to(os.path.relpath(path.resolve(), link.parent.resolve()))
            part.replace(link)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        reason = error.strerror or str(error)
        if error.errno in (errno.EPERM, errno.ENOSYS, errno.EOPNOTSUPP):
            reason = "this file system has no symbolic links; omit the link, or put it elsewhere"
        raise OutputError(f"{link}: the link to the latest shot cannot be made: {reason}") from error
