"""Render a mosaic to a picture file within a limit of memory: band by band, where the format allows it, otherwise as a whole."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shared import Mosaic
from shared.arrays import CodeArray, FloatArray, strips
from shared.dng import PART
from shared.errors import InputError
from shared.progress import Progress
from shared.writing import OnComplete
from tools.host.ahead import WAITING
from tools.host.memory import format_bytes
from tools.pictures.band_writer import FORMATS, write_picture_bands
from tools.pictures.writer import PictureKind, write_picture

if TYPE_CHECKING:
    from offline import RenderSettings, Solved, SolverLog

    Bands = Callable[[RenderSettings, Progress], Iterator[FloatArray]]

# Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/rendering/test_picture_file.py` measures again).
_PROGRAM = 290 * 2**20  # with its libraries and kernels, the oldest that are allowed: the newest take 80 MB less
_MOSAIC = 2.0  # per pixel: sensor codes
_LEAST = "tif"  # the format that needs least
_ENCODING = {
    "png": 36.0,
    "exr": 40.0,
    "npy": 28.0,
    "jxl": 60.0,
}  # per pixel of 3 channels, beside the picture, which is held as a whole
_COMPRESSED = {"jpg": 3.0, "uhdr": 6.0, "dng": 6.0}  # per pixel: of noise, pictures take half of that
_PART = 30.0  # per pixel of a part of a DNG that waits or is compressed
# The bands that wait for a TIFF take less than the planes of the frame that are no longer needed then.


def needed_memory(mosaic: Mosaic, kind: PictureKind, settings: "RenderSettings", frames: int = 1) -> int:
    """Bytes that the whole program needs to render a mosaic to such a file; rather more than it will use.

    frames: of a burst, all like this mosaic.
    """
    from offline import rendering_memory, threads

    (rows, columns), rendering = mosaic.shape, rendering_memory(mosaic, settings)
    if frames > 1:
        from offline.burst import burst_memory

        rendering = burst_memory(frames, mosaic, settings)
    pixels = rows * columns
    kept = _COMPRESSED.get(kind.format, 0.0) * pixels
    if kind.format == "dng":
        kept += _PART * min(PART * (threads() + WAITING + 1), rows) * columns
    if kind.format not in FORMATS:
        channels = len(mosaic.pattern.channels)
        kept += 4 * channels * pixels
        rendering = max(rendering, round(_ENCODING[kind.format] * pixels * max(channels / 3, 1)))
    return round(_PROGRAM + _MOSAIC * frames * pixels + kept + rendering)


def check_memory(mosaic: Mosaic, kind: PictureKind, settings: "RenderSettings", limit: int, frames: int = 1) -> None:
    """Raise InputError when rendering a mosaic, or a burst of such `frames`, to such a file needs more than `limit` bytes."""
    need = needed_memory(mosaic, kind, settings, frames)
    if need <= limit:
        return
    rows, columns = mosaic.shape
    least = needed_memory(mosaic, PictureKind.of(_LEAST), settings, frames)
    remedy = f"use -f {_LEAST}, which needs {format_bytes(least)}, or " if kind.format != _LEAST and least <= limit else ""
    what = f"{frames} frames of {columns} x {rows} pixels" if frames > 1 else f"{columns} x {rows} pixels"
    raise InputError(
        f"{what} as {kind.format} need {format_bytes(need)} of memory, {format_bytes(limit)} are allowed; "
        f"{remedy}set `max_memory={format_bytes(need).replace(' ', '').removesuffix('B')}` if the machine has as much"
    )


def render_to(
    output: Path,
    mosaic: Mosaic,
    kind: PictureKind,
    settings: "RenderSettings",
    progress: Progress,
    *,
    exposure: float,
    overwrite: bool,
    on_complete: OnComplete | None = None,
    bands: "Bands | None" = None,
) -> "Mapping[str, Solved]":
    """Render a mosaic and write the picture, whole or not at all. Returns what the solvers did (`offline.Rendering.solvers`).

    exposure: stops by which the picture is brightened.
    overwrite: replace an existing file.
    on_complete: see `shared.writing.durable_file`.
    bands: makes the bands of the picture; None = `offline.render_bands` of the mosaic, which otherwise only describes it.
    """
    from offline import SolverLog, render_bands, threads

    log = SolverLog(progress)
    rendered = _shown(bands(settings, log) if bands else render_bands(mosaic, settings, log), log, kind, mosaic)
    if kind.format in FORMATS:
        write = partial(write_picture_bands, output, rendered, mosaic.shape, kind, threads=threads())
    else:
        rgb, top = np.empty((*mosaic.shape, len(mosaic.pattern.channels)), np.float32), 0
        for band in rendered:
            rgb[top : top + len(band)] = band
            top += len(band)
        progress.stage("writing", 1)
        write = partial(write_picture, output, rgb, kind)
    write(
        calibration=mosaic.calibration,
        metadata=mosaic.metadata,
        exposure=exposure,
        restored=settings.highlights.restored,
        overwrite=overwrite,
        on_complete=on_complete,
    )
    return log.solvers


def _shown(bands: Iterable[FloatArray], log: "SolverLog", kind: PictureKind, mosaic: Mosaic) -> Iterator[FloatArray]:
    """The bands as pictures of this kind show them. log: knows where light is lost from the first band on."""
    top = 0
    for band in bands:
        lost = None if log.places is None else log.places[top : top + len(band)]
        yield kind.shown(band, lost, mosaic.calibration)
        top += len(band)


def check_light(mosaic: Mosaic, settings: "RenderSettings") -> None:
    """Raise InputError for a frame that holds no picture for these settings: all black, or all saturated.

    Settings that restore luminance from the colour samples accept a frame until these are saturated as well.
    """
    codes, calibration, restored = mosaic.codes, mosaic.calibration, settings.highlights.restored

    def parts(*, every: bool = False) -> Iterator[CodeArray]:
        """The panchromatic samples, or all, a few rows at a time: of a picture the first ones say enough."""
        for rows in strips(len(codes)):
            part = codes[rows]
            yield part if every else part[mosaic.pattern.panchromatic_mask((len(part), codes.shape[1]), (rows.start, 0))]

    if not any(part.size for part in parts()):
        return
    if not any((part > calibration.black_level[-1]).any() for part in parts()):
        raise InputError("no sample is above the black level: nothing was exposed, or the calibration's black level is too high")
    if not any((part < calibration.white_level).any() for part in parts(every=restored)):
        which = "sample" if restored else "panchromatic sample"
        raise InputError(f"every {which} is saturated: there is no picture in it; expose less")
