"""What the colour samples of all frames of a burst say about the colour of every pixel.

A picture misses each sample by some error. The correction of the picture's colour is the one that leaves little of these errors
and changes little from pixel to pixel, except across edges of luminance: a sum of squares, whose minimum conjugate gradients find.
Without samples near a pixel its correction fades to nothing. Corrections leave luminance as it is.

Colours are weighted by gamma here: then channels have the unit of luminance, and a colour is a set of C numbers that add up to
zero. C - 1 numbers on an orthonormal basis tell it.
"""

import numpy as np

from shared.arrays import ByteArray, FloatArray, IndexArray

from .compile import kernel, parallel_kernel, prange
from .functions import zeros
from .lanes import Scalar

TILE = 128
"""Rows and columns of a tile, which is solved at a time."""
HALO = 24
"""Pixels around a tile that are solved with it."""
_TOLERANCE, _ITERATIONS = 3e-3, 100
_NONE, _ONE, _HALF = np.float32(0), np.float32(1), np.float32(0.5)
_DARK = np.float32(1e-6)

Samples = tuple[FloatArray, ByteArray, IndexArray]
"""(figures, channels, starts) of M samples, sorted by tile: (M, 5), row and column in the frame, value times gamma, luminance,
precision; (M,), their channels; (tiles + 1,), where those of each tile begin, tiles counted row by row."""
Prior = tuple[float, float, float]
"""(smoothness, fading, edge), as `spread_samples` takes them."""


@parallel_kernel(
    "f4[:, ::1], f4[:, :, ::1], i8, (i8, i8), i8, (f4[:, ::1], u1[::1], i8[::1]), f4[::1], f4[:, ::1], (f8, f8, f8), f4[:, :, ::1]"
)
def spread_samples(
    luminance: FloatArray,
    chromaticity: FloatArray,
    first: int,
    rows: tuple[int, int],
    height: int,
    samples: Samples,
    gamma: FloatArray,
    basis: FloatArray,
    prior: Prior,
    out: FloatArray,
) -> None:
    """Correct the chromaticity of some rows of the frame.

    luminance, chromaticity: (rows, W) and (rows, W, C), a part of the picture that reaches `HALO` beyond the rows to correct.
    first: the frame's row at luminance[0].
    rows: first and end row to correct; the first is a multiple of `TILE`, and so is the end, or it is the frame's.
    height: rows of the frame.
    gamma: (C,), the weights of Eq. 7. basis: (C, C - 1), orthonormal columns that add up to zero.
    prior: smoothness and fading relative to the precision of a sample, and the difference of luminance, scene units, that is an
        edge.
    out: (rows, W, C), written.
    """
    width, channels = luminance.shape[1], len(gamma)
    along = (width + TILE - 1) // TILE
    for number in prange((rows[1] - rows[0] + TILE - 1) // TILE * along):
        top, left = rows[0] + number // along * TILE, number % along * TILE
        bottom, right = min(top + TILE, rows[1]), min(left + TILE, width)
        area = max(top - HALO, 0), min(bottom + HALO, height), max(left - HALO, 0), min(right + HALO, width)
        size = area[1] - area[0], area[3] - area[2]
        light = luminance[area[0] - first : area[1] - first, area[2] : area[3]]
        colour = chromaticity[area[0] - first : area[1] - first, area[2] : area[3]]
        unknowns = zeros(channels - 1, *size)
        normal, right_side = zeros((channels - 1) * channels // 2, *size), zeros(channels - 1, *size)
        _gather(light, colour, area, (top // TILE, left // TILE), (height, width), samples, gamma, basis, normal, right_side)
        links = zeros(4, *size)
        link(light, prior, links)
        solve(normal, right_side, links, np.float32(prior[1]), _TOLERANCE, unknowns)
        for row in range(top, bottom):
            for column in range(left, right):
                y, x = row - area[0], column - area[2]
                lit = light[y, x] > _DARK
                for channel in range(channels):
                    step = _NONE
                    for part in range(channels - 1):
                        step += basis[channel, part] * unknowns[part, y, x]
                    change = step / (gamma[channel] * light[y, x]) if lit else _NONE
                    out[row - rows[0], column, channel] = colour[y, x, channel] + change


@kernel
def _gather(
    light: FloatArray, colour: FloatArray, area: tuple[int, int, int, int], tile: tuple[int, int], shape: tuple[int, int],
    samples: Samples, gamma: FloatArray, basis: FloatArray, normal: FloatArray, right_side: FloatArray,
) -> None:  # fmt: skip
    """Compute the normal equations of the samples in an area, each shared out to the four pixels around it."""
    figures, channels, starts = samples
    down, along = (shape[0] + TILE - 1) // TILE, (shape[1] + TILE - 1) // TILE
    parts = basis.shape[1]
    for row in range(max(tile[0] - 1, 0), min(tile[0] + 2, down)):
        for column in range(max(tile[1] - 1, 0), min(tile[1] + 2, along)):
            for sample in range(starts[row * along + column], starts[row * along + column + 1]):
                y, x = figures[sample, 0] - np.float32(area[0]), figures[sample, 1] - np.float32(area[2])
                if not (_NONE <= y <= light.shape[0] - 1 and _NONE <= x <= light.shape[1] - 1):
                    continue
                above, before = min(int(y), light.shape[0] - 2), min(int(x), light.shape[1] - 2)
                lower, after = y - np.float32(above), x - np.float32(before)
                channel, weight = channels[sample], figures[sample, 4]
                seen = _NONE
                for corner in range(4):
                    share = _share(corner, lower, after)
                    seen += share * colour[above + corner // 2, before + corner % 2, channel]
                error = figures[sample, 2] - gamma[channel] * seen * figures[sample, 3]
                for corner in range(4):
                    share = _share(corner, lower, after) * weight
                    i, j, place = above + corner // 2, before + corner % 2, 0
                    for part in range(parts):
                        right_side[part, i, j] += share * basis[channel, part] * error
                        for other in range(part, parts):
                            normal[place, i, j] += share * basis[channel, part] * basis[channel, other]
                            place += 1


@kernel
def _share(corner: int, down: Scalar, along: Scalar) -> Scalar:
    """The share of one of the four pixels around a place in bilinear interpolation."""
    return (down if corner // 2 else _ONE - down) * (along if corner % 2 else _ONE - along)


@kernel
def link(light: FloatArray, prior: Prior, links: FloatArray) -> None:
    """How much each pixel is to be like those to the right, below, below right and below left; little across edges."""
    rows, columns = light.shape
    stiff, per_edge = np.float32(prior[0]), np.float32(1 / prior[2] ** 2)
    for row in range(rows):
        for column in range(columns):
            for side in range(4):
                i, j = row + (1 if side else 0), column + (1 if side in (0, 2) else -1 if side == 3 else 0)
                if i < rows and 0 <= j < columns:
                    step = light[i, j] - light[row, column]
                    links[side, row, column] = (stiff if side < 2 else _HALF * stiff) / (_ONE + step * step * per_edge)


@kernel
def solve(
    normal: FloatArray, right_side: FloatArray, links: FloatArray, fading: Scalar, tolerance: float, solution: FloatArray
) -> None:
    """Conjugate gradients, scaled by the diagonal, until the residual is `tolerance` of what it was. solution: zeros at first."""
    parts, rows, columns = right_side.shape
    scale, direction, applied = zeros(parts, rows, columns), zeros(parts, rows, columns), zeros(parts, rows, columns)
    degree = zeros(rows, columns)
    for row in range(rows):
        for column in range(columns):
            for side in range(4):
                if links[side, row, column] > _NONE:
                    i, j = row + (1 if side else 0), column + (1 if side in (0, 2) else -1 if side == 3 else 0)
                    degree[row, column] += links[side, row, column]
                    degree[i, j] += links[side, row, column]
    squared = 0.0
    for part in range(parts):
        place = part * parts - part * (part - 1) // 2
        for row in range(rows):
            for column in range(columns):
                scale[part, row, column] = _ONE / (normal[place, row, column] + degree[row, column] + fading)
                direction[part, row, column] = scale[part, row, column] * right_side[part, row, column]
                squared += right_side[part, row, column] * direction[part, row, column]
    target = squared * tolerance**2
    for _ in range(_ITERATIONS):
        if squared <= target:
            break
        _apply(normal, links, degree, fading, direction, applied)
        curvature = 0.0
        for part in range(parts):
            for row in range(rows):
                for column in range(columns):
                    curvature += direction[part, row, column] * applied[part, row, column]
        step, following = np.float32(squared / curvature), 0.0
        for part in range(parts):
            for row in range(rows):
                for column in range(columns):
                    solution[part, row, column] += step * direction[part, row, column]
                    rest = right_side[part, row, column] - step * applied[part, row, column]
                    right_side[part, row, column] = rest
                    following += rest * rest * scale[part, row, column]
        turn = np.float32(following / squared)
        squared = following
        for part in range(parts):
            for row in range(rows):
                for column in range(columns):
                    direction[part, row, column] = (
                        scale[part, row, column] * right_side[part, row, column] + turn * direction[part, row, column]
                    )


@kernel
def _apply(
    normal: FloatArray, links: FloatArray, degree: FloatArray, fading: Scalar, direction: FloatArray, applied: FloatArray
) -> None:
    """Multiply the matrix of the normal equations and of the prior with a direction."""
    parts, rows, columns = direction.shape
    for part in range(parts):
        for row in range(rows):
            for column in range(columns):
                applied[part, row, column] = (degree[row, column] + fading) * direction[part, row, column]
        for row in range(rows):
            for column in range(columns - 1):
                link = links[0, row, column]
                applied[part, row, column] -= link * direction[part, row, column + 1]
            for column in range(1, columns):
                applied[part, row, column] -= links[0, row, column - 1] * direction[part, row, column - 1]
        for row in range(rows - 1):
            for column in range(columns):
                applied[part, row, column] -= links[1, row, column] * direction[part, row + 1, column]
                applied[part, row + 1, column] -= links[1, row, column] * direction[part, row, column]
            for column in range(columns - 1):
                applied[part, row, column] -= links[2, row, column] * direction[part, row + 1, column + 1]
                applied[part, row + 1, column + 1] -= links[2, row, column] * direction[part, row, column]
                applied[part, row, column + 1] -= links[3, row, column + 1] * direction[part, row + 1, column]
                applied[part, row + 1, column] -= links[3, row, column + 1] * direction[part, row, column + 1]
    place = 0
    for part in range(parts):
        for other in range(part, parts):
            for row in range(rows):
                for column in range(columns):
                    applied[part, row, column] += normal[place, row, column] * direction[other, row, column]
                    if other != part:
                        applied[other, row, column] += normal[place, row, column] * direction[part, row, column]
            place += 1
