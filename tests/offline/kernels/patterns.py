"""Frames of every period, phase and size: one period to odd hundreds of pixels."""

import numpy as np

from panchroma.shared import CfaPattern

BLOCKS: tuple[tuple[str, ...], ...] = (("RG", "GB"), ("RGB",), ("RGB", "XWY"), ("R", "G"))


def frames(
    count: int, largest: int, seed: int, periods: tuple[int, ...] = (3, 4, 5, 6, 7, 8)
) -> list[tuple[CfaPattern, tuple[int, int]]]:
    """(pattern, shape), each with at least one whole block."""
    random = np.random.default_rng(seed)
    found = []
    for number in range(count):
        period = periods[number % len(periods)]
        block = BLOCKS[random.integers(len(BLOCKS)) if number >= len(periods) else 0]
        if max(len(block), len(block[0])) >= period:
            block = BLOCKS[0]
        rows, columns = (int(size) for size in random.integers(2 * period, largest, 2))
        first, second = (int(place) for place in random.integers(0, period, 2))
        found.append((CfaPattern.with_block(block, period, (first, second)), (rows, columns)))
    return found
