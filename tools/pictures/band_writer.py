"""A picture that never is in memory as a whole -> a TIFF file: bands of a rendering, as they come, straight to the disk."""

import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from shared import CaptureMetadata, SensorCalibration
from shared.arrays import FloatArray
from shared.display import ColourTransform, checked_picture
from shared.errors import InputError
from shared.writing import OnComplete, durable_file

from .encoders import write_tiff_picture
from .exif_writing import picture_directory
from .icc_writing import icc_profile
from .samples import quantise, upright
from .writer import CAMERA, PictureKind, check_output

FORMAT = "tif"
"""The one format that can be written so."""
_READ = 64  # rows read back at a time


def write_picture_bands(
    path: Path | str,
    bands: Iterable[FloatArray],
    shape: tuple[int, int],
    kind: PictureKind,
    *,
    calibration: SensorCalibration,
    metadata: CaptureMetadata,
    exposure: float = 0.0,
    overwrite: bool = False,
    on_complete: OnComplete | None = None,
) -> None:
    """The same file as of `picture_writer.write_picture` with the picture that the bands (rows, W, C) make up; whole or not at all.

    shape: (H, W) of the rendering. A picture whose rows do not stay rows in this order when it is turned upright is put together
    in a temporary file without a name, in the same folder. on_complete: see `durable_file`. Raises InputError for another format
    than TIFF, and as `write_picture` does; what is raised while the bands are made passes through, and leaves no file.
    """
    if kind.format != FORMAT:
        raise InputError(f"{kind.format} cannot be written in parts; use {FORMAT}")
    check_output(kind, calibration, shape, exposure)
    channels = calibration.channels
    checked = (checked_picture(band, len(channels)) for band in bands)
    with durable_file(path, overwrite=overwrite, on_complete=on_complete) as file:
        directory = picture_directory(metadata, srgb=kind.space == "srgb")
        if kind.space == CAMERA:
            write_tiff_picture(file, checked, (*shape, len(channels)), np.float32, directory, rgb=channels == "RGB")
            return
        transform = ColourTransform.to_space(calibration, kind.space)
        shown = (_samples(transform.apply(band, exposure), kind.bits) for band in checked)
        directory = picture_directory(replace(metadata, orientation=1), srgb=kind.space == "srgb")
        turned = shape[::-1] if metadata.orientation >= 5 else shape
        dtype = {8: np.uint8, 16: np.uint16, 32: np.float32}[kind.bits]
        with tempfile.TemporaryFile(dir=Path(path).parent, buffering=0) as spool:
            upright_bands = _turn(shown, shape, metadata.orientation, spool)
            write_tiff_picture(file, upright_bands, (*turned, 3), dtype, directory, icc=icc_profile(kind.space))


def _samples(picture: FloatArray, bits: int) -> NDArray[Any]:
    return picture if bits == 32 else quantise(picture, bits)


def _turn(bands: Iterable[NDArray[Any]], shape: tuple[int, int], orientation: int, spool: BinaryIO) -> Iterator[NDArray[Any]]:
    """Bands of the picture turned upright, from bands of the picture, whose `shape` is (H, W)."""
    if orientation in (1, 2):  # rows stay rows, and in their order
        yield from (upright(band, orientation) for band in bands)
        return
    height, width = shape
    swapped, backwards = orientation >= 5, orientation in (3, 4, 6, 7)
    done, pixel, dtype = 0, 0, np.dtype(np.uint8)
    for band in bands:
        dtype, pixel = band.dtype, band.itemsize * band.shape[2]
        first = height - done - len(band) if backwards else done
        part = np.ascontiguousarray(upright(band, orientation))
        done += len(band)
        if not swapped:
            _write_at(spool, first * width * pixel, part)
            continue
        for row, line in enumerate(part):
            _write_at(spool, (row * height + first) * pixel, line)
    rows, columns = (width, height) if swapped else (height, width)
    for top in range(0, rows, _READ):
        count = min(_READ, rows - top)
        spool.seek(top * columns * pixel)
        data = spool.read(count * columns * pixel)
        yield np.frombuffer(data, dtype).reshape(count, columns, -1)


def _write_at(spool: BinaryIO, place: int, data: NDArray[Any]) -> None:
    spool.seek(place)
    rest = data.data.cast("B")
    while rest:  # an unbuffered file may take a part
        rest = rest[spool.write(rest) :]
