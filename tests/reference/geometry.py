"""Where filters, blocks and patches lie: counted out pixel by pixel from the tile alone (section 3;
Fig. 2).

Coordinates are frame pixels and may be negative or past the frame, where the picture is its own
mirror image.
"""

from functools import cache
from itertools import product
from typing import NamedTuple

from panchroma.shared import CfaPattern


class Block(NamedTuple):
    """The smallest rectangle around the colour sites of one block: first pixel in 0..K-1, and
    size.
    """

    top: int
    left: int
    height: int
    width: int


def letter(pattern: CfaPattern, row: int, column: int) -> str:
    """The filter letter at a frame pixel."""
    return pattern.tile[(row - pattern.origin[0]) % pattern.period][
        (column - pattern.origin[1]) % pattern.period
    ]


@cache
def block(pattern: CfaPattern) -> Block:
    """The smallest rectangle with all sites of a tile, by trying all; the tile itself if its sites
    do not form one small block.
    """
    period = pattern.period
    sites = {
        (row, column)
        for row, column in product(range(period), repeat=2)
        if letter(pattern, row, column) != "W"
    }
    if any(len({site[axis] for site in sites}) == period for axis in (0, 1)) or not _is_connected(
        sites, period
    ):
        return Block(*pattern.origin, period, period)
    sizes = product(range(1, period), repeat=2)
    for height, width in sorted(sizes, key=lambda size: size[0] * size[1]):
        for top, left in product(range(period), repeat=2):
            inside = {
                ((top + down) % period, (left + right) % period)
                for down in range(height)
                for right in range(width)
            }
            if sites <= inside:
                return Block(top, left, height, width)
    raise AssertionError("every tile has a block")


def _is_connected(sites: set[tuple[int, int]], period: int) -> bool:
    """Whether one can step from any site to any other over neighbouring sites, on a torus."""
    todo = [min(sites)]
    reached = set(todo)
    while todo:
        row, column = todo.pop()
        steps = product((-1, 0, 1), repeat=2)
        around = {((row + down) % period, (column + right) % period) for down, right in steps}
        near = around & sites - reached
        reached |= near
        todo += near
    return reached == sites


@cache
def first_patch(pattern: CfaPattern) -> tuple[int, int]:
    """The pixel, at or before (0, 0), where the first K x K patch begins: in the middle of a
    block.
    """
    found = block(pattern)
    row, column = found.top + found.height // 2, found.left + found.width // 2
    while row > 0:
        row -= pattern.period
    while column > 0:
        column -= pattern.period
    return row, column


@cache
def patch_counts(pattern: CfaPattern, shape: tuple[int, int]) -> tuple[int, int]:
    """How many patches, down and across, it takes to cover the frame."""
    row, column = first_patch(pattern)
    period = pattern.period
    return len(range(row, shape[0], period)), len(range(column, shape[1], period))


def block_corner(pattern: CfaPattern, index: tuple[int, int]) -> tuple[int, int]:
    """Top left pixel of the block with this (row, column) in the grid of blocks."""
    found, (row, column), (i, j) = block(pattern), first_patch(pattern), index
    top, left = row - found.height // 2, column - found.width // 2
    return top + i * pattern.period, left + j * pattern.period


@cache
def block_sites(pattern: CfaPattern, index: tuple[int, int]) -> list[tuple[int, int, str]]:
    """(row, column, letter) of the colour sites of one block."""
    found, (top, left) = block(pattern), block_corner(pattern, index)
    pixels = product(range(top, top + found.height), range(left, left + found.width))
    return [
        (row, column, letter(pattern, row, column))
        for row, column in pixels
        if letter(pattern, row, column) != "W"
    ]


@cache
def is_whole(pattern: CfaPattern, shape: tuple[int, int], index: tuple[int, int]) -> bool:
    """Whether the block's rectangle lies inside the frame."""
    found, (top, left) = block(pattern), block_corner(pattern, index)
    return min(top, left) >= 0 and top + found.height <= shape[0] and left + found.width <= shape[1]


def whole_blocks(pattern: CfaPattern, shape: tuple[int, int]) -> list[list[tuple[int, int]]]:
    """Indices of the blocks that lie inside the frame, row by row."""
    down, across = patch_counts(pattern, shape)
    rows = (
        [(i, j) for j in range(across + 1) if is_whole(pattern, shape, (i, j))]
        for i in range(down + 1)
    )
    return [row for row in rows if row]
