"""One mosaic -> one picture file, within a limit of memory: TIFF in bands, straight to the disk, other formats as a whole."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shared import Mosaic
from shared.arrays import FloatArray, strips
from shared.errors import InputError
from shared.writing import OnComplete
from tools.host.console import StageProgress
from tools.host.memory import format_bytes
from tools.pictures.band_writer import FORMAT, write_picture_bands
from tools.pictures.writer import PictureKind, write_picture

if TYPE_CHECKING:
    from offline import RenderSettings

# Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/rendering/test_picture_file.py` measures again).
_PROGRAM = 250 * 2**20  # with its libraries and kernels
_MOSAIC, _LUMINANCE = 6.0, 5.0  # per pixel: codes and signal, and what is made of them
_BLOCK = 220.0  # per colour block, while their chromaticities are estimated
_BAND = 48.0, 28.0  # per pixel of a band, and per channel of it: four fields, then the same rows at several stages
_ENCODING = {"png": 36.0, "jpg": 20.0, "dng": 30.0, "exr": 40.0, "npy": 28.0}  # per pixel, beside the picture itself


def needed_memory(mosaic: Mosaic, kind: PictureKind, settings: "RenderSettings") -> int:
    """Bytes that the program needs to render such a file of a mosaic, roughly, but rather more than it will."""
    from offline import band_rows

    (height, width), channels = mosaic.shape, len(mosaic.pattern.channels)
    pixels = height * width
    picture = 0 if kind.format == FORMAT else 4 * channels * pixels
    blocks = _BLOCK * pixels / mosaic.pattern.period**2
    band = (_BAND[0] + _BAND[1] * channels) * min(band_rows(mosaic, settings), height) * width
    rendering = _LUMINANCE * pixels + max(blocks, band)
    encoding = _ENCODING.get(kind.format, 0.0) * pixels
    return round(_PROGRAM + _MOSAIC * pixels + picture + max(rendering, encoding))


def check_memory(mosaic: Mosaic, kind: PictureKind, settings: "RenderSettings", limit: int) -> None:
    """Raise InputError when rendering such a file needs more than `limit` bytes."""
    need = needed_memory(mosaic, kind, settings)
    if need <= limit:
        return
    rows, columns = mosaic.shape
    least = needed_memory(mosaic, PictureKind.of(FORMAT), settings)
    remedy = f"use -f {FORMAT}, which needs {format_bytes(least)}, or" if kind.format != FORMAT and least <= limit else ""
    raise InputError(
        f"{columns} x {rows} pixels as {kind.format} need {format_bytes(need)} of memory, {format_bytes(limit)} are allowed; "
        f"{remedy} set --max-memory {format_bytes(need).replace(' ', '').removesuffix('B')} if the machine has as much".replace(
            "  ", " "
        )
    )


def render_to(
    output: Path,
    mosaic: Mosaic,
    kind: PictureKind,
    settings: "RenderSettings",
    progress: StageProgress,
    *,
    exposure: float,
    overwrite: bool,
    on_complete: OnComplete | None = None,
) -> None:
    """Render a mosaic and write the picture, whole or not at all. on_complete: see `durable_file`."""
    from offline import render_bands

    bands = render_bands(mosaic, settings, progress)
    calibration, metadata = mosaic.calibration, mosaic.metadata
    if kind.format == FORMAT:
        write_picture_bands(
            output,
            bands,
            mosaic.shape,
            kind,
            calibration=calibration,
            metadata=metadata,
            exposure=exposure,
            overwrite=overwrite,
            on_complete=on_complete,
        )
        return
    rgb = np.empty((*mosaic.shape, len(mosaic.pattern.channels)), np.float32)
    _fill(rgb, bands)
    progress.stage("writing", 1)
    write_picture(
        output,
        rgb,
        kind,
        calibration=calibration,
        metadata=metadata,
        exposure=exposure,
        overwrite=overwrite,
        on_complete=on_complete,
    )


def _fill(rgb: FloatArray, bands: Iterator[FloatArray]) -> None:
    top = 0
    for band in bands:
        rgb[top : top + len(band)] = band
        top += len(band)


def check_light(mosaic: Mosaic, settings: "RenderSettings") -> None:
    """Raise InputError for a frame that holds no picture for these settings: all black, or all saturated.

    Where luminance is restored from colour samples, it takes these to be saturated as well.
    """
    panchromatic, (height, width) = len(mosaic.pattern.channels), mosaic.shape
    lowest, highest = [], []
    for rows in strips(height):
        planes = mosaic.pattern.filter_map((rows.stop - rows.start, width), (rows.start, 0))
        measured = mosaic.signal[rows][planes == panchromatic]
        if measured.size:
            lowest.append((mosaic.signal[rows] if settings.highlights.restored else measured).min())
            highest.append(measured.max())
    if highest and max(highest) <= 0:
        raise InputError("no sample is above the black level: nothing was exposed, or the calibration's black level is too high")
    if lowest and min(lowest) >= mosaic.calibration.full_scale:
        which = "sample" if settings.highlights.restored else "panchromatic sample"
        raise InputError(f"every {which} is saturated: there is no picture in it; expose less")
