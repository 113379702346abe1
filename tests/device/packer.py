"""The CSI-2 formats packed bit by bit, as the tables of V4L2 have them: slow, and nothing in common with the product."""

import numpy as np
from numpy.typing import NDArray

from shared.arrays import CodeArray

GROUPS = {"raw10": (10, 4), "raw12": (12, 2), "raw14": (14, 4)}


def pack(codes: CodeArray, layout: str, stride: int = 0, padding: int = 0xA5) -> bytes:
    """Lines of `stride` bytes; what is left of each is filled with `padding`, what is left of its last group with zeros."""
    lines = []
    for row in codes.tolist():
        line = _groups(row, *GROUPS[layout]) if layout in GROUPS else _words(row, layout)
        lines.append(line + bytes([padding]) * max(stride - len(line), 0))
    return b"".join(lines)


def random_codes(shape: tuple[int, int], bits: int, seed: int = 0) -> NDArray[np.uint16]:
    """Codes over the whole range."""
    return np.random.default_rng(seed).integers(0, 1 << bits, shape).astype(np.uint16)


def _words(row: list[int], layout: str) -> bytes:
    """Little-endian words; for "big-endian u16" the others, for "8 bits" the upper bits of 12."""
    if layout == "8 bits":
        return bytes(code >> 4 for code in row)
    line = b"".join(bytes([code & 255, code >> 8]) for code in row)
    return bytes(line[place ^ 1] for place in range(len(line))) if layout == "big-endian u16" else line


def _groups(row: list[int], bits: int, pixels: int) -> bytes:
    lower = bits - 8
    line = []
    for start in range(0, len(row), pixels):
        group = (row[start : start + pixels] + [0] * pixels)[:pixels]
        line += [code >> lower for code in group]
        last = 0
        for place, code in enumerate(group):
            for bit in range(lower):
                if code >> bit & 1:
                    last += 2 ** (place * lower + bit)
        line += last.to_bytes(lower * pixels // 8, "little")
    return bytes(line)
