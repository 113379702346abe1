"""Checks before a render: memory, and light in the frame."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...shared import CodeArray, InputError, Mosaic
from ...shared.arrays import strips
from ..io.kind import PictureKind
from .memory import format_bytes

if TYPE_CHECKING:
    from ...offline import RenderSettings

# Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/batch/test_memory.py` measures
# again). with its libraries and kernels, the oldest that are allowed: the newest take 80 MB less
_PROGRAM = 290 * 2**20
_THREAD = 20 * 2**20  # of each thread: its own heap
_MOSAIC = 2.0  # per pixel: sensor codes


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


def check_light(mosaic: Mosaic, settings: "RenderSettings") -> None:
    """Raise InputError for a frame that holds no picture for these settings: all black, or all
    saturated.

    Settings that restore luminance from the colour samples accept a frame until these are saturated
    as well.
    """
    codes, calibration, restored = mosaic.codes, mosaic.calibration, settings.highlights.restored

    def panchromatic() -> Iterator[CodeArray]:
        """Yield the panchromatic samples, a few rows at a time: of a picture the first ones say
        enough.
        """
        for rows in strips(len(codes)):
            shape = codes[rows].shape[0], codes.shape[1]
            yield codes[rows][mosaic.pattern.panchromatic_mask(shape, (rows.start, 0))]

    if not any(samples.size for samples in panchromatic()):
        return
    if not any((samples > calibration.black_level[-1]).any() for samples in panchromatic()):
        reason = "nothing was exposed, or the calibration's black level is too high"
        raise InputError(f"no sample is above the black level: {reason}")
    counted = (codes[rows] for rows in strips(len(codes))) if restored else panchromatic()
    if not any((samples < calibration.white_level).any() for samples in counted):
        which = "sample" if restored else "panchromatic sample"
        raise InputError(f"every {which} is saturated: there is no picture in it; expose less")
