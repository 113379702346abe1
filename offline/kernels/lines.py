"""Chromaticity taken to the colour lines around each pixel."""

import numpy as np

from .arrays import Floats1, Floats2, Floats3
from .compile import Pieces, parallel_kernel
from .functions import unset

_LEAST_SHARE = np.float32(1e-3)  # of a line, below which a pixel stays as it is; chosen, for speed
_ZERO, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)


@parallel_kernel()
def lead_to_lines(
    pieces: Pieces,
    light: Floats2,
    colour: Floats3,
    lines: Floats3,
    first: tuple[float, float],
    period: int,
    gamma: Floats1,
    dark: float,
    even: float,
    out: Floats3,
) -> None:
    """Take chromaticities to those of lines that are interpolated between blocks.

    light, colour: luminance (rows, W) and chromaticity (rows, W, C) of a part of the picture.
    lines: (1 + 2 C, block rows, block columns): the share of each line, then its share times offsets and times slopes.
    first: where the first block lies in the part, in pixels, which may be outside.
    period: pixels between blocks. gamma: (C,). dark: luminance up to which a pixel stays as it is.
    even: distance of a colour from its line, a share of the light, up to which it stays too.
    out: (rows, W, C), written.
    """
    (parts, down, across), width, count = lines.shape, light.shape[1], len(gamma)
    line, found, least = unset(parts, across), unset(count), np.float32(even**2)
    for row in range(pieces[0], pieces[1]):
        place = min(max((row - first[0]) / period, 0.0), down - 1.0)
        above = min(int(place), max(down - 2, 0))
        below, near = min(above + 1, down - 1), np.float32(place - above)
        for part in range(parts):
            for column in range(across):
                line[part, column] = lines[part, above, column] + near * (lines[part, below, column] - lines[part, above, column])
        for column in range(width):
            at = min(max((column - first[1]) / period, 0.0), across - 1.0)
            left = min(int(at), max(across - 2, 0))
            right, near = min(left + 1, across - 1), np.float32(at - left)
            share = line[0, left] + near * (line[0, right] - line[0, left])
            total, bright = _ZERO, light[row, column]
            if share > _LEAST_SHARE and bright > dark:
                for channel in range(count):
                    offset, slope = line[1 + channel], line[1 + count + channel]
                    value = offset[left] + near * (offset[right] - offset[left])
                    value += bright * (slope[left] + near * (slope[right] - slope[left]))
                    # A line has positive colours: beyond the darkest one it is that of the channels that are left.
                    found[channel] = max(value, _ZERO)
                    total += found[channel]
            known, apart = total > _ZERO and total > _HALF * share * bright, _ZERO
            if known:
                for channel in range(count):
                    found[channel] = found[channel] / (gamma[channel] * total) - colour[row, column, channel]
                    apart += (gamma[channel] * found[channel]) ** 2
                share *= _ONE - least / max(apart, least)
            for channel in range(count):
                out[row, column, channel] = colour[row, column, channel] + (share * found[channel] if known else _ZERO)
