"""Which network corrects the colour of a pattern. It is known here so that nobody loads the renderer, which has them, to ask."""

from pathlib import Path

from .pattern import BAYER_ORDERS, CfaPattern

NETWORKS = Path(__file__).parents[1] / "offline" / "models"
"""Their folder; a camera does not have it."""
ORDER = "RGGB"
"""The order of the block that they are for; other orders are its mirror images."""


def network_for(pattern: CfaPattern) -> Path | None:
    """The network for a pattern; None if there is none, because the pattern has no Bayer block or another period."""
    path = NETWORKS / f"{ORDER.lower()}-k{pattern.period}.onnx"
    return path if block_order(pattern) in BAYER_ORDERS and pattern.block_shape == (2, 2) and path.exists() else None


def block_order(pattern: CfaPattern) -> str:
    """The letters of the 2 x 2 pixels from a block's origin on, row by row."""
    return "".join(row[:2] for row in pattern.letters_from(pattern.block_origin)[:2])
