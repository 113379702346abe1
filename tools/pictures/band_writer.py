"""Write a rendering to a file band by band, so that it is never in memory as a whole: of a JPEG or DNG only what is compressed."""

import tempfile
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import DTypeLike, NDArray

from shared import CaptureMetadata, SensorCalibration
from shared.arrays import FloatArray
from shared.display import ColourTransform, checked_picture
from shared.errors import InputError
from shared.tiff import encode_tiff, write_tiff
from shared.writing import OnComplete, durable_file
from tools.host.ahead import ahead

from .encoders import encode_jpeg_bands, write_tiff_picture
from .exif_writing import jpeg_directory, picture_directory
from .gain_map import GainMap
from .samples import upright
from .ultra_hdr import encode_ultra_hdr_bands
from .writer import PictureKind, check_output, labels, linear_dng, to_samples, written_shape

FORMATS = ("tif", "jpg", "uhdr", "dng")
"""The formats that can be written in bands."""
_READ = 64  # rows read back at a time
_RENDERING = 4  # threads that render, for each that converts: at most a fifth of their time


def write_picture_bands(
    path: Path | str,
    bands: Iterable[FloatArray],
    shape: tuple[int, int],
    kind: PictureKind,
    *,
    calibration: SensorCalibration,
    metadata: CaptureMetadata,
    exposure: float = 0.0,
    restored: bool = True,
    overwrite: bool = False,
    on_complete: OnComplete | None = None,
    threads: int = 1,
) -> None:
    """Write the bands of a rendering as they arrive; the file is identical to the one of `write_picture`, and written atomically.

    The bands are taken in this thread. Others convert, compress and write those that have arrived.

    path: the file.
    bands: float32 (rows, W, C), scene units, from top to bottom.
    shape: (H, W) of the whole rendering.
    kind, calibration, metadata, exposure, restored: see `encode_picture`; the format is one of `FORMATS`.
    overwrite, on_complete: see `durable_file`.
    threads: number of threads that convert and compress.

    Pictures that must be rotated or flipped vertically are assembled in an anonymous temporary file in the same folder. Raises
    InputError for another format, and as `write_picture` does. Exceptions raised by `bands` pass through, and leave no file.
    """
    if kind.format not in FORMATS:
        raise InputError(f"{kind.format} cannot be written in parts; use {FORMATS[0]}")
    check_output(kind, calibration, shape, exposure)
    channels, icc, noted, turn = labels(kind, calibration, metadata)
    whole = written_shape(kind, shape, metadata)
    checked = partial(checked_picture, channels=len(calibration.channels))
    if kind.format == "dng":
        main = linear_dng(map(checked, bands), shape, calibration, metadata, threads, restored=restored)
        with durable_file(path, overwrite=overwrite, on_complete=on_complete) as file:
            write_tiff(file, main, main.strips)
        return

    def convert(band: FloatArray) -> NDArray[Any]:
        return to_samples(checked(band), kind, calibration, exposure, restored=restored)

    dtype = {8: np.uint8, 16: np.uint16, 32: np.float32}[kind.bits]
    srgb = kind.space == "srgb"
    with (
        durable_file(path, overwrite=overwrite, on_complete=on_complete) as file,
        tempfile.TemporaryFile(dir=Path(path).parent) as spool,
    ):
        converted = ahead(convert, bands, -(-threads // _RENDERING))
        depth = 4 if kind.format == "uhdr" else len(channels)  # the codes of the gains too
        turned = _turn(converted, (*shape, depth), dtype, turn, spool)
        if kind.format in ("jpg", "uhdr"):
            exif = encode_tiff(jpeg_directory(noted, whole, srgb=srgb))
            encode = encode_jpeg_bands
            if kind.format == "uhdr":
                shown = ColourTransform.to_space(calibration, kind.space, restored=restored)
                encode = partial(encode_ultra_hdr_bands, gains=GainMap(shown, exposure))
            file.write(encode(turned, whole, icc=icc, exif=exif, quality=kind.quality, threads=threads))
        else:
            directory = picture_directory(noted, srgb=srgb)
            rgb = channels == "RGB"
            write_tiff_picture(file, turned, (*whole, len(channels)), dtype, directory, icc=icc, rgb=rgb, threads=threads)


def _turn(
    bands: Iterable[NDArray[Any]], shape: tuple[int, int, int], dtype: DTypeLike, orientation: int, spool: BinaryIO
) -> Iterator[NDArray[Any]]:
    """Turn a picture of `shape` (H, W, C) upright: yield bands of the turned picture. The file `spool` holds it meanwhile."""
    if orientation in (1, 2):  # rows stay rows, in the same order
        yield from (upright(band, orientation) for band in bands)
        return
    for band in bands:
        spool.write(np.ascontiguousarray(band).data)
    spool.flush()
    for top in range(0, shape[1] if orientation >= 5 else shape[0], _READ):
        # Mapped again for each band: pages that have been read count as memory of the process as long as they are mapped.
        yield np.array(upright(np.memmap(spool, dtype, "r", shape=shape), orientation)[top : top + _READ])
