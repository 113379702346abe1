"""The network that corrects the colour of a pattern. It is named here so that nobody loads the
renderer to ask.
"""

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .errors import InputError
from .pattern import MIRRORS, PANCHROMATIC, CfaPattern

NETWORKS = Path(__file__).parents[1] / "offline" / "models"
"""Their folder; a camera does not have it."""


class Block(NamedTuple):
    """The block of a pattern, mirrored so that all its mirror images become one: a network is for
    that.

    Attributes
    ----------
    letters : tuple[str, ...]
        Of its pixels, row by row.
    steps : tuple[int, int]
        1, or -1 along an axis (down, across) that is mirrored.

    Examples
    --------
    >>> from panchroma.shared.networks import Block
    >>> from panchroma.shared.pattern import CfaPattern
    >>> Block.of(CfaPattern.bayer(6, "BGGR"))
    Block(letters=('RG', 'GB'), steps=(-1, -1))
    >>> Block.of(CfaPattern.of_letters("GRWW/WBWW/WWWW/WWWW"))
    Block(letters=('RG', 'BW'), steps=(1, -1))
    """

    letters: tuple[str, ...]
    steps: tuple[int, int]

    @classmethod
    def of(cls, pattern: CfaPattern) -> "Block":
        """The block of a pattern: of its four mirror images the one whose letters are last in the
        alphabet, if W is first.
        """
        height, width = pattern.block_shape
        rows = [row[:width] for row in pattern.letters_from(pattern.block_origin)[:height]]
        images = {step: tuple(row[:: step[1]] for row in rows[:: step[0]]) for step in MIRRORS}
        steps = max(images, key=lambda step: "".join(images[step]).replace(PANCHROMATIC, " "))
        return cls(images[steps], steps)

    def sites(self, period: int) -> list[int]:
        """Numbers of the pixels of a superpixel, K x K with the block in the middle, that see a
        colour, row by row.
        """
        block = np.array([list(row) for row in self.letters])
        rows, columns = (period - len(block)) // 2 + np.argwhere(block != PANCHROMATIC).T
        return (rows * period + columns).tolist()


def network_file(pattern: CfaPattern) -> str:
    """Name of the file with the network for a pattern: "rggb-k6.onnx" for any order of a Bayer
    block at K = 6.
    """
    return f"{''.join(Block.of(pattern).letters).lower()}-k{pattern.period}.onnx"


def network_for(pattern: CfaPattern) -> Path | None:
    """The network for a pattern; None if there is none, because of its block, which has to be
    square, or its period.
    """
    path = NETWORKS / network_file(pattern)
    height, width = pattern.block_shape
    return path if height == width and path.exists() else None


@cache
def load_network(path: Path) -> Any:
    """The network in a file of ours, as `runtime.session` returns it, read once.

    Raises
    ------
    InputError
        With the remedy.
    """
    from .runtime import session

    try:
        return session(path, keeps_memory=False)
    except InputError as error:
        raise InputError(f"{path}: {error}; install Panchroma again") from error
