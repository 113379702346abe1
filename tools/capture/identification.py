"""What a frame of a sensor that nobody described shows of its filters."""

import os
import sys
from collections import Counter
from itertools import permutations
from typing import Any

import numpy as np

from device.capture.frames import FORMATS, Bytes, FrameLayout, read_frames
from shared.arrays import CodeArray
from shared.errors import InputError
from shared.pattern import PANCHROMATIC
from shared.reading import opened_file

from .identity import DENSE, UNKNOWN, identify, pattern_of
from .readings import candidates, likely_strides, read_as
from .source import STREAM, SourceOptions, layout_of, recording, standard_input

NOTHING = (
    "the frame shows no pattern of filters: it is too dark, too even or too small, or there are none. Photograph something with "
    "many colours in good light, not overexposed; the larger the frame the better"
)
_COLOURS = "RGB"
_LIKELY, _NEAR = 2, 2  # strides at which rows repeat the most; groups of samples by which they may be wrong


def first_frame(given: SourceOptions) -> tuple[Bytes, FrameLayout]:
    """The bytes of the first frame in a file or stream that is described, and their layout.

    Raises InputError for what cannot be read, and for a description that does not fit.
    """
    layout, _ = layout_of(given)
    if given.source == STREAM:
        recording()
        with standard_input() as stream:
            return next(read_frames(stream, layout)).data, layout
    with opened_file(given.source, sys.maxsize, "a raw frame") as file:
        layout.check_recording(file.seek(0, os.SEEK_END))
        file.seek(0)
        data = file.read(layout.frame_bytes)
    layout.unpack(data)  # raises InputError
    return data, layout


def likely_reading(data: Bytes, layout: FrameLayout) -> str:
    """The options with which the bytes of a frame show a tile that has a name, and that name; "" if there are none.

    layout: the one in which they do not. A wrong one hardly ever shows such a tile: of 108 pairs of formats and tiles none did.
    """
    # Scattered sites repeat in every other row, too, and rows that are shifted by a pixel or two resemble each other even more.
    repeats = [part for stride in likely_strides(data, layout.stride)[:_LIKELY] for part in (stride, stride // 2)]
    tight = FrameLayout(layout.width, 1, layout.format).stride
    strides = list(dict.fromkeys([layout.stride, tight, *repeats]))
    reach = _NEAR * FORMATS[layout.format].length
    near = [stride + shift for stride in repeats for shift in range(-reach, reach + 1) if shift and stride + shift > 0]
    best, advice = 0.0, ""
    for readings in (candidates(layout, strides), ((layout.format, stride, 0) for stride in near)):
        for name, stride, skipped in readings:
            found = identify(read_as(data, layout, name, stride, skipped))
            if found and found.name and found.certainty > best:
                best, advice = found.certainty, _advice(layout, name, stride, skipped, found.name)
        if advice:
            break
    return advice


def _advice(layout: FrameLayout, name: str, stride: int, skipped: int, tile: str) -> str:
    packing = FORMATS[name]
    width = stride // packing.length * packing.pixels
    options = [f"`pixel_format={name}`"] if name != layout.format else []
    if stride != FrameLayout(min(layout.width, width), 1, name, layout.stride if name == layout.format else 0).stride:
        options.append(f"`stride={stride}`")
    if width < layout.width:
        options.append(f"`width={width}` or less")
    if skipped:
        options.append(f"a stream without {skipped} bytes (or whole groups of samples more) before the first sample")
    return f"likely {' '.join(options)}, which shows the tile {tile}"


def facts_of(codes: CodeArray) -> dict[str, Any]:
    """What a frame (H, W) shows of the filters, see `Identity`; `pattern` and `alternatives` are those that fit.

    Raises InputError that says what to photograph if the frame shows no pattern.
    """
    found = identify(codes)
    if found is None:
        raise InputError(NOTHING)
    others = _exchanged(found.tile)
    clear = np.array([[letter == PANCHROMATIC for letter in row] for row in found.tile])
    gap = float(found.light[clear].min() - found.light[~clear].max()) / float(np.ptp(found.light)) if clear.any() else None
    return {
        "width": codes.shape[1],
        "height": codes.shape[0],
        "period": found.period,
        "certainty": round(found.certainty, 1),
        "panchromatic": np.argwhere(clear).tolist(),
        "gap": gap and round(gap, 2),
        "letters": list(found.tile),
        "separation": round(found.separation, 1),
        "name": found.name or None,
        "dense": found.name in DENSE,
        "open": UNKNOWN in "".join(found.tile),
        "light": found.light.round(4).tolist(),
        "pattern": _described(found.tile),
        "exchangeable": bool(others),
        "alternatives": [each for tile in others if (each := _described(tile))],
    }


def _exchanged(tile: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The tiles that would fit as well: colours with equally many sites are exchanged."""
    sites = Counter("".join(tile))
    orders = (order for order in permutations(_COLOURS) if all(sites[a] == sites[b] for a, b in zip(_COLOURS, order, strict=True)))
    tiles = (tuple(row.translate(str.maketrans(_COLOURS, "".join(order))) for row in tile) for order in orders)
    return [each for each in tiles if each != tile]


def _described(tile: tuple[str, ...]) -> tuple[str, tuple[int, int]] | None:
    """Name, or letters, and origin of `pattern_of` a tile."""
    pattern = pattern_of(tile)
    return (pattern.name.casefold() or "/".join(pattern.tile), pattern.origin) if pattern else None
