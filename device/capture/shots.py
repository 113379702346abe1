"""The folder of a camera's shots, with unique file names."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import BinaryIO

from ...shared import ByteArray, Mosaic, OutputError
from ...shared.dng import encode_dng
from ...shared.series import frame_name
from ...shared.writing import durable_file

_NAME = re.compile(r"\d{8}T\d{6}\.\d{3}Z-(\d{6,})(-\d+)?\.dng")


Frames = Callable[[], Iterable[tuple[Mosaic, ByteArray]]]
"""Makes the frames of a burst with their previews; may be called again."""


class ShotFolder:
    """Saves shots as TIME-COUNTER.dng, bursts as TIME-COUNTER-1.dng, -2.dng ..., durably, and never
    over another file.

    TIME is UTC to the millisecond. COUNTER continues from the highest one in the folder, so that
    names are unique and the order of the shots is known even if the clock is wrong: many cameras
    have no clock that runs while they are off.

    Parameters
    ----------
    folder : Path
        An existing folder; also the attribute `path`.

    Raises
    ------
    OutputError
        When the folder cannot be listed.

    Examples
    --------
    >>> from datetime import UTC, datetime
    >>> from pathlib import Path
    >>> from panchroma.device import Preview
    >>> from panchroma.device.capture import FrameLayout, Sensor, ShotFolder
    >>> from panchroma.shared import CfaPattern, SensorCalibration
    >>> layout, pattern = FrameLayout(48, 36, "raw12"), CfaPattern.bayer(6)
    >>> mosaic = Sensor(layout, pattern, SensorCalibration.of_bits(12)).dark()
    >>> preview = Preview.for_mosaic(mosaic).run(mosaic)
    >>> taken = datetime(2026, 11, 27, 10, 15, tzinfo=UTC)
    >>> ShotFolder(Path()).save(mosaic, preview, taken).name
    '20261127T101500.000Z-000001.dng'
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder
        try:
            names = [_NAME.fullmatch(path.name) for path in folder.iterdir()]
        except OSError as error:
            raise OutputError(f"{folder}: cannot be listed ({error.strerror or error})") from None
        self._counter = count(1 + max((int(name[1]) for name in names if name), default=0))

    def save(self, mosaic: Mosaic, picture: ByteArray, taken: datetime) -> Path:
        """Write a mosaic as a DNG and return its path.

        Parameters
        ----------
        mosaic : Mosaic
            The shot.
        picture : ByteArray
            Its preview, uint8 sRGB (h, w, 3).
        taken : datetime
            Time of the shot, with time zone.

        Raises
        ------
        OutputError
            When that fails; no partial file is left.
        """
        (path,) = self._save_together(lambda: [(mosaic, picture)], [""], taken)
        return path

    def burst(self, frames: Frames, count: int, taken: datetime) -> list[Path]:
        """Write all frames of a burst, or none, and return their paths; see `save`.

        All files are written before the first gets its name, and frame 1 gets its own last:
        whatever ends the program, a burst that has a frame 1 is whole.

        Parameters
        ----------
        frames : Callable[[], Iterable[tuple[Mosaic, ByteArray]]]
            Called for the frames with their previews; called again if another camera takes the name
            meanwhile.
        count : int
            Number of frames.
        taken : datetime
            Time of the first one, which all their names have.
        """
        endings = [frame_name("", number, count) for number in range(1, count + 1)]
        return self._save_together(frames, endings, taken)

    def _save_together(self, frames: Frames, endings: Sequence[str], taken: datetime) -> list[Path]:
        """Save frames under one TIME-COUNTER; their names end with `endings`."""
        while True:
            time = taken.astimezone(UTC)
            stamp = f"{time:%Y%m%dT%H%M%S}.{time.microsecond // 1000:03}Z"
            stem = f"{stamp}-{next(self._counter):06}"
            paths = [self.path / f"{stem}{ending}.dng" for ending in endings]
            try:
                _write_together(paths, frames())
                return paths
            except OutputError as error:
                # another camera saves in the same folder
                if not isinstance(error.__cause__, FileExistsError):
                    raise


def _write_together(paths: Sequence[Path], frames: Iterable[tuple[Mosaic, ByteArray]]) -> None:
    """Write all files or none. They get their names in reverse order, as an ExitStack leaves its
    contexts.
    """
    named: list[Path] = []
    try:
        with ExitStack() as stack:
            for path, (mosaic, picture) in zip(paths, frames, strict=True):
                file = stack.enter_context(_noted_file(path, named))
                file.write(encode_dng(mosaic, picture))
    except BaseException:
        for path in named:
            path.unlink(missing_ok=True)
        raise


@contextmanager
def _noted_file(path: Path, named: list[Path]) -> Iterator[BinaryIO]:
    """Open a durable file, and note its path when it has got its name."""
    with durable_file(path) as file:
        yield file
    named.append(path)
