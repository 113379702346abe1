"""Write a rendering to a picture file, band by band, so that where the format allows it is never in memory as a whole."""

from collections.abc import Iterable
from pathlib import Path

from shared.arrays import FloatArray
from shared.writing import OnComplete, durable_file

from .development import Development


def write_picture(
    path: Path | str,
    bands: Iterable[FloatArray],
    development: Development,
    *,
    overwrite: bool = False,
    on_complete: OnComplete | None = None,
    threads: int = 1,
) -> None:
    """Write the bands of a rendering as they arrive, atomically; the file does not depend on how the picture is divided into bands.

    The bands are taken in this thread. Others convert, compress and write those that have arrived.

    path: the file.
    bands: floating point (rows, W, C), scene units, C the calibration's channels, from top to bottom; any size from 1 x 1. With
        `PictureKind.uncertainty` (rows, W, C + 1 + C), as `offline.colour_bands` yields them.
    overwrite, on_complete: see `durable_file`.
    threads: number of threads that convert and compress.

    Pictures in bands that must be rotated or flipped vertically are assembled in an anonymous temporary file in the same folder.
    Raises InputError as `Development.check` does, and if a band is no such picture. Exceptions raised by `bands` pass through, and
    leave no file.
    """
    development.check()
    with durable_file(path, overwrite=overwrite, on_complete=on_complete) as file:
        development.kind.kept_as.write(file, bands, development, threads=threads, folder=Path(path).parent)
