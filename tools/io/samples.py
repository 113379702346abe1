"""Display RGB as samples of a picture file: integer codes, turned upright; and bands of samples,
divided otherwise.
"""

import tempfile
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import ByteArray, CodeArray, FloatArray, strips
from ...shared.errors import InputError, OutputError
from ...shared.writing import reason
from .display import ColourTransform

_READ = 64  # rows read back at a time

Sample = TypeVar("Sample", bound=np.generic)


def quantise(encoded: FloatArray, bits: int) -> ByteArray | CodeArray:
    """Return the nearest of 2**bits codes for finite values of any shape, clipped to 0..1: uint8 (8
    bits) or uint16 (16).
    """
    top = np.float32((1 << bits) - 1)
    codes = np.empty(encoded.shape, np.uint8 if bits == 8 else np.uint16)
    for rows in strips(len(encoded)):
        scaled = encoded[rows].clip(0.0, 1.0)
        scaled *= top
        codes[rows] = np.rint(scaled, out=scaled)
    return codes


def upright(picture: NDArray[Sample], orientation: int) -> NDArray[Sample]:
    """Return a view of the samples (H, W, ...) turned and mirrored by a TIFF orientation, 1 to 8
    (TIFF 6.0, tag 274).
    """
    if orientation not in range(1, 9):
        raise InputError(f"orientation is {orientation}, expected 1 to 8")
    if orientation >= 5:  # the stored rows are columns of the scene
        picture = picture.swapaxes(0, 1)
    # Direction of each axis after the swap.
    down = -1 if orientation in (3, 4, 7, 8) else 1
    across = -1 if orientation in (2, 3, 6, 7) else 1
    return picture[::down, ::across]


def display_codes(
    rgb: FloatArray, shown: ColourTransform, bits: int, exposure: float = 0.0
) -> NDArray[Any]:
    """`quantise(shown.apply(rgb, exposure), bits)`, by a few rows at a time that stay in the
    processor's cache.
    """
    codes = np.empty((*rgb.shape[:2], 3), np.uint8 if bits == 8 else np.uint16)
    for rows, channel, plane in shown.planes(rgb, exposure):
        codes[rows, :, channel] = quantise(plane, bits)
    return codes


def joined(bands: Iterable[NDArray[Sample]], rows: int) -> NDArray[Sample]:
    """The bands (any, ...) of a picture with this number of rows as one array; of each only its
    copy is kept.
    """
    arriving = iter(bands)
    first = next(arriving)
    whole, top = np.empty((rows, *first.shape[1:]), first.dtype), 0
    for band in chain([first], arriving):
        whole[top : top + len(band)] = band
        top += len(band)
    return whole


def regrouped(bands: Iterable[NDArray[Any]], rows: int) -> Iterator[NDArray[Any]]:
    """Yield the rows of `bands` in groups of `rows`; the last group may be smaller."""
    kept: list[NDArray[Any]] = []
    for band in bands:
        kept.append(band)
        while (count := sum(map(len, kept))) >= rows:
            together = np.concatenate(kept) if len(kept) > 1 else kept[0]
            whole = count // rows * rows
            yield from (together[top : top + rows] for top in range(0, whole, rows))
            kept = [together[whole:]]
    if any(map(len, kept)):
        yield np.concatenate(kept)


def turned(
    bands: Iterable[NDArray[Any]], shape: tuple[int, int], orientation: int, folder: Path
) -> Iterator[NDArray[Any]]:
    """Turn a picture of `shape` (H, W) upright: yield bands of the turned picture. An anonymous
    file in `folder` holds it.
    """
    if orientation in (1, 2):  # rows stay rows, in the same order
        yield from (upright(band, orientation) for band in bands)
        return
    with tempfile.TemporaryFile(dir=folder, buffering=0) as spool:
        for band in bands:
            left = np.ascontiguousarray(band).data.cast("B")
            try:
                while left:
                    left = left[spool.write(left) :]
            except OSError as error:
                why = reason(error, folder)
                raise OutputError(f"{folder}: no temporary file: {why}") from error
        for top in range(0, shape[1] if orientation >= 5 else shape[0], _READ):
            # Mapped again for each band: pages that have been read count as memory of the process
            # as long as they are mapped.
            whole = np.memmap(spool, band.dtype, "r", shape=(*shape, *band.shape[2:]))
            yield np.array(upright(whole, orientation)[top : top + _READ])
